//! What follows the eigenpairs: maxima, geodesics, patches and their spectra, matching; and decimation. `cargo bench --bench stages [FILTER]`.

mod shapes;

use divan::{Bencher, black_box};
use salient_kernels::assignment::{Control, Limits, Problem, ProblemBuilder, solve};
use salient_kernels::disc::DiscCutter;
use salient_kernels::geodesic::{Dijkstra, Geodesics, Graph, Metric};
use salient_kernels::patch_spectrum::{PatchOptions, patch_spectrum};
use salient_kernels::random::Random;
use salient_kernels::simplify::simplify;
use salient_nodes::maxima::{Maxima, Params};
use salient_nodes::reconstruction_energy::Energy;
use salient_sdk::testing::TestHost;
use salient_sdk::{Mesh as SdkMesh, PortValues};
use shapes::{Mesh, refined};
use std::sync::Arc;

fn main() {
    divan::main();
}

/// The disc of about `size` vertices about vertex 0.
fn patch(mesh: &Mesh, size: usize) -> Mesh {
    let area: f64 = shapes::operator(mesh).area();
    let radius = (size as f64 / mesh.vertices.len() as f64 * area / std::f64::consts::PI).sqrt();
    let graph = Graph::unfolded(&mesh.vertices, &mesh.faces).expect("a valid mesh");
    let mut cutter = DiscCutter::new(&mesh.vertices, &mesh.faces).expect("a valid mesh");
    let mut dijkstra = Dijkstra::new();
    let patch = cutter.cut(0, &dijkstra.ball(&graph, &[0], radius), true);
    Mesh { vertices: patch.vertices, faces: patch.faces }
}

#[divan::bench(args = [100, 200, 500, 1000, 2000], sample_count = 10)]
fn patch_spectrum_21(bencher: Bencher, size: usize) {
    let patch = patch(&refined("43k"), size);
    let options = PatchOptions::default();
    bencher.bench(|| patch_spectrum(black_box(&patch.vertices), &patch.faces, 21, &options, &()).expect("a spectrum"));
}

#[divan::bench(args = [Metric::Edges, Metric::Unfolded, Metric::Heat, Metric::Exact], sample_count = 10)]
fn geodesics_prepared(bencher: Bencher, metric: Metric) {
    let mesh = refined("43k");
    bencher.bench(|| Geodesics::new(black_box(&mesh.vertices), &mesh.faces, metric));
}

#[divan::bench(args = ["10k", "43k", "173k"], sample_count = 10)]
fn dijkstra_full(bencher: Bencher, size: &str) {
    let mesh = refined(size);
    let graph = Graph::edges(&mesh.vertices, &mesh.faces).expect("a valid mesh");
    let mut dijkstra = Dijkstra::new();
    bencher.bench_local(|| dijkstra.distances(black_box(&graph), &[0]));
}

/// A disc of about 400 vertices.
#[divan::bench(args = ["10k", "43k", "173k"])]
fn dijkstra_limited(bencher: Bencher, size: &str) {
    let mesh = refined(size);
    let graph = Graph::edges(&mesh.vertices, &mesh.faces).expect("a valid mesh");
    let area = shapes::operator(&mesh).area();
    let radius = (400.0 / mesh.vertices.len() as f64 * area / std::f64::consts::PI).sqrt();
    let mut dijkstra = Dijkstra::new();
    bencher.bench_local(|| dijkstra.ball(black_box(&graph), &[0], radius).inside.len());
}

/// 100 scales of random energies: as many comparisons fail at once as on real ones.
#[divan::bench(args = ["1k", "10k"], sample_count = 10)]
fn maxima(bencher: Bencher, size: &str) {
    let shape = refined(size);
    let (n, scales) = (shape.vertices.len(), 100);
    let mut random = Random::from_state(1);
    let energy = Arc::new(Energy {
        first: (1..=scales as u32).collect(),
        lambda: (1..=scales).map(|k| k as f64).collect(),
        values: (0..n * scales).map(|_| random.unit()).collect(),
        vertices: n,
    });
    let mesh = Arc::new(SdkMesh { vertices: shape.vertices, faces: shape.faces, ..SdkMesh::default() });
    let wired = || {
        let mut wired = PortValues::default();
        wired.push("mesh", "", mesh.clone());
        wired.push("energy", "", energy.clone());
        wired
    };
    let params = Params::default();
    bencher.bench_local(|| TestHost::default().run_wired::<Maxima>(&params, wired()).expect("maxima"));
}

/// Down to 1,500 vertices, as in the paper.
#[divan::bench(args = ["5k", "10k", "43k"], sample_count = 3)]
fn decimation(bencher: Bencher, size: &str) {
    let mesh = refined(size);
    bencher.bench(|| simplify(black_box(&mesh.vertices), &mesh.faces, 1500).expect("a valid mesh"));
}

/// `n` features in the unit square and the same with noise; `width` candidates each, the true one among them; pairs that keep their distance score.
fn planar(n: usize, width: usize) -> Problem {
    let mut random = Random::from_state(1);
    let left: Vec<[f64; 2]> = (0..n).map(|_| [random.unit(), random.unit()]).collect();
    let right: Vec<[f64; 2]> = left.iter().map(|p| p.map(|x| x + 0.05 * random.signed())).collect();
    let distance = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let mut builder = ProblemBuilder::new(n, n);
    let mut candidates = Vec::new();
    for i in 0..n {
        for step in 0..width {
            let j = (i + step * 7) % n;
            builder.candidate(i, j, 0.5 + 0.1 * random.unit()).expect("a new candidate");
            candidates.push((i, j));
        }
    }
    for (a, &(i, j)) in candidates.iter().enumerate() {
        for (b, &(k, l)) in candidates.iter().enumerate().skip(a + 1).filter(|(_, c)| c.0 != i && c.1 != j) {
            let error = distance(left[i], left[k]) - distance(right[j], right[l]);
            builder.pair(a, b, (-error * error / 0.02).exp()).expect("a new pair");
        }
    }
    builder.build().expect("a problem")
}

#[divan::bench(args = [15, 30, 50], sample_count = 3)]
fn assignment(bencher: Bencher, features: usize) {
    let problem = planar(features, 5);
    let limits = Limits { node_limit: 20, ..Limits::default() };
    bencher.bench_local(|| solve(black_box(&problem), &limits, &Control::default()).expect("a solution"));
}
