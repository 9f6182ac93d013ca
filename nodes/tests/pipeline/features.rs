//! Patches and their spectra.

use salient_nodes::patch_extract::{self, Kind, Metric};
use salient_nodes::patch_spectrum::{self, Normalise, PatchSpectrum};
use salient_sdk::testing::TestHost;
use salient_sdk::{AnyArtefact, DefectKind, PortValues};

use crate::{basis, creature, defaults, energy, features, maxima, patches, spectra};

#[test]
fn patches_have_the_radius_that_their_frequency_implies() {
    let mesh = creature(1, 900);
    let maxima = maxima(&mesh, &energy(&mesh, &basis(&mesh, 60)), 30);
    let discs = patches(&mesh, &maxima, &patch_extract::Params { radius: 1.3, ..defaults() });
    assert_eq!(discs.features, maxima.features);
    for (f, p) in discs.features.iter().zip(&discs.patches) {
        assert!((p.radius * f.lambda.sqrt() - 1.3).abs() < 1e-12);
        let uncut = p.source.iter().filter(|v| **v != u32::MAX);
        for v in uncut {
            assert!((*v as usize) < mesh.vertices.len());
        }
        assert!(p.source.contains(&f.vertex) || p.kind == Kind::TooSmall);
    }
    assert!(discs.patches.iter().any(|p| p.kind == Kind::Disk));
}

#[test]
fn clipped_patches_are_larger_than_whole_triangles_and_within_a_ring_of_them() {
    let mesh = creature(1, 900);
    let maxima = maxima(&mesh, &energy(&mesh, &basis(&mesh, 60)), 20);
    let cut = patches(&mesh, &maxima, &patch_extract::Params { clip: true, ..defaults() });
    let whole = patches(&mesh, &maxima, &patch_extract::Params { clip: false, ..defaults() });
    let sum = |p: &patch_extract::Patches| p.patches.iter().map(|p| p.area).sum::<f64>();
    assert!(sum(&cut) > 1.02 * sum(&whole));
    assert!(whole.patches.iter().all(|p| p.source.iter().all(|v| *v != u32::MAX)));
}

#[test]
fn distances_between_features_are_a_metric_and_unfolding_shortens_them() {
    let mesh = creature(2, 700);
    let maxima = maxima(&mesh, &energy(&mesh, &basis(&mesh, 40)), 25);
    let edges = patches(&mesh, &maxima, &defaults());
    let unfolded = patches(&mesh, &maxima, &patch_extract::Params { metric: Metric::Unfolded, ..defaults() });
    let n = maxima.features.len();
    let d = |a: usize, b: usize| edges.distances[a * n + b];
    for a in 0..n {
        for b in 0..n {
            assert_eq!(d(a, b), d(b, a));
            assert_eq!(d(a, b) == 0.0, maxima.features[a].vertex == maxima.features[b].vertex);
            assert!(unfolded.distances[a * n + b] <= d(a, b) + 1e-12);
            for c in 0..n {
                assert!(d(a, c) <= d(a, b) + d(b, c) + 1e-12);
            }
        }
    }
    assert!(unfolded.distances.iter().sum::<f64>() < 0.99 * edges.distances.iter().sum::<f64>());
}

#[test]
fn descriptors_follow_weyl_and_differ_only_by_their_normalisation() {
    let mesh = creature(0, 900);
    let maxima = maxima(&mesh, &energy(&mesh, &basis(&mesh, 60)), 12);
    let discs = patches(&mesh, &maxima, &defaults());
    let describe = |normalise| spectra(&discs, &patch_spectrum::Params { normalise, ..defaults() });
    let (ratio, slope, plain) =
        (describe(Normalise::Elementwise), describe(Normalise::Slope), describe(Normalise::Never));
    for i in 0..12 {
        let [Ok(ratio), Ok(slope), Ok(plain)] = [&ratio, &slope, &plain].map(|f| &f.descriptors[i]) else {
            panic!("feature {i} has no descriptor")
        };
        assert_eq!(ratio.len(), 21);
        assert!(plain.windows(2).all(|w| w[0] <= w[1]) && plain[0] > 0.0);
        let weyl = slope[0] / plain[0];
        for k in 0..21 {
            assert!((slope[k] - ratio[k] * (k + 1) as f64).abs() < 1e-9 * slope[k]);
            assert!((slope[k] - plain[k] * weyl).abs() < 1e-9 * slope[k]);
        }
        // Weyl's law: the ratio is about 1 at the end of the descriptor.
        assert!((0.5..2.0).contains(&ratio[20]), "{ratio:?}");
    }
}

#[test]
fn a_patch_without_enough_vertices_says_so_and_is_a_defect() {
    let mesh = creature(0, 400);
    let maxima = maxima(&mesh, &energy(&mesh, &basis(&mesh, 60)), 50);
    let discs = patches(&mesh, &maxima, &patch_extract::Params { radius: 0.2, ..defaults() });
    let described = spectra(&discs, &defaults());
    let without: Vec<_> = described.descriptors.iter().filter_map(|d| d.as_ref().err()).collect();
    assert!(!without.is_empty());
    assert!(without.iter().all(|why| !why.is_empty()));
    let defects = AnyArtefact::defects(&*described);
    assert_eq!((defects[0].kind, defects[0].count), (DefectKind::PatchWithoutDescriptor, without.len()));
    let json = AnyArtefact::json(&*described);
    let first = described.descriptors.iter().position(Result::is_err).unwrap();
    assert!(json[first]["descriptor"].is_null() && json[first]["why"].is_string());
}

#[test]
fn the_documented_keys_are_there() {
    let json = AnyArtefact::json(&*features(&creature(0, 600), 5));
    let first = &json[0];
    for key in ["vertex", "k", "lambda", "scale", "energy"] {
        assert!(first[key].is_number(), "{key}");
    }
    assert!(first["patch"]["kind"].is_string());
    assert!(first["patch"]["vertices"].is_number() && first["patch"]["area"].is_number());
    assert_eq!(first["descriptor"].as_array().unwrap().len(), 21);
    assert!(first["why"].is_null());
    let (scale, lambda) = (first["scale"].as_f64().unwrap(), first["lambda"].as_f64().unwrap());
    assert!((scale * lambda.sqrt() - 1.0).abs() < 1e-14);
}

#[test]
fn more_features_compute_only_the_new_patches() {
    let mesh = creature(1, 900);
    let energy = energy(&mesh, &basis(&mesh, 60));
    let discs = |count| patches(&mesh, &maxima(&mesh, &energy, count), &defaults());
    let (few, many) = (discs(15), discs(24));
    // A patch does not depend on the other features.
    assert_eq!(few.features[..], many.features[..15]);
    assert!(few.patches[..] == many.patches[..15]);
    for workers in [0, 3] {
        let host = TestHost::with_workers(workers);
        let run = |patches: &std::sync::Arc<patch_extract::Patches>, params: &patch_spectrum::Params| {
            let mut wired = PortValues::default();
            wired.push("patches", "", patches.clone());
            let features = host.run_wired::<PatchSpectrum>(params, wired).unwrap();
            let figure = |name: &str| host.recorded(name).unwrap().as_u64().unwrap() as usize;
            (features, figure("patches computed"), figure("patches remembered"))
        };
        let first = run(&few, &defaults());
        assert_eq!((first.1, first.2), (15, 0));
        let second = run(&many, &defaults());
        // A patch without a descriptor is not remembered.
        let known = first.0.descriptors.iter().filter(|d| d.is_ok()).count();
        assert!(known > 10);
        assert_eq!((second.1, second.2), (24 - known, known));
        // `run` of this module remembers nothing: bit for bit the same.
        assert!(AnyArtefact::to_bytes(&second.0).unwrap() == spectra(&many, &defaults()).to_bytes().unwrap());
        // The normalisation is no part of a spectrum; the number of values is.
        let slope = patch_spectrum::Params { normalise: Normalise::Slope, ..defaults() };
        assert!(run(&many, &slope).2 > known);
        assert_eq!(run(&many, &patch_spectrum::Params { values: 20, ..defaults() }).2, 0);
    }
}
