//! Creatures: topology, shape of triangles, ground truth, symmetry, near-isometry of poses.
#![allow(clippy::unwrap_used)] // Helpers of tests fail by panicking, as tests do.
#![allow(clippy::float_cmp)] // Values taken over unchanged are compared as such.

mod geom;

use geom::Random;
use salient_kernels::creature::{
    Creature, CreatureError, CreatureParams, RestSurface, Species, correspondence, generate, mirror_twins,
};
use salient_kernels::geodesic::{Dijkstra, Graph};
use salient_kernels::topology::{census, surface_area};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// A creature of the default size; made once however many tests ask for it.
fn made(species: Species, seed: u64, pose: u32) -> Arc<Creature> {
    type Made = BTreeMap<(Species, u64, u32), Arc<Creature>>;
    static MADE: Mutex<Made> = Mutex::new(Made::new());
    let key = (species, seed, pose);
    if let Some(found) = MADE.lock().unwrap().get(&key) {
        return found.clone();
    }
    let creature = Arc::new(generate(&CreatureParams { species, seed, pose, ..Default::default() }).unwrap());
    MADE.lock().unwrap().insert(key, creature.clone());
    creature
}

/// The individual shown in each pose by the tests.
fn seed_of(pose: u32) -> u64 {
    [1, 1, 1, 1, 2, 0][pose as usize]
}

fn distance(p: [f64; 3], q: [f64; 3]) -> f64 {
    (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt()
}

/// The least angle of all triangles, in degrees.
fn least_angle(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> f64 {
    let angle = |[a, b, c]: [[f64; 3]; 3]| {
        let (x, y, z) = (distance(a, b), distance(a, c), distance(b, c));
        ((x * x + y * y - z * z) / (2.0 * x * y)).clamp(-1.0, 1.0).acos().to_degrees()
    };
    let corners = faces.iter().flat_map(|f| {
        let [a, b, c] = f.map(|v| vertices[v as usize]);
        [[a, b, c], [b, c, a], [c, a, b]]
    });
    corners.map(angle).fold(180.0, f64::min)
}

/// Signed volume: positive when faces look outward.
fn volume(creature: &Creature) -> f64 {
    let sixth = |f: &[u32; 3]| {
        let [p, q, r] = f.map(|v| creature.vertices[v as usize]);
        p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0]) + p[2] * (q[0] * r[1] - q[1] * r[0])
    };
    creature.faces.iter().map(sixth).sum::<f64>() / 6.0
}

#[test]
fn every_pose_of_every_species_is_a_well_shaped_sphere() {
    for species in Species::ALL {
        let surface: Vec<RestSurface> = (0..3).map(|seed| RestSurface::new(species, seed)).collect();
        for pose in 0..6 {
            let seed = seed_of(pose);
            let creature = made(species, seed, pose);
            let found = census(&creature.vertices, &creature.faces).unwrap();
            assert!(found.is_closed_manifold() && found.euler == [2]);
            assert_eq!(creature.vertices.len(), 2000);
            assert!(volume(&creature) > 0.0);
            let least = least_angle(&creature.vertices, &creature.faces);
            assert!(least > 18.0, "{species:?} {pose}: {least}");
            // The ground truth lies on the rest surface.
            assert!(creature.rest.iter().all(|&p| surface[seed as usize].level(p).abs() < 1e-9));
        }
    }
}

#[test]
fn many_poses_seeds_and_resolutions_come_out() {
    let mut random = Random(1);
    for (k, vertices) in [400, 700, 1000, 1500, 3000, 400, 700, 1000, 1500, 3000].into_iter().enumerate() {
        let species = Species::ALL[(k + k / 5) % 5];
        let (seed, pose) = (random.below(1000) as u64, random.below(1000) as u32);
        let creature = generate(&CreatureParams { species, seed, pose, vertices, triangulation: 5 }).unwrap();
        let found = census(&creature.vertices, &creature.faces).unwrap();
        assert!(found.is_closed_manifold() && found.euler == [2]);
        let off = creature.vertices.len().abs_diff(vertices);
        assert!(off * 50 <= vertices, "{species:?} {vertices}: {}", creature.vertices.len());
    }
    for vertices in [0, 399, 1 << 40] {
        let refused = generate(&CreatureParams { vertices, ..Default::default() }).unwrap_err();
        assert_eq!(refused, CreatureError::VertexCount(vertices));
    }
}

#[test]
fn the_same_parameters_give_the_same_bits_and_others_do_not() {
    let params = CreatureParams { pose: 3, vertices: 800, ..Default::default() };
    let one = generate(&params).unwrap();
    assert_eq!(one, generate(&params).unwrap());
    // Another pose and another grid give other triangulations: no rest point in common, other faces.
    for other in [CreatureParams { pose: 4, ..params }, CreatureParams { triangulation: 1, ..params }] {
        let other = generate(&other).unwrap();
        assert_ne!(one.faces, other.faces);
        let shared = one.rest.iter().filter(|p| other.rest.iter().any(|q| distance(**p, *q) < 1e-6)).count();
        assert_eq!(shared, 0);
    }
    // Seeds change the proportions, and little enough to stay of one kind.
    let areas: Vec<f64> = (0..4)
        .map(|seed| generate(&CreatureParams { seed, ..params }).unwrap())
        .map(|c| surface_area(&c.vertices, &c.faces).unwrap())
        .collect();
    for pair in areas.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((ratio - 1.0).abs() > 1e-4 && (0.7..1.4).contains(&ratio), "{areas:?}");
    }
}

#[test]
fn rest_is_rest_and_symmetric() {
    let mut random = Random(9);
    for species in Species::ALL {
        let surface = RestSurface::new(species, 1);
        for _ in 0..500 {
            let p = [random.next() - 0.5, 1.5 * random.next(), 2.0 * random.next() - 1.0];
            assert!(
                (surface.level(p) - surface.level([-p[0], p[1], p[2]])).abs() < 1e-9 * (1.0 + surface.level(p).abs())
            );
        }
        let creature = made(species, 1, 0);
        for (p, q) in creature.vertices.iter().zip(&creature.rest) {
            assert!(distance(*p, *q) < 1e-12);
        }
        // Twins are mirror images to within the spacing, and the twin of the twin is near.
        let spacing = (surface_area(&creature.vertices, &creature.faces).unwrap() / 2000.0).sqrt();
        let twins = mirror_twins(&creature);
        for (v, &t) in twins.iter().enumerate() {
            let [x, y, z] = creature.rest[v];
            assert!(distance(creature.rest[t as usize], [-x, y, z]) < spacing);
            assert!(distance(creature.rest[twins[t as usize] as usize], creature.rest[v]) < 2.0 * spacing);
        }
        let named = |name: &str| creature.landmarks.iter().find(|l| l.0 == name).map(|l| creature.rest[l.1 as usize]);
        let (left, right) = (named("hind paw +x").unwrap(), named("hind paw -x").unwrap());
        assert!(distance(left, [-right[0], right[1], right[2]]) < 2.0 * spacing && left[0] > 0.05);
        assert!(named("nose").unwrap()[2] > named("back").unwrap()[2] && named("tail").unwrap()[2] < -0.4);
    }
}

#[test]
fn the_level_is_the_fields_projection_target() {
    // The projection lands on the surface, and moves points that lie near it by no more than needed.
    let surface = RestSurface::new(Species::Horse, 1);
    let creature = made(Species::Horse, 1, 0);
    let mut random = Random(4);
    for p in creature.rest.iter().step_by(7) {
        let off = [0, 1, 2].map(|k| p[k] + 0.02 * (random.next() - 0.5));
        let back = surface.project(off);
        assert!(surface.level(back).abs() < 1e-9);
        assert!(distance(off, back) <= 1.3 * distance(off, *p) + 1e-12);
    }
}

#[test]
fn the_map_between_poses_is_continuous_and_keeps_areas() {
    for species in Species::ALL {
        let (rest, pose) = (made(species, 1, 0), made(species, 1, 2));
        let (mut area, mut kept) = (0.0, 0.0);
        let size = |points: &[[f64; 3]], f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| points[v as usize]);
            let (x, y, z) = (distance(a, b), distance(b, c), distance(c, a));
            let s = 0.5 * (x + y + z);
            (s * (s - x) * (s - y) * (s - z)).max(0.0).sqrt()
        };
        for f in &pose.faces {
            // Edges are not torn: the map from rest to pose is near-isometric edge by edge.
            for k in 0..3 {
                let (a, b) = (f[k] as usize, f[(k + 1) % 3] as usize);
                let stretch = distance(pose.vertices[a], pose.vertices[b]) / distance(pose.rest[a], pose.rest[b]);
                assert!((0.4..2.0).contains(&stretch), "{species:?}: {stretch}");
            }
            let (at_rest, posed) = (size(&pose.rest, f), size(&pose.vertices, f));
            area += at_rest;
            if (posed / at_rest - 1.0).abs() < 0.15 {
                kept += at_rest;
            }
        }
        assert!(kept > 0.85 * area, "{species:?}: {}", kept / area);
        let total = |c: &Creature| surface_area(&c.vertices, &c.faces).unwrap();
        assert!((total(&rest) / total(&pose) - 1.0).abs() < 0.03);
        // Corresponding vertices are within the spacing of each other at rest.
        let spacing = (total(&rest) / 2000.0).sqrt();
        for (v, &w) in correspondence(&rest, &pose).iter().enumerate() {
            assert!(distance(rest.rest[v], pose.rest[w as usize]) < 1.2 * spacing);
        }
    }
}

#[test]
fn geodesic_distances_survive_the_pose() {
    for species in Species::ALL {
        let rest = made(species, 1, 0);
        let rows = |creature: &Creature| -> Vec<Vec<f64>> {
            let graph = Graph::unfolded(&creature.vertices, &creature.faces).unwrap();
            let vertices: Vec<u32> = creature.landmarks.iter().map(|l| l.1).collect();
            let mut work = Dijkstra::new();
            let row = |&v: &u32| {
                let all = work.distances(&graph, &[v]);
                vertices.iter().map(|&w| all[w as usize]).collect()
            };
            vertices.iter().map(row).collect()
        };
        let expected = rows(&rest);
        for pose in 1..4 {
            let creature = made(species, 1, pose);
            let found = rows(&creature);
            assert!(found.len() >= 12);
            let (mut worst, mut sum, mut count) = (0f64, 0.0, 0);
            for i in 0..found.len() {
                for j in 0..i {
                    assert_eq!(creature.landmarks[i].0, rest.landmarks[i].0);
                    // Landmarks are vertices, off by up to a spacing at either end: nearer pairs measure that.
                    if expected[i][j] > 0.45 {
                        let off = (found[i][j] / expected[i][j] - 1.0).abs();
                        worst = worst.max(off);
                        sum += off;
                        count += 1;
                    }
                }
            }
            let mean = sum / f64::from(count);
            println!("{species:?} pose {pose}: {count} pairs, mean {mean:.3}, worst {worst:.3}");
            assert!(count > 60 && worst < 0.15 && mean < 0.055, "{species:?} pose {pose}: mean {mean} worst {worst}");
        }
    }
}

#[test]
fn poses_move_what_they_should() {
    // A pose is no rigid motion: paws change their Euclidean distances, the rest of the ground truth stays.
    let (rest, pose) = (made(Species::Cat, 1, 0), made(Species::Cat, 1, 3));
    let spread = |c: &Creature| {
        let at = |i: usize| c.vertices[c.landmarks[i].1 as usize];
        (0..c.landmarks.len())
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| distance(at(i), at(j)))
            .collect::<Vec<_>>()
    };
    let changed = spread(&rest).iter().zip(spread(&pose)).filter(|(a, b)| (*a / b - 1.0).abs() > 0.1).count();
    assert!(changed > 10, "{changed}");
}
