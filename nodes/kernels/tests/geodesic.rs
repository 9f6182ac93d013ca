//! Graph geodesics against analytic distances on plane, sphere and cylinder, and against the laws of a metric.
#![allow(clippy::unwrap_used)] // Helpers of tests fail by panicking, as tests do.
#![allow(clippy::float_cmp)] // Values taken over unchanged are compared as such.

mod geom;

use geom::{Mesh, cylinder, plane, relative_errors, sorted, sphere, within};
use salient_kernels::geodesic::{Dijkstra, Graph, Metric};
use std::f64::consts::{PI, TAU};

fn graph((vertices, faces): &Mesh, metric: Metric) -> Graph {
    if metric == Metric::Edges { Graph::edges(vertices, faces) } else { Graph::unfolded(vertices, faces) }.unwrap()
}

/// Mean and greatest relative excess of graph distances from a few sources over exact ones, beyond `near`.
fn excess(mesh: &Mesh, metric: Metric, near: f64, exact: impl Fn([f64; 3], [f64; 3]) -> f64) -> (f64, f64) {
    let graph = graph(mesh, metric);
    let mut work = Dijkstra::new();
    let errors = relative_errors(&mesh.0, near, exact, |source| work.distances(&graph, &[source]));
    (errors.iter().sum::<f64>() / errors.len() as f64, errors.iter().copied().fold(0.0, f64::max))
}

#[track_caller]
fn check_bands(name: &str, edges: (f64, f64), unfolded: (f64, f64)) {
    println!(
        "{name}: edges mean {:.4} max {:.4}, unfolded mean {:.4} max {:.4}",
        edges.0, edges.1, unfolded.0, unfolded.1
    );
    assert!((0.03..0.12).contains(&edges.0), "{name} edges {edges:?}");
    assert!((0.005..0.05).contains(&unfolded.0), "{name} unfolded {unfolded:?}");
    assert!(edges.1 < 0.3 && unfolded.1 < 0.12, "{name} {edges:?} {unfolded:?}");
    assert!(unfolded.0 < 0.6 * edges.0, "{name}");
}

#[test]
fn plane_distances_are_within_their_bands() {
    let mesh = plane(40, 0.25);
    let exact = |p: [f64; 3], q: [f64; 3]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let [edges, unfolded] = [Metric::Edges, Metric::Unfolded].map(|m| excess(&mesh, m, 0.3, exact));
    check_bands("plane", edges, unfolded);
}

#[test]
fn sphere_distances_are_within_their_bands() {
    let mesh = sphere(4);
    let exact = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| p[k] * q[k]).sum::<f64>().clamp(-1.0, 1.0).acos();
    let [edges, unfolded] = [Metric::Edges, Metric::Unfolded].map(|m| excess(&mesh, m, 0.3, exact));
    check_bands("sphere", edges, unfolded);
}

#[test]
fn cylinder_distances_are_within_their_bands() {
    let mesh = cylinder(60, 60, 5.0, 0.2);
    let exact = |p: [f64; 3], q: [f64; 3]| {
        let turn = (p[1].atan2(p[0]) - q[1].atan2(q[0])).rem_euclid(TAU);
        turn.min(TAU - turn).hypot(p[2] - q[2])
    };
    let [edges, unfolded] = [Metric::Edges, Metric::Unfolded].map(|m| excess(&mesh, m, 0.4, exact));
    check_bands("cylinder", edges, unfolded);
}

#[test]
fn never_shorter_than_exact_on_a_plane() {
    let mesh = plane(23, 0.45);
    for metric in [Metric::Edges, Metric::Unfolded] {
        let graph = graph(&mesh, metric);
        for source in [0, 100, 333] {
            let found = Dijkstra::new().distances(&graph, &[source]);
            for (v, d) in found.iter().enumerate() {
                let (p, q) = (mesh.0[source as usize], mesh.0[v]);
                assert!(*d >= (p[0] - q[0]).hypot(p[1] - q[1]) - 1e-12);
            }
        }
    }
}

#[test]
fn distances_are_a_metric() {
    let mesh = sphere(3);
    for metric in [Metric::Edges, Metric::Unfolded] {
        let graph = graph(&mesh, metric);
        let mut work = Dijkstra::new();
        let sources: Vec<u32> = (0..40).map(|i| i * 16).collect();
        let rows: Vec<Vec<f64>> = sources.iter().map(|&s| work.distances(&graph, &[s])).collect();
        for (i, &a) in sources.iter().enumerate() {
            assert_eq!(rows[i][a as usize], 0.0);
            for (j, &b) in sources.iter().enumerate() {
                assert!((rows[i][b as usize] - rows[j][a as usize]).abs() < 1e-12);
                for &c in &sources {
                    assert!(rows[i][c as usize] <= rows[i][b as usize] + rows[j][c as usize] + 1e-12);
                }
            }
        }
    }
}

/// Bellman-Ford relaxation to the fixed point: another algorithm for the same numbers.
fn relaxed(graph: &Graph, sources: &[u32]) -> Vec<f64> {
    let mut d = vec![f64::INFINITY; graph.len()];
    for &s in sources {
        d[s as usize] = 0.0;
    }
    let mut changed = true;
    while changed {
        changed = false;
        for v in 0..graph.len() as u32 {
            for (w, length) in graph.neighbours(v) {
                if d[w as usize] + length < d[v as usize] {
                    d[v as usize] = d[w as usize] + length;
                    changed = true;
                }
            }
        }
    }
    d
}

#[test]
fn several_sources_and_relaxation_agree() {
    let mesh = plane(20, 0.3);
    for metric in [Metric::Edges, Metric::Unfolded] {
        let graph = graph(&mesh, metric);
        let found = Dijkstra::new().distances(&graph, &[3, 200, 3, 9999]);
        assert_eq!(found, relaxed(&graph, &[3, 200]));
    }
}

#[test]
fn a_ball_is_the_full_search_restricted() {
    let mesh = cylinder(30, 30, 4.0, 0.2);
    let graph = graph(&mesh, Metric::Unfolded);
    let mut work = Dijkstra::new();
    for (source, radius) in [(0u32, 0.5), (400, 1.3), (777, 0.0), (20, 1e9), (5, -1.0), (5, f64::NAN)] {
        let full = Dijkstra::new().distances(&graph, &[source]);
        let ball = work.ball(&graph, &[source], radius);
        assert_eq!(sorted(ball.inside), within(&full, radius));
        // The rim is right as well, and holds every neighbour of an inside vertex.
        assert!(ball.rim.iter().all(|&(v, d)| full[v as usize] == d && d > radius));
        for &(v, _) in ball.inside {
            for (w, _) in graph.neighbours(v) {
                assert!(full[w as usize] <= radius || ball.rim.iter().any(|r| r.0 == w));
            }
        }
        if radius < 2.0 {
            assert!(ball.inside.len() + ball.rim.len() < mesh.0.len() * 3 / 4);
        }
    }
}

#[test]
fn shortcuts_cross_the_shared_edge_only() {
    // Two unit right triangles: the unfolded diagonal is sqrt 2. Folding about the shared edge does not change it.
    let faces = vec![[0, 1, 2], [0, 2, 3]];
    let square = |z: f64, x: f64| vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [x, 1.0 - x, z]];
    for d in [square(0.0, 0.0), square(0.5f64.sqrt(), 0.5)] {
        let found = Dijkstra::new().distances(&graph(&(d, faces.clone()), Metric::Unfolded), &[1]);
        assert!((found[3] - 2f64.sqrt()).abs() < 1e-12, "{}", found[3]);
    }
    // A dart: the straight segment between the far corners leaves the surface, so only edges remain.
    let dart = vec![[0.0, 0.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 3.0, 0.0], [1.0, -1.0, 0.0]];
    let found = Dijkstra::new().distances(&graph(&(dart, vec![[0, 2, 1], [0, 3, 2]]), Metric::Unfolded), &[1]);
    assert!((found[3] - 2.0 * 2f64.sqrt()).abs() < 1e-12);
}

#[test]
fn apart_and_refused() {
    let two = (vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0; 3]], vec![[0, 1, 2]]);
    let found = Dijkstra::new().distances(&graph(&two, Metric::Edges), &[0]);
    assert!(found[3].is_infinite());
    assert!(Graph::edges(&[[f64::NAN; 3]], &[]).is_err());
    assert!(Graph::edges(&[[0.0; 3]], &[[0, 0, 1]]).is_err());
    // A sphere of radius R at R pi: antipodes.
    let mesh = sphere(3);
    let farthest = Dijkstra::new().distances(&graph(&mesh, Metric::Unfolded), &[0]).into_iter().fold(0.0, f64::max);
    assert!(farthest > 0.99 * PI && farthest < 1.12 * PI);
}
