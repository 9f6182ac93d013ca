//! Repeatability of features, and what chance would give.

use std::sync::Arc;

use salient_kernels::geodesic::{Dijkstra, Graph};
use salient_kernels::random::Random;
use salient_nodes::cut::{self, Cut};
use salient_nodes::evaluate_repeatability::{self as node, EvaluateRepeatability, Repeatability};
use salient_nodes::patch_spectrum::Features;
use salient_sdk::{Mesh, NodeError};

use crate::{creature, defaults, features, run, shuffled};

type Side<'a> = (&'a Arc<Features>, &'a Arc<Mesh>);

fn repeatability(a: Side, b: Side, params: &node::Params) -> Result<Arc<Repeatability>, NodeError> {
    let wires = [
        ("left", a.0.clone() as _),
        ("right", b.0.clone() as _),
        ("left_mesh", a.1.clone() as _),
        ("right_mesh", b.1.clone() as _),
    ];
    run::<EvaluateRepeatability>(params, &wires)
}

#[test]
fn a_shape_repeats_itself_and_chance_is_what_thrown_points_reach() {
    let mesh = creature(1, 800);
    let other = shuffled(&mesh, 4);
    let (a, b) = (features(&mesh, 20), features(&other, 20));
    let params = node::Params { top: 15, ..defaults() };
    let r = repeatability((&a, &mesh), (&b, &other), &params).unwrap();
    assert_eq!((r.top, r.common), ([15, 15], [15, 15]));
    assert_eq!((r.position.repeated, r.position_scale.repeated), (1.0, 1.0));
    // Vertices thrown by area, and each feature's scale given to them.
    let graph = Graph::unfolded(&mesh.vertices, &mesh.faces).unwrap();
    let root = mesh.area().sqrt();
    let near: Vec<Vec<f64>> = a.features[..15].iter().map(|f| Dijkstra::new().distances(&graph, &[f.vertex])).collect();
    let areas: Vec<f64> = mesh.faces.iter().map(|f| mesh.face_area(f)).collect();
    let mut random = Random::from_state(1);
    let (mut position, mut scale, throws) = (0.0, 0.0, 4000);
    for throw in 0..throws {
        let mut left = random.unit() * mesh.area();
        let face = areas
            .iter()
            .position(|x| {
                left -= x;
                left <= 0.0
            })
            .unwrap_or(0);
        let v = mesh.faces[face][random.below(3) as usize] as usize;
        let own = a.features[throw % 15].scale;
        let hit = |j: &usize| near[*j][v] <= 0.1 * root;
        let alike = |j: &usize| (a.features[*j].scale / own).ln().abs() <= 1.25_f64.ln();
        position += f64::from(u8::from((0..15).any(|j| hit(&j))));
        scale += f64::from(u8::from((0..15).filter(alike).any(|j| hit(&j))));
    }
    assert!((position / throws as f64 - r.position.chance).abs() < 0.03, "{} {r:?}", position / throws as f64);
    assert!((scale / throws as f64 - r.position_scale.chance).abs() < 0.03, "{} {r:?}", scale / throws as f64);
    assert!(r.position_scale.chance < r.position.chance && r.position.chance < 0.9);
}

#[test]
fn figures_rise_with_tolerance_and_stay_above_chance() {
    let (x, y) = (creature(0, 1000), creature(1, 1000));
    let (a, b) = (features(&x, 30), features(&y, 30));
    let of = |distance, factor| {
        let params = node::Params { top: 30, distance, factor, ..defaults() };
        repeatability((&a, &x), (&b, &y), &params).unwrap()
    };
    let all = [of(0.03, 1.1), of(0.06, 1.2), of(0.12, 1.4)];
    for r in &all {
        assert!(r.position.repeated >= r.position_scale.repeated);
        assert!(
            r.position.repeated > r.position.chance && r.position_scale.repeated > r.position_scale.chance,
            "{r:?}"
        );
        assert!(r.position_symmetric.unwrap() >= r.position.repeated);
        assert!(r.position_scale_symmetric.unwrap() >= r.position_scale.repeated);
    }
    assert!(
        all.is_sorted_by(|a, b| a.position.repeated <= b.position.repeated && a.position.chance < b.position.chance)
    );
}

#[test]
fn all_maxima_are_refused() {
    let mesh = creature(0, 600);
    let all = features(&mesh, 100_000);
    assert!(all.features.len() > 300);
    let params = node::Params { top: 100_000, ..defaults() };
    let error = repeatability((&all, &mesh), (&all, &mesh), &params).unwrap_err();
    assert!(error.to_string().contains("any points would repeat") && error.help.is_some());
    // The best of them are no reason to refuse.
    assert!(repeatability((&all, &mesh), (&all, &mesh), &node::Params { top: 20, ..params }).is_ok());
}

#[test]
fn what_was_cut_off_is_not_counted_and_wrong_meshes_are_named() {
    let (whole, moved) = (creature(0, 900), creature(1, 900));
    let piece = run::<Cut>(&cut::Params { keep: 0.5, ..defaults() }, &[("mesh", moved)]).unwrap();
    let (a, b) = (features(&piece, 20), features(&whole, 20));
    let r = repeatability((&a, &piece), (&b, &whole), &node::Params { top: 20, ..defaults() }).unwrap();
    assert!(r.common[0] == 20 && (1..20).contains(&r.common[1]), "{r:?}");
    let error = repeatability((&b, &piece), (&a, &whole), &node::Params { top: 20, ..defaults() }).unwrap_err();
    assert!(error.to_string().contains("left feature vertex"), "{error}");
}
