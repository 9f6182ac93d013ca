//! Creatures: topology, ground truth, symmetry, near-isometry of poses.

mod geom;

use geom::Random;
use salient_kernels::creature::{
    Creature, CreatureError, CreatureParams, RestSurface, Species, correspondence, generate,
    mirror_twins,
};
use salient_kernels::geodesic::{Dijkstra, Graph, Metric};
use salient_kernels::topology::{bounding_box, census, surface_area};

fn made(species: Species, seed: u64, pose: u32) -> Creature {
    generate(&CreatureParams {
        species,
        seed,
        pose,
        ..Default::default()
    })
    .unwrap()
}

#[test]
fn every_species_and_pose_is_a_well_shaped_sphere() {
    for species in Species::ALL {
        for pose in 0..6 {
            let creature = made(species, u64::from(pose) % 3, pose);
            let found = census(&creature.vertices, &creature.faces).unwrap();
            assert!(found.is_closed_manifold() && found.euler == [2]);
            let n = creature.vertices.len();
            let (mut least, mut small, mut sum) = (180f64, 0, 0.0);
            for f in &creature.faces {
                let [a, b, c] = f.map(|v| creature.vertices[v as usize]);
                for (p, q, r) in [(a, b, c), (b, c, a), (c, a, b)] {
                    let (u, w) = (
                        [0, 1, 2].map(|k| q[k] - p[k]),
                        [0, 1, 2].map(|k| r[k] - p[k]),
                    );
                    let dot = |x: [f64; 3], y: [f64; 3]| (0..3).map(|k| x[k] * y[k]).sum::<f64>();
                    let angle = (dot(u, w) / (dot(u, u) * dot(w, w)).sqrt())
                        .clamp(-1.0, 1.0)
                        .acos()
                        .to_degrees();
                    least = least.min(angle);
                    small += usize::from(angle < 25.0);
                    sum += angle;
                }
            }
            println!(
                "{species:?} pose {pose}: {n} vertices, area {:.2}, box {:?}, least angle {least:.1}, below 25: {small}, sum {sum:.0}",
                surface_area(&creature.vertices, &creature.faces).unwrap(),
                bounding_box(&creature.vertices).unwrap()
            );
        }
    }
}
