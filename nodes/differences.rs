//! How two artefacts of one type differ, in the terms of the field: what `salient compare` says of each.
//!
//! Features are *kept* if the other side has one at the same point of the surface and at nearly the same scale; points
//! of meshes that are numbered differently are the same within 2 % of the square root of the area. Matches are kept if
//! both their ends are. Pairings are one to one, nearest first.

use salient_sdk::difference::{relative, short};
use salient_sdk::{Common, Difference, Surfaces};
use serde_json::{Value, json};

use crate::eigensolve::Eigenpairs;
use crate::evaluate_match::{Evaluation, Figures};
use crate::feature::Feature;
use crate::iqp_match::{Match, Pair};
use crate::laplacian::Operator;
use crate::maxima::Salient;
use crate::patch_extract::Patches;
use crate::patch_spectrum::Features;
use crate::reconstruction_energy::Energy;

mod retrieval;
pub use retrieval::{metrics, rankings, similarities};

/// Scales whose logarithms differ by at most this are the same scale.
const SAME_SCALE: f64 = 0.1;
/// How many features or matches the text names.
const NAMED: usize = 4;

/// The largest relative change in two lists, entry by entry, and where it is.
fn largest_change<'a>(
    one: impl IntoIterator<Item = &'a f64>,
    other: impl IntoIterator<Item = &'a f64>,
) -> Option<(usize, f64, [f64; 2])> {
    let change = |(i, (a, b)): (usize, (&f64, &f64))| (i, relative(*a, *b), [*a, *b]);
    let changes = one.into_iter().zip(other).enumerate().map(change);
    // The first of equal ones.
    changes.filter(|(_, change, _)| *change > 0.0).reduce(|best, it| if it.1 > best.1 { it } else { best })
}

fn list_change(figure: &str, noun: &str, one: &[f64], other: &[f64]) -> Option<Difference> {
    let (at, size, values) = largest_change(one, other)?;
    let text =
        format!("largest relative change {} at {noun} {at}: {} -> {}", short(size), short(values[0]), short(values[1]));
    Some(Difference { values: Some(values), ..Difference::new(figure, size, text) }.details(json!({ "index": at })))
}

/// Eigenvalues: number, and the largest relative change among those that both have.
#[must_use]
pub fn eigenpairs(one: &Eigenpairs, other: &Eigenpairs) -> Vec<Difference> {
    // Zero eigenvalues are exact in truth and rounding in practice.
    let floor = 1e-9 * one.values.iter().chain(&other.values).fold(0.0_f64, |a, b| a.max(*b));
    let values = |of: &Eigenpairs| of.values.iter().map(|x| if *x > floor { *x } else { 0.0 }).collect::<Vec<_>>();
    let changed = list_change("eigenvalues", "k =", &values(one), &values(other));
    let count = Difference::of_count("eigenpairs", one.values.len(), other.values.len());
    let vertices = Difference::of_count("vertices", one.mass.len(), other.mass.len());
    [changed, count, vertices].into_iter().flatten().collect()
}

/// Mass and stiffness: the largest relative change of a mass, and of a weight over the largest weight.
#[must_use]
pub fn operators(one: &Operator, other: &Operator) -> Vec<Difference> {
    let (a, b) = (&one.0, &other.0);
    let size = Difference::of_count("vertices", a.mass.len(), b.mass.len());
    if size.is_some() {
        return size.into_iter().chain(Difference::of_number("area", one.0.area(), other.0.area())).collect();
    }
    let mass = list_change("mass", "vertex", &a.mass, &b.mass);
    let pattern = a.stiffness.offsets() == b.stiffness.offsets() && a.stiffness.columns() == b.stiffness.columns();
    let weights = if pattern {
        let (v, w) = (a.stiffness.values(), b.stiffness.values());
        let largest = v.iter().chain(w).fold(0.0_f64, |a, b| a.max(b.abs()));
        let change = v.iter().zip(w).fold(0.0_f64, |a, (v, w)| a.max((v - w).abs()));
        let size = if largest > 0.0 { change / largest } else { 0.0 };
        (change > 0.0).then(|| {
            Difference::new("stiffness", size, format!("largest change {} of the largest weight", short(size)))
        })
    } else {
        let (n, m) = (a.stiffness.values().len(), b.stiffness.values().len());
        Some(Difference::new("stiffness", 1.0, format!("other neighbours: {n} -> {m} nonzeros")))
    };
    [mass, weights].into_iter().flatten().collect()
}

/// Energies: the largest change over the largest energy, and the number of clusters.
#[must_use]
pub fn energies(one: &Energy, other: &Energy) -> Vec<Difference> {
    let clusters = Difference::of_count("clusters", one.first.len(), other.first.len());
    let vertices = Difference::of_count("vertices", one.vertices, other.vertices);
    let lambda = list_change("mean eigenvalues", "cluster", &one.lambda, &other.lambda);
    let comparable = one.vertices == other.vertices && one.first == other.first;
    let energy = comparable.then(|| {
        let largest = one.values.iter().chain(&other.values).fold(0.0_f64, |a, b| a.max(b.abs()));
        let changes = one.values.iter().zip(&other.values).map(|(a, b)| (a - b).abs()).enumerate();
        let (at, change) = changes.reduce(|best, it| if it.1 > best.1 { it } else { best }).unwrap_or((0, 0.0));
        let size = if largest > 0.0 { change / largest } else { 0.0 };
        let (k, vertex) = (one.first.get(at / one.vertices.max(1)), at % one.vertices.max(1));
        let text = format!("largest change {} of the largest energy, at vertex {vertex}", short(size));
        (size > 0.0).then(|| Difference::new("energy", size, text).details(json!({ "vertex": vertex, "k": k })))
    });
    [energy.flatten(), clusters, vertices, lambda].into_iter().flatten().collect()
}

/// Pairs of equal features (indices on both sides, by the first), nearest first; without surfaces, equal vertices.
fn kept(one: &[Feature], other: &[Feature], common: Option<&Common>) -> Vec<(usize, usize)> {
    let mut near = Vec::new();
    for (i, a) in one.iter().enumerate() {
        for (j, b) in other.iter().enumerate() {
            let scale = (a.scale / b.scale).ln().abs();
            let apart = match common {
                Some(common) => common.apart(a.vertex, b.vertex),
                None if a.vertex == b.vertex => 0.0,
                None => f64::INFINITY,
            };
            if apart <= 1.0 && scale <= SAME_SCALE {
                near.push((apart + scale / SAME_SCALE, i, j));
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut used_one, mut used_other) = (vec![false; one.len()], vec![false; other.len()]);
    let mut pairs = Vec::new();
    for (_, i, j) in near {
        if !used_one[i] && !used_other[j] {
            (used_one[i], used_other[j]) = (true, true);
            pairs.push((i, j));
        }
    }
    pairs.sort_unstable();
    pairs
}

/// Features kept, lost and gained, with their positions; and the pairs of the kept ones.
fn feature_sets(one: &[Feature], other: &[Feature], surfaces: &Surfaces) -> (Option<Difference>, Vec<(usize, usize)>) {
    let common = surfaces.at("mesh");
    let pairs = kept(one, other, common);
    let (lost, gained) = (one.len() - pairs.len(), other.len() - pairs.len());
    if lost + gained == 0 {
        return (None, pairs);
    }
    let place = |side: usize, f: &Feature| -> Value {
        json!({
            "vertex": f.vertex, "k": f.k, "scale": f.scale, "energy": f.energy,
            "position": common.and_then(|c| c.position(side, f.vertex)),
        })
    };
    let rest = |side: usize, all: &[Feature], kept: Vec<usize>| -> Vec<Value> {
        let left = all.iter().enumerate().filter(|(i, _)| !kept.contains(i));
        left.map(|(_, f)| place(side, f)).collect()
    };
    let lost_places = rest(0, one, pairs.iter().map(|p| p.0).collect());
    let gained_places = rest(1, other, pairs.iter().map(|p| p.1).collect());
    let text = format!(
        "{} kept, {lost} lost{}, {gained} gained{}",
        pairs.len(),
        name_places(&lost_places),
        name_places(&gained_places)
    );
    let details = json!({ "kept": pairs.len(), "lost": lost_places, "gained": gained_places });
    let values = Some([one.len() as f64, other.len() as f64]);
    let difference = Difference { values, ..Difference::new("features", (lost + gained) as f64, text) };
    (Some(difference.details(details)), pairs)
}

/// ` (vertex 17 at 0.1, 0.2, 0.3; ...)`: the first few.
fn name_places(places: &[Value]) -> String {
    if places.is_empty() {
        return String::new();
    }
    let name = |place: &Value| {
        let coordinates = place["position"].as_array().map(|p| {
            let numbers = p.iter().filter_map(Value::as_f64).map(short).collect::<Vec<_>>();
            format!(" at {}", numbers.join(" "))
        });
        format!("vertex {}{}", place["vertex"], coordinates.unwrap_or_default())
    };
    let named: Vec<_> = places.iter().take(NAMED).map(name).collect();
    let more = if places.len() > NAMED { "; ..." } else { "" };
    format!(" ({}{more})", named.join("; "))
}

/// Features kept, lost and gained, and how many maxima there were.
#[must_use]
pub fn maxima(one: &Salient, other: &Salient, surfaces: &Surfaces) -> Vec<Difference> {
    let (features, pairs) = feature_sets(&one.features, &other.features, surfaces);
    let of = |all: &[Feature], of: fn(&(usize, usize)) -> usize| -> Vec<f64> {
        pairs.iter().map(|pair| all[of(pair)].energy).collect()
    };
    let energy =
        list_change("energy of kept features", "feature", &of(&one.features, |p| p.0), &of(&other.features, |p| p.1));
    let found = Difference::of_count("maxima before selection", one.found, other.found);
    [features, energy, found].into_iter().flatten().collect()
}

/// Features kept, lost and gained; types and areas of the kept ones' patches.
#[must_use]
pub fn patches(one: &Patches, other: &Patches, surfaces: &Surfaces) -> Vec<Difference> {
    let (features, pairs) = feature_sets(&one.features, &other.features, surfaces);
    let retyped = pairs.iter().filter(|(i, j)| one.patches[*i].kind != other.patches[*j].kind).count();
    let kinds = (retyped > 0).then(|| {
        let text = format!("{retyped} of {} kept patches are of another type", pairs.len());
        Difference::new("types of patches", retyped as f64, text)
    });
    let area = |of: &Patches, i: usize| of.patches[i].area;
    let before: Vec<f64> = pairs.iter().map(|(i, _)| area(one, *i)).collect();
    let after: Vec<f64> = pairs.iter().map(|(_, j)| area(other, *j)).collect();
    let areas = list_change("areas of patches", "kept feature", &before, &after);
    [features, kinds, areas, Difference::of_number("area", one.area, other.area)].into_iter().flatten().collect()
}

/// Features kept, lost and gained; the distance of the kept ones' descriptors.
#[must_use]
pub fn features(one: &Features, other: &Features, surfaces: &Surfaces) -> Vec<Difference> {
    let (features, pairs) = feature_sets(&one.features, &other.features, surfaces);
    let described = |of: &Features| of.descriptors.iter().filter(|d| d.is_ok()).count();
    let count = Difference::of_count("described features", described(one), described(other));
    let length = Difference::of_count("length of descriptors", one.values, other.values);
    [descriptors(one, other, &pairs), features, length, count].into_iter().flatten().collect()
}

/// ||d - d'|| / max(||d||, ||d'||) over the entries that both have: mean and largest over the kept features.
fn descriptors(one: &Features, other: &Features, pairs: &[(usize, usize)]) -> Option<Difference> {
    let mut distances = Vec::new();
    for (i, j) in pairs {
        if let (Ok(a), Ok(b)) = (&one.descriptors[*i], &other.descriptors[*j]) {
            let n = a.len().min(b.len());
            let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
            let apart = norm(&mut a.iter().zip(b).map(|(a, b)| a - b));
            let size = norm(&mut a[..n].iter().copied()).max(norm(&mut b[..n].iter().copied()));
            distances.push((if size > 0.0 { apart / size } else { 0.0 }, one.features[*i].vertex));
        }
    }
    let (largest, vertex) = distances.iter().copied().reduce(|best, it| if it.0 > best.0 { it } else { best })?;
    if largest == 0.0 {
        return None;
    }
    let mean = distances.iter().map(|(d, _)| d).sum::<f64>() / distances.len() as f64;
    let text = format!("relative distance {} on average, at most {} (vertex {vertex})", short(mean), short(largest));
    let details = json!({ "mean": mean, "largest": largest, "vertex": vertex, "compared": distances.len() });
    Some(Difference::new("descriptors", mean, text).details(details))
}

/// Matches kept, lost and gained; objective, bound and gap.
#[must_use]
pub fn matches(one: &Match, other: &Match, surfaces: &Surfaces) -> Vec<Difference> {
    let end = |port: &str, a: u32, b: u32| match surfaces.at(port) {
        Some(common) => common.apart(a, b) <= 1.0,
        None => a == b,
    };
    let same =
        |p: &Pair, q: &Pair| end("left", p.left_vertex, q.left_vertex) && end("right", p.right_vertex, q.right_vertex);
    let mut used = vec![false; other.pairs.len()];
    let mut lost = Vec::new();
    for p in &one.pairs {
        match other.pairs.iter().enumerate().position(|(j, q)| !used[j] && same(p, q)) {
            Some(j) => used[j] = true,
            None => lost.push(p),
        }
    }
    let gained: Vec<&Pair> = other.pairs.iter().zip(&used).filter(|(_, used)| !**used).map(|(q, _)| q).collect();
    let kept = one.pairs.len() - lost.len();
    let place = |side: usize, p: &Pair| {
        let at = |port: &str, vertex: u32| surfaces.at(port).and_then(|c| c.position(side, vertex));
        json!({
            "left_vertex": p.left_vertex, "right_vertex": p.right_vertex,
            "left_position": at("left", p.left_vertex), "right_position": at("right", p.right_vertex),
        })
    };
    let pairs = (!lost.is_empty() || !gained.is_empty()).then(|| {
        let text = format!(
            "{kept} kept, {} lost{}, {} gained{}",
            lost.len(),
            name_pairs(&lost),
            gained.len(),
            name_pairs(&gained)
        );
        let list = |side: usize, of: &[&Pair]| of.iter().map(|p| place(side, p)).collect::<Vec<_>>();
        let details = json!({ "kept": kept, "lost": list(0, &lost), "gained": list(1, &gained) });
        let values = Some([one.pairs.len() as f64, other.pairs.len() as f64]);
        Difference { values, ..Difference::new("matches", (lost.len() + gained.len()) as f64, text) }.details(details)
    });
    let number = Difference::of_number;
    let objective = number("objective", one.objective, other.objective);
    // The gap of a proved match is rounding, and its bound the objective.
    let open = |of: fn(&Match) -> f64| if one.proved && other.proved { [0.0, 0.0] } else { [of(one), of(other)] };
    let ([bound, bound_other], [gap, gap_other]) = (open(|m| m.bound), open(|m| m.gap));
    let proof = (one.proved != other.proved).then(|| {
        let say = |proved: bool| if proved { "proved optimal" } else { "not proved" };
        Difference::new("proof", 1.0, format!("{} -> {}", say(one.proved), say(other.proved)))
    });
    let all = [pairs, objective, proof, number("bound", bound, bound_other), number("gap", gap, gap_other)];
    all.into_iter().flatten().collect()
}

fn name_pairs(pairs: &[&Pair]) -> String {
    if pairs.is_empty() {
        return String::new();
    }
    let named: Vec<_> = pairs.iter().take(NAMED).map(|p| format!("{}-{}", p.left_vertex, p.right_vertex)).collect();
    let more = if pairs.len() > NAMED { ", ..." } else { "" };
    format!(" (vertices {}{more})", named.join(", "))
}

/// Accuracy, plain and up to symmetry.
#[must_use]
pub fn evaluations(one: &Evaluation, other: &Evaluation) -> Vec<Difference> {
    let mut all = Vec::new();
    for (reading, a, b) in [("", &one.plain, &other.plain), (" up to symmetry", &one.symmetric, &other.symmetric)] {
        let (Some(a), Some(b)) = (a, b) else { continue };
        let share = |limit: &str, of: fn(&Figures) -> f64| {
            let (x, y) = (of(a), of(b));
            let text = format!("{} % -> {} % ({:+.1} points)", short(100.0 * x), short(100.0 * y), 100.0 * (y - x));
            let figure = format!("accuracy within {limit} %{reading}");
            (x != y).then(|| Difference { values: Some([x, y]), ..Difference::new(&figure, (x - y).abs(), text) })
        };
        all.extend([share("5", |f| f.within_5), share("10", |f| f.within_10), share("25", |f| f.within_25)]);
        if let (Some(x), Some(y)) = (a.median, b.median) {
            all.push(Difference::of_number(&format!("median error{reading}"), x, y));
        }
    }
    all.push(Difference::of_count("matches", one.matched, other.matched));
    all.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_paired_one_to_one_and_nearest_first() {
        // Scales 1 / sqrt(lambda): 0.5 and two within 10 % of it, and one that is not.
        let one = [Feature::new(7, 1, 4.0, 1.0), Feature::new(7, 2, 4.4, 1.0), Feature::new(9, 3, 9.0, 1.0)];
        let other = [Feature::new(7, 1, 4.5, 1.0), Feature::new(9, 3, 16.0, 1.0), Feature::new(8, 3, 9.0, 1.0)];
        assert_eq!(kept(&one, &other, None), [(1, 0)]);
        let (features, pairs) = feature_sets(&one, &other, &Surfaces::default());
        let features = features.unwrap();
        assert_eq!((pairs.len(), features.size), (1, 4.0));
        assert_eq!(features.text, "1 kept, 2 lost (vertex 7; vertex 9), 2 gained (vertex 9; vertex 8)");
        assert_eq!(features.details["lost"][0]["k"], 1);
        let (none, all) = feature_sets(&one, &one, &Surfaces::default());
        assert!(none.is_none() && all == [(0, 0), (1, 1), (2, 2)]);
    }

    #[test]
    fn the_largest_relative_change_is_found_and_zeros_are_equal() {
        let change = list_change("eigenvalues", "k =", &[0.0, 1.0, 10.0], &[0.0, 1.25, 10.5]).unwrap();
        assert_eq!((change.size, change.values), (0.2, Some([1.0, 1.25])));
        assert_eq!(change.text, "largest relative change 0.2 at k = 1: 1 -> 1.25");
        assert_eq!(list_change("x", "k =", &[1.0], &[1.0, 2.0]), None);
    }
}
