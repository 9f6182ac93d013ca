//! All metrics against analytic distances, against each other, and the exact one against independent constructions.
#![allow(clippy::unwrap_used)] // Helpers of tests fail by panicking, as tests do.

mod geom;

use geom::{Mesh, Random, cylinder, permuted, plane, relative_errors, sorted, sphere, torus, within};
use salient_kernels::adjacency;
use salient_kernels::geodesic::{Geodesics, Graph, Metric};
use std::f64::consts::TAU;

const METRICS: [Metric; 4] = [Metric::Edges, Metric::Unfolded, Metric::Heat, Metric::Exact];

fn prepare((vertices, faces): &Mesh, metric: Metric) -> Geodesics {
    Geodesics::new(vertices, faces, metric).unwrap()
}

fn distances(mesh: &Mesh, metric: Metric, sources: &[u32]) -> Vec<f64> {
    prepare(mesh, metric).search().distances(sources)
}

/// Mean and greatest relative deviation |d / exact - 1| from twelve sources, beyond `near`.
fn deviation(mesh: &Mesh, metric: Metric, near: f64, exact: impl Fn([f64; 3], [f64; 3]) -> f64) -> (f64, f64) {
    let geodesics = prepare(mesh, metric);
    let mut search = geodesics.search();
    let errors = relative_errors(&mesh.0, near, exact, |source| search.distances(&[source]));
    let sum: f64 = errors.iter().map(|e| e.abs()).sum();
    (sum / errors.len() as f64, errors.iter().fold(0.0, |most, e| e.abs().max(most)))
}

/// The stated bounds of mean and greatest deviation, in the order of [`METRICS`].
#[track_caller]
fn check(
    name: &str,
    mesh: &Mesh,
    near: f64,
    exact: impl Fn([f64; 3], [f64; 3]) -> f64 + Copy,
    bounds: [(f64, f64); 4],
) {
    let found = METRICS.map(|metric| deviation(mesh, metric, near, exact));
    println!("{name}: {}", found.map(|(mean, most)| format!("{mean:.2e} ({most:.2e})")).join("  "));
    for ((metric, found), bound) in METRICS.into_iter().zip(found).zip(bounds) {
        assert!(found.0 < bound.0 && found.1 < bound.1, "{name} {metric:?} {found:?}");
    }
}

fn flat(p: [f64; 3], q: [f64; 3]) -> f64 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

#[test]
fn planes() {
    for (n, jitter) in [(40, 0.0), (40, 0.15), (40, 0.25)] {
        let bounds = [(0.12, 0.3), (0.045, 0.11), (0.012, 0.1), (1e-12, 1e-12)];
        check(&format!("plane {jitter}"), &plane(n, jitter), 0.3, flat, bounds);
    }
}

#[test]
fn spheres() {
    let exact = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| p[k] * q[k]).sum::<f64>().clamp(-1.0, 1.0).acos();
    check("sphere", &sphere(4), 0.3, exact, [(0.08, 0.2), (0.02, 0.05), (0.005, 0.03), (1e-3, 1e-3)]);
}

#[test]
fn cylinders() {
    // On the polyhedron itself: the prism over a regular polygon, or nearly, as rows are shifted.
    let exact = |p: [f64; 3], q: [f64; 3]| {
        let turn = (p[1].atan2(p[0]) - q[1].atan2(q[0])).rem_euclid(TAU);
        turn.min(TAU - turn).hypot(p[2] - q[2])
    };
    check(
        "cylinder",
        &cylinder(40, 32, 4.0, 0.2),
        0.4,
        exact,
        [(0.08, 0.22), (0.02, 0.09), (0.01, 0.05), (1e-3, 2e-3)],
    );
}

#[test]
fn exact_below_unfolded_below_edges() {
    for mesh in [plane(20, 0.4), sphere(3), torus(30, 12), cylinder(20, 20, 4.0, 0.3)] {
        for source in [0, 57, 200] {
            let [edges, unfolded, exact] =
                [Metric::Edges, Metric::Unfolded, Metric::Exact].map(|metric| distances(&mesh, metric, &[source]));
            for v in 0..mesh.0.len() {
                assert!(unfolded[v] <= edges[v]);
                assert!(exact[v] <= unfolded[v] * (1.0 + 1e-12));
            }
        }
    }
}

/// A rough closed surface: a sphere whose vertices are moved in and out, saddles everywhere.
fn rough(levels: usize, height: f64) -> Mesh {
    let (mut vertices, faces) = sphere(levels);
    let mut random = Random(5);
    for p in &mut vertices {
        let r = 1.0 + height * (2.0 * random.next() - 1.0);
        *p = p.map(|x| r * x);
    }
    (vertices, faces)
}

#[test]
fn exact_is_symmetric_and_a_metric() {
    for mesh in [rough(3, 0.15), torus(24, 10), cylinder(20, 20, 4.0, 0.3)] {
        let sources: Vec<u32> = (0..24).map(|i| i * 9).collect();
        let rows = prepare(&mesh, Metric::Exact).search().between(&sources, &sources);
        for (i, row) in rows.iter().enumerate() {
            assert!(row[i] == 0.0);
            for j in 0..rows.len() {
                assert!((row[j] - rows[j][i]).abs() <= 1e-10, "{} {}", row[j], rows[j][i]);
                for other in &rows {
                    assert!(row[j] <= other[i] + other[j] + 1e-10);
                }
            }
        }
    }
}

/// Dijkstra over points placed along every edge, all points of a face joined by straight lines: another way to the same
/// distances, from above, with an error that falls with the number of points.
fn steiner(mesh: &Mesh, points: usize, source: u32) -> Vec<f64> {
    let (vertices, faces) = mesh;
    let edges = adjacency::edges(vertices.len(), faces).unwrap();
    let n = vertices.len();
    let mut place = vertices.clone();
    for &[a, b] in &edges.ends {
        for k in 1..=points {
            let t = k as f64 / (points + 1) as f64;
            let (p, q) = (vertices[a as usize], vertices[b as usize]);
            place.push([0, 1, 2].map(|x| p[x] + t * (q[x] - p[x])));
        }
    }
    let mut links: Vec<Vec<(usize, f64)>> = vec![Vec::new(); place.len()];
    for (f, corners) in faces.iter().enumerate() {
        let mut on: Vec<usize> = corners.iter().map(|&v| v as usize).collect();
        for &e in &edges.face_edges[f] {
            on.extend((0..points).map(|k| n + e as usize * points + k));
        }
        for &i in &on {
            for &j in on.iter().filter(|&&j| j != i) {
                let d = (0..3).map(|x| (place[i][x] - place[j][x]).powi(2)).sum::<f64>().sqrt();
                links[i].push((j, d));
            }
        }
    }
    let mut d = vec![f64::INFINITY; place.len()];
    let mut heap = std::collections::BTreeSet::from([(0u64, source as usize)]);
    d[source as usize] = 0.0;
    while let Some((key, i)) = heap.pop_first() {
        if f64::from_bits(key) > d[i] {
            continue;
        }
        for &(j, length) in &links[i] {
            if d[i] + length < d[j] {
                d[j] = d[i] + length;
                heap.insert((d[j].to_bits(), j));
            }
        }
    }
    d.truncate(n);
    d
}

#[test]
fn exact_agrees_with_dense_edge_points() {
    // Rough surfaces, boundaries with corners, thin triangles: graph paths converge to the exact ones from above.
    let mut ragged = plane(8, 0.45);
    ragged.1.retain(|f| f.iter().map(|v| v % 7).sum::<u32>() % 5 != 0);
    ragged.0.iter_mut().for_each(|p| p[2] = 0.4 * (5.0 * p[0]).sin());
    let mut thin = rough(2, 0.2);
    thin.0.iter_mut().for_each(|p| p[2] *= 0.02);
    for (name, mesh) in [("rough", rough(2, 0.2)), ("ragged", ragged), ("thin", thin), ("torus", torus(12, 6))] {
        for source in [0, 11, 40] {
            let exact = distances(&mesh, Metric::Exact, &[source]);
            let worst = [6, 24].map(|points| {
                let above = steiner(&mesh, points, source);
                let mut worst = 0f64;
                for (v, (d, a)) in exact.iter().zip(&above).enumerate() {
                    assert!(d.is_finite() == a.is_finite());
                    if d.is_finite() && v != source as usize {
                        assert!(*d <= a * (1.0 + 1e-10), "{name} {source} {v}: {d} {a}");
                        worst = worst.max(a / d - 1.0);
                    }
                }
                worst
            });
            println!("{name} {source}: {worst:?}");
            assert!(worst[1] < 5e-3 && worst[1] < 0.3 * worst[0] + 1e-9, "{name} {worst:?}");
        }
    }
}

#[test]
fn known_polyhedra() {
    // Regular tetrahedron of edge 1, subdivided in place so that edge middles are vertices: opposite middles are 1 apart.
    let s = 8f64.sqrt();
    let tetrahedron = (
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
            .iter()
            .map(|p| p.map(|x| x / s))
            .collect(),
        vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
    );
    let split = quartered(&tetrahedron);
    let at = |p: [f64; 3]| nearest(&split, p);
    let middle = |a: usize, b: usize| [0, 1, 2].map(|k| f64::midpoint(split.0[a][k], split.0[b][k]));
    let d = distances(&split, Metric::Exact, &[at(middle(0, 1))]);
    assert!((d[at(middle(2, 3)) as usize] - 1.0).abs() < 1e-12);
    assert!((d[2] - 0.75f64.sqrt()).abs() < 1e-12);
    // The unit cube: opposite corners are sqrt 5 apart, face centres opposite to each other 2.
    let cube = cube();
    let fine = quartered(&quartered(&cube));
    for mesh in [&cube, &fine] {
        let d = distances(mesh, Metric::Exact, &[nearest(mesh, [0.0; 3])]);
        let to = |p: [f64; 3]| d[nearest(mesh, p) as usize];
        assert!((to([1.0; 3]) - 5f64.sqrt()).abs() < 1e-12, "{}", to([1.0; 3]));
        assert!((to([1.0, 1.0, 0.0]) - 2f64.sqrt()).abs() < 1e-12);
        assert!((to([1.0, 0.0, 0.0]) - 1.0).abs() < 1e-12);
    }
    let d = distances(&fine, Metric::Exact, &[nearest(&fine, [0.5, 0.5, 0.0])]);
    assert!((d[nearest(&fine, [0.5, 0.5, 1.0]) as usize] - 2.0).abs() < 1e-12);
    // From a face's centre to a corner of the opposite face: unfolded over one side, or over an adjacent edge pair.
    let corner = d[nearest(&fine, [1.0; 3]) as usize];
    assert!((corner - (1.5f64 * 1.5 + 0.5 * 0.5).sqrt()).abs() < 1e-12, "{corner}");
}

fn cube() -> Mesh {
    let vertices = (0..8).map(|i| [0, 1, 2].map(|k| f64::from(i >> k & 1))).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (vertices, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

fn quartered((vertices, faces): &Mesh) -> Mesh {
    let edges = adjacency::edges(vertices.len(), faces).unwrap();
    let mut points = vertices.clone();
    points.extend(edges.ends.iter().map(|&[a, b]| {
        let (p, q) = (vertices[a as usize], vertices[b as usize]);
        [0, 1, 2].map(|k| f64::midpoint(p[k], q[k]))
    }));
    let split = |f: usize| {
        let [a, b, c] = faces[f];
        let [x, y, z] = edges.face_edges[f].map(|e| vertices.len() as u32 + e);
        [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
    };
    (points, (0..faces.len()).flat_map(split).collect())
}

fn nearest(mesh: &Mesh, p: [f64; 3]) -> u32 {
    let d2 = |q: &[f64; 3]| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>();
    (0..mesh.0.len()).min_by(|&a, &b| d2(&mesh.0[a]).total_cmp(&d2(&mesh.0[b]))).unwrap() as u32
}

/// A cone surface about one vertex: `wedges` right isosceles triangles of leg 1, laid so that edge lengths hold; its rings are
/// finer triangles. Angle `wedges` quarter turns: a corner of a cube for 3, a saddle for 5 and more.
fn wedges(wedges: usize, fine: usize) -> Mesh {
    // Alternate spokes up and down: unit spokes with right angles between neighbours exist in space for an even number of
    // wedges only as zigzags; the angle between (c, s, h) and (c, s, -h) at spacing t is cos = (1 - h^2) cos t - h^2 = 0.
    let t = TAU / wedges as f64;
    let h2 = t.cos() / (1.0 + t.cos());
    let (h, r) = (h2.max(0.0).sqrt(), (1.0 - h2).sqrt());
    let spoke = |i: usize| {
        let angle = t * i as f64;
        [r * angle.cos(), r * angle.sin(), if i.is_multiple_of(2) { h } else { -h }]
    };
    let mut mesh: Mesh = (vec![[0.0; 3]], Vec::new());
    mesh.0.extend((0..wedges).map(spoke));
    mesh.1.extend((0..wedges as u32).map(|i| [0, 1 + i, 1 + (i + 1) % wedges as u32]));
    for _ in 0..fine {
        mesh = quartered(&mesh);
    }
    mesh
}

#[test]
fn paths_bend_at_a_saddle() {
    // Eight right angles about a vertex: whatever is more than half a turn apart is joined through the vertex.
    let mesh = wedges(8, 3);
    let polar = |p: [f64; 3]| -> (f64, f64) {
        // The wedge of a point, and its angle in it, by its distances from the two spokes' ends.
        let r = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        let spokes: Vec<f64> =
            (1..9).map(|i| (0..3).map(|k| p[k] * mesh.0[i][k]).sum::<f64>() / r.max(1e-300)).collect();
        let best = (0..8)
            .find(|&i| {
                let (a, b) = (spokes[i], spokes[(i + 1) % 8]);
                (a * a + b * b - 1.0).abs() < 1e-9 && a > -1e-9 && b > -1e-9
            })
            .unwrap();
        (r, TAU / 4.0 * best as f64 + spokes[(best + 1) % 8].atan2(spokes[best]))
    };
    let at: Vec<(f64, f64)> = mesh.0.iter().map(|&p| if p == [0.0; 3] { (0.0, 0.0) } else { polar(p) }).collect();
    let mut bent = 0;
    for source in (0..mesh.0.len()).step_by(7) {
        let found = distances(&mesh, Metric::Exact, &[source as u32]);
        for (v, d) in found.iter().enumerate() {
            let ((r, a), (s, b)) = (at[source], at[v]);
            let turn = (a - b).abs().min(2.0 * TAU - (a - b).abs());
            let straight = (r * r + s * s - 2.0 * r * s * turn.cos()).max(0.0).sqrt();
            if turn >= TAU / 2.0 && r > 0.0 && s > 0.0 {
                bent += 1;
                assert!((d - (r + s)).abs() < 1e-12, "{d} {}", r + s);
            } else if r < 0.3 && s < 0.3 {
                // The surface ends in straight sides between unit spokes: about the middle nothing of it is missing.
                assert!((d - straight).abs() < 1e-7, "{d} {straight}");
            }
        }
    }
    assert!(bent > 1000);
}

#[test]
fn paths_bend_at_boundaries() {
    // A square with a slit-like hole: across it paths go around the corners of the hole.
    let (vertices, mut faces) = plane(20, 0.0);
    let middle = |f: &[u32; 3]| [0, 1].map(|k| f.iter().map(|&v| vertices[v as usize][k]).sum::<f64>() / 3.0);
    faces.retain(|f| {
        let [x, y] = middle(f);
        !(x.abs() < 0.1 && y.abs() < 0.5)
    });
    let mesh = (vertices, faces);
    let d = distances(&mesh, Metric::Exact, &[nearest(&mesh, [-0.6, 0.0, 0.0])]);
    let around = 2.0 * 0.5f64.hypot(0.5) + 0.2;
    assert!((d[nearest(&mesh, [0.6, 0.0, 0.0]) as usize] - around).abs() < 1e-12);
}

#[test]
fn renumbering_changes_nothing() {
    for mesh in [rough(3, 0.1), plane(16, 0.3)] {
        for (metric, tolerance) in METRICS.into_iter().zip([1e-14, 1e-14, 1e-7, 1e-11]) {
            let found = distances(&mesh, metric, &[33]);
            let (other, new_of) = permuted(&mesh, 4);
            let again = distances(&other, metric, &[new_of[33]]);
            for (v, d) in found.iter().enumerate() {
                let e = again[new_of[v] as usize];
                assert!((d - e).abs() <= tolerance, "{metric:?} {d} {e}");
            }
        }
    }
}

#[test]
fn queries_agree_and_repeat_to_the_last_bit() {
    let mesh = rough(3, 0.1);
    let targets: Vec<u32> = (0..40).map(|i| i * 16).collect();
    for metric in METRICS {
        let geodesics = prepare(&mesh, metric);
        let mut search = geodesics.search();
        let full = search.distances(&[77]);
        for radius in [0.3, 0.8, 9.0, -1.0, f64::NAN] {
            let ball = search.ball(&[77], radius);
            assert_eq!(sorted(ball.inside), within(&full, radius), "{metric:?}");
            assert!(ball.rim.iter().all(|&(v, d)| d > radius && full[v as usize] == d) || radius.is_nan());
            let graph = Graph::edges(&mesh.0, &mesh.1).unwrap();
            let known = |w: u32| ball.inside.iter().chain(ball.rim).any(|e| e.0 == w);
            assert!(ball.inside.iter().all(|e| graph.neighbours(e.0).all(|(w, _)| known(w))));
        }
        assert_eq!(search.distances(&[77]), full);
        let rows = search.between(&[77, 5], &targets);
        for (&t, d) in targets.iter().zip(&rows[0]) {
            let tolerance = if metric == Metric::Heat { 1e-10 } else { 0.0 };
            assert!((d - full[t as usize]).abs() <= tolerance, "{metric:?}");
        }
        let both = search.distances(&[77, 5]);
        let five = search.distances(&[5]);
        if metric != Metric::Heat {
            assert!((0..full.len()).all(|v| (both[v] - full[v].min(five[v])).abs() <= 1e-12));
        }
    }
}

#[test]
fn parts_out_of_reach_and_non_manifolds() {
    let (mut vertices, mut faces) = sphere(2);
    let n = vertices.len() as u32;
    let (more, more_faces) = sphere(1);
    vertices.extend(more.iter().map(|p| [p[0] + 5.0, p[1], p[2]]));
    faces.extend(more_faces.iter().map(|f| f.map(|v| v + n)));
    vertices.push([9.0; 3]);
    let mesh = (vertices, faces);
    for metric in METRICS {
        let d = distances(&mesh, metric, &[3, 99_999]);
        assert!(d.iter().enumerate().all(|(v, d)| d.is_finite() == (v < n as usize)), "{metric:?}");
        let none = distances(&mesh, metric, &[]);
        assert!(none.iter().all(|d| d.is_infinite()));
    }
    // Three half planes at one edge line: between any two of them distances are those of a plane.
    let (mut vertices, mut faces) = plane(8, 0.0);
    let shared: Vec<u32> = (0..9).map(|j| j * 9 + 4).collect();
    let mut new_of = vec![0; vertices.len()];
    for v in 0..81u32 {
        let p = vertices[v as usize];
        new_of[v as usize] = if shared.contains(&v) {
            v
        } else {
            vertices.push([0.0, p[1], p[0]]);
            vertices.len() as u32 - 1
        };
    }
    let fin: Vec<[u32; 3]> = faces
        .iter()
        .filter(|f| f.iter().all(|&v| vertices[v as usize][0] >= 0.0))
        .map(|f| f.map(|v| new_of[v as usize]))
        .collect();
    faces.extend(fin);
    let mesh = (vertices, faces);
    let source = nearest(&mesh, [-0.75, -0.5, 0.0]);
    let d = distances(&mesh, Metric::Exact, &[source]);
    for (p, x) in [([0.5, 0.75, 0.0], 0.5), ([0.0, 0.75, 0.5], 0.5), ([0.0, 0.25, 0.75], 0.75)] {
        let expected = f64::hypot(x + 0.75, p[1] + 0.5);
        let found = d[nearest(&mesh, p) as usize];
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}
