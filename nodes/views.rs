//! What can be seen of the artefacts of this package: what reports draw.

use std::borrow::Cow;

use salient_sdk::View;
use salient_sdk::view::{
    Certificate, Chart, Classes, Fields, Level, Link, LinkSet, Links, Marks, Point, Points, RankedList, Rankings,
    Region, Series, Verdict, Verdicts,
};

use crate::eigensolve::Eigenpairs;
use crate::evaluate_match::{Evaluation, Figures};
use crate::evaluate_repeatability::Repeatability;
use crate::feature::Feature;
use crate::iqp_match::{Match, Pair};
use crate::laplacian::Operator;
use crate::patch_extract::{Kind, Patches};
use crate::patch_spectrum::Features;
use crate::rank::Ranking;
use crate::reconstruction_energy::Energy;
use crate::retrieval_metrics::Metrics;

/// How many of the shapes that are most like a query are shown at most.
const FOUND: usize = 12;

/// The area of each vertex.
#[must_use]
pub fn operator(of: &Operator) -> View<'_> {
    let mass = &of.0.mass;
    let area = Fields {
        name: "vertex area",
        unit: "length²",
        signed: false,
        levels: vec![Level { k: 0, lambda: None }],
        vertices: mass.len(),
        values: Cow::Borrowed(mass),
        mass: None,
    };
    View { fields: vec![area], ..View::default() }
}

/// The eigenfunctions, and the spectrum.
#[must_use]
pub fn eigenpairs(of: &Eigenpairs) -> View<'_> {
    let level = |(k, lambda): (usize, &f64)| Level { k: k as u32, lambda: Some(*lambda) };
    let functions = Fields {
        name: "eigenfunction",
        unit: "1/length",
        signed: true,
        levels: of.values.iter().enumerate().map(level).collect(),
        vertices: of.mass.len(),
        values: Cow::Borrowed(&of.vectors),
        mass: Some(&of.mass),
    };
    let spectrum = Chart::lines("Spectrum", "k", "λ, 1/length²", vec![Series::new("", of.values.clone())]);
    View { fields: vec![functions], charts: vec![spectrum], ..View::default() }
}

/// The energy at every cluster of eigenvalues.
#[must_use]
pub fn energy(of: &Energy) -> View<'_> {
    let level = |(k, lambda): (&u32, &f64)| Level { k: *k, lambda: Some(*lambda) };
    let energies = Fields {
        name: "reconstruction energy",
        unit: "length",
        signed: false,
        levels: of.first.iter().zip(&of.lambda).map(level).collect(),
        vertices: of.vertices,
        values: Cow::Borrowed(&of.values),
        mass: None,
    };
    View { fields: vec![energies], ..View::default() }
}

fn points(features: &[Feature]) -> Vec<Point> {
    let point = |f: &Feature| Point { vertex: f.vertex, k: f.k, lambda: f.lambda, scale: f.scale, energy: f.energy };
    features.iter().map(point).collect()
}

/// Features alone.
#[must_use]
pub fn maxima(of: &[Feature]) -> View<'_> {
    View { points: Some(Points { points: points(of), ..Points::default() }), ..View::default() }
}

/// Features with their patches.
#[must_use]
pub fn patches(of: &Patches) -> View<'_> {
    let name = |kind: Kind| match kind {
        Kind::Disk => "disk",
        Kind::Annulus => "annulus",
        Kind::Whole => "whole",
        Kind::TooSmall => "too small",
    };
    let regions =
        of.patches.iter().map(|p| Region { kind: name(p.kind), vertices: &p.vertices, faces: &p.faces }).collect();
    View { points: Some(Points { points: points(&of.features), regions, ..Points::default() }), ..View::default() }
}

/// Features with their descriptors.
#[must_use]
pub fn features(of: &Features) -> View<'_> {
    let profiles = of.descriptors.iter().map(|d| d.as_deref().map_err(String::as_str)).collect();
    View { points: Some(Points { points: points(&of.features), profiles, ..Points::default() }), ..View::default() }
}

/// The pairs of a match, of its twin and of further ones, and the certificate.
#[must_use]
pub fn matched(of: &Match) -> View<'static> {
    let link = |p: &Pair| Link {
        points: [p.left as u32, p.right as u32],
        vertices: [p.left_vertex, p.right_vertex],
        distance: p.descriptor_distance,
    };
    let set = |name: String, objective: f64, pairs: &[Pair]| LinkSet {
        name,
        objective,
        pairs: pairs.iter().map(link).collect(),
    };
    let mut sets = vec![set("match".into(), of.objective, &of.pairs)];
    sets.extend(of.twin.iter().map(|t| set("mirror twin".into(), t.objective, &t.pairs)));
    let others = of.others.iter().enumerate();
    sets.extend(others.map(|(i, t)| set(format!("alternative {}", i + 1), t.objective, &t.pairs)));
    let certificate = Certificate { objective: of.objective, bound: of.bound, gap: of.gap, proved: of.proved };
    View { links: Some(Links { ports: ["left", "right"], sets, certificate: Some(certificate) }), ..View::default() }
}

/// The error of every pair, and the error curves.
#[must_use]
pub fn evaluation(of: &Evaluation) -> View<'static> {
    let verdict = |p: &crate::evaluate_match::PairError| Verdict {
        vertices: [p.left_vertex, p.right_vertex],
        truth: p.true_vertex,
        error: p.error,
        symmetric: p.error_symmetric,
    };
    let curve = |name: &str, figures: &Option<Figures>| figures.as_ref().map(|f| Series::new(name, f.curve.clone()));
    let curves = [curve("as it is", &of.plain), curve("up to symmetry", &of.symmetric)];
    let chart = Chart::lines(
        "Matches within a geodesic error",
        "error, % of √area",
        "share of matches",
        curves.into_iter().flatten().collect(),
    );
    View {
        verdicts: Some(Verdicts { port: "match", pairs: of.pairs.iter().map(verdict).collect() }),
        charts: vec![chart],
        ..View::default()
    }
}

/// The shares, with the chance level beside each.
#[must_use]
pub fn repeatability(of: &Repeatability) -> View<'static> {
    let names = ["position", "position and scale"].map(str::to_owned).to_vec();
    let shares = [of.position, of.position_scale];
    let series = vec![
        Series::new("repeated", shares.map(|s| s.repeated).to_vec()),
        Series::new("chance", shares.map(|s| s.chance).to_vec()),
    ];
    let chart = Chart {
        title: "Repeatability of features",
        x: "",
        y: "share of features",
        marks: Marks::Bars { names },
        series,
    };
    View { charts: vec![chart], ..View::default() }
}

/// For each query what is most like it.
#[must_use]
pub fn ranking(of: &Ranking) -> View<'static> {
    let list = |(q, query): (usize, &String)| RankedList {
        query: query.clone(),
        found: of.list(q).take(FOUND).map(|(name, score)| (name.to_owned(), score)).collect(),
    };
    let queries = of.queries.iter().enumerate().map(list).collect();
    View { rankings: Some(Rankings { measure: of.measure.clone(), queries }), ..View::default() }
}

/// The figures, the curve of precision and recall (fig. 10), and which classes are taken for which.
#[must_use]
pub fn metrics(of: &Metrics) -> View<'static> {
    let f = &of.overall;
    let (recall, precision) = f.precision_recall.iter().map(|[r, p]| (*r, *p)).unzip();
    let curve = Series { name: String::new(), x: recall, y: precision };
    let figures = [
        ("NN", f.nn),
        ("1st tier", f.first_tier),
        ("2nd tier", f.second_tier),
        ("E", f.e),
        ("DCG", f.dcg),
        ("mAP", f.map),
    ];
    let bars = Chart {
        title: "Retrieval",
        x: "",
        y: "share, 0 to 1",
        marks: Marks::Bars { names: figures.map(|(name, _)| name.to_owned()).to_vec() },
        series: vec![Series::new("", figures.map(|(_, value)| value).to_vec())],
    };
    let row = |(class, counts): (&String, &Vec<u32>)| {
        Series::new(class.clone(), counts.iter().map(|n| f64::from(*n)).collect())
    };
    let confusion = Chart {
        title: "Class of the nearest shape",
        x: "nearest",
        y: "query",
        marks: Marks::Matrix { names: of.classes.clone() },
        series: of.classes.iter().zip(&of.confusion).map(row).collect(),
    };
    let classes = of.per_query.iter().map(|query| (query.query.clone(), query.class.clone())).collect();
    View {
        classes: Some(Classes { port: "ranking", of: classes }),
        charts: vec![Chart::lines("Precision and recall", "recall", "share precise", vec![curve]), bars, confusion],
        ..View::default()
    }
}
