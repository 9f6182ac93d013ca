//! Signatures of surfaces in space do not depend on place, size, turn, and hardly on the triangulation.

// A test may fail where it stands.
#![allow(clippy::unwrap_used)]

use salient_kernels::creature::{CreatureParams, Species, generate};
use salient_kernels::object;
use salient_kernels::signature::harmonics::harmonics;
use salient_kernels::signature::views::{Align, views};

type Points = Vec<[f64; 3]>;
type Signature = fn(&Points, &[[u32; 3]]) -> Vec<f64>;

fn creature(species: Species, vertices: usize) -> (Points, Vec<[u32; 3]>) {
    let made = generate(&CreatureParams { species, vertices, ..CreatureParams::default() }).unwrap();
    (made.vertices, made.faces)
}

/// Turned by an orthogonal matrix with rational entries, mirrored, enlarged and moved.
fn moved(points: &Points) -> Points {
    let rows = [[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [6.0, 2.0, -3.0]];
    let place = |p: &[f64; 3]| rows.map(|r| 5.0 + 3.0 / 7.0 * (r[0] * p[0] + r[1] * p[1] + r[2] * p[2]));
    points.iter().map(place).collect()
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    let sum = |x: &mut dyn Iterator<Item = f64>| x.sum::<f64>();
    sum(&mut a.iter().zip(b).map(|(x, y)| (x - y).abs())) / sum(&mut a.iter().map(|x| x.abs()))
}

#[test]
fn signatures_are_free_of_placement_and_size() {
    let (points, faces) = creature(Species::Cat, 1500);
    let other = moved(&points);
    assert!(apart(&harmonics(&points, &faces), &harmonics(&other, &faces)) < 1e-9);
    for align in [Align::Area, Align::Normals] {
        // Points fall into other pixels by rounding.
        assert!(apart(&views(&points, &faces, align), &views(&other, &faces, align)) < 1e-3);
    }
}

#[test]
fn triangulations_differ_less_than_species() {
    let coarse = creature(Species::Cat, 1000);
    let fine = creature(Species::Cat, 4000);
    let bear = creature(Species::Bear, 4000);
    let of = |f: Signature| {
        let [a, b, c] = [&coarse, &fine, &bear].map(|m| f(&m.0, &m.1));
        (apart(&a, &b), apart(&b, &c))
    };
    let (same, other) = of(|p, f| harmonics(p, f));
    assert!(5.0 * same < other, "{same} {other}");
    let (same, other) = of(|p, f| views(p, f, Align::Area));
    assert!(3.0 * same < other, "{same} {other}");
}

#[test]
fn objects_are_closed_and_repeatable() {
    assert_eq!(object::families().len(), 20);
    for family in ["bearing", "bust", "hand", "vase"] {
        let made = object::generate(family, 1, 1200).unwrap();
        let census = salient_kernels::topology::census(&made.vertices, &made.faces).unwrap();
        assert!(census.is_closed_manifold() && census.euler.len() == 1, "{family}: {census:?}");
        assert!((600..2400).contains(&made.vertices.len()), "{family}: {}", made.vertices.len());
    }
    // A handle is a hole; a cup has one.
    let cup = object::generate("cup", 3, 1500).unwrap();
    assert_eq!(cup, object::generate("cup", 3, 1500).unwrap());
    assert_ne!(cup, object::generate("cup", 4, 1500).unwrap());
    assert_eq!(salient_kernels::topology::census(&cup.vertices, &cup.faces).unwrap().euler, [0]);
    assert!(object::generate("spoon", 0, 800).is_err());
}
