//! What the mesh loops cost: `hot_loops FILE.obj [SUBDIVISIONS]` prints nanoseconds of this thread's CPU time per vertex, beside
//! copying the mesh once. With a third word it writes the mesh for `geodesic_scipy.py` to that OFF file.
#![expect(clippy::disallowed_methods, reason = "a program, not a node")]

use salient_kernels::geodesic::{Dijkstra, Geodesics, Graph, Metric};
use salient_kernels::laplacian::{Area, laplacian};
use salient_kernels::{adjacency, simplify, topology};
use std::error::Error;
use std::fmt::Write as _;
use std::hint::black_box;

type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Positions and fan triangles.
fn read_obj(text: &str) -> Result<Mesh, Box<dyn Error>> {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let x: Vec<f64> = words.take(3).map(str::parse).collect::<Result<_, _>>()?;
                points.push([x[0], x[1], x[2]]);
            }
            Some("f") => {
                let ids = words.map(|w| w.split('/').next().unwrap_or("").parse::<u32>().map(|i| i - 1));
                let ids: Vec<u32> = ids.collect::<Result<_, _>>()?;
                faces.extend((2..ids.len()).map(|i| [ids[0], ids[i - 1], ids[i]]));
            }
            _ => {}
        }
    }
    Ok((points, faces))
}

/// Each triangle in four, new vertices moved off the middle by a fixed pattern.
fn subdivided((mut points, faces): Mesh) -> Result<Mesh, Box<dyn Error>> {
    let edges = adjacency::edges(points.len(), &faces)?;
    let base = points.len() as u32;
    for (e, &[a, b]) in edges.ends.iter().enumerate() {
        let t = 0.5 + 0.2 * ((e as f64 * 0.618).fract() - 0.5);
        let (p, q) = (points[a as usize], points[b as usize]);
        points.push([0, 1, 2].map(|k| p[k] + t * (q[k] - p[k])));
    }
    let split = |(f, &[a, b, c]): (usize, &[u32; 3])| {
        let [x, y, z] = edges.face_edges[f].map(|e| base + e);
        [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
    };
    let faces = faces.iter().enumerate().flat_map(split).collect();
    Ok((points, faces))
}

/// CPU time of this thread in nanoseconds.
fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|w| w.parse().ok()).unwrap_or(0.0)
}

/// A number that differs if any bit of the results does.
fn digest(name: &str, value: &impl std::fmt::Debug) {
    use std::hash::{DefaultHasher, Hash, Hasher};
    let mut hasher = DefaultHasher::new();
    format!("{value:?}").hash(&mut hasher);
    println!("digest of {name}: {:016x}", hasher.finish());
}

/// Prints the mean time of as many runs as fill a quarter of a second (the clock may tick in milliseconds), per vertex and per run.
fn measure<T>(name: &str, n: usize, mut run: impl FnMut() -> T) {
    black_box(run());
    let (start, mut runs) = (cpu(), 0);
    while runs < 3 || cpu() - start < 0.25e9 {
        black_box(run());
        runs += 1;
    }
    let each = (cpu() - start) / f64::from(runs);
    println!("{name:32} {:10.1} ns/vertex {:10.3} ms", each / n as f64, each * 1e-6);
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().ok_or("usage: hot_loops FILE.obj [SUBDIVISIONS] [OUT.off]")?;
    let mut mesh = read_obj(&std::fs::read_to_string(path)?)?;
    for _ in 0..arguments.get(1).map_or(Ok(0), |w| w.parse())? {
        mesh = subdivided(mesh)?;
    }
    let (points, faces) = &mesh;
    let n = points.len();
    println!("{n} vertices, {} faces", faces.len());
    if let Some(out) = arguments.get(2) {
        let mut text = format!("OFF\n{n} {} 0\n", faces.len());
        for p in points {
            writeln!(text, "{:?} {:?} {:?}", p[0], p[1], p[2])?;
        }
        for f in faces {
            writeln!(text, "3 {} {} {}", f[0], f[1], f[2])?;
        }
        std::fs::write(out, text)?;
    }
    match arguments.get(3).map(String::as_str) {
        Some("metrics") => metrics(&mesh),
        Some("digest") => digests(&mesh),
        _ => {
            loops(&mesh);
            geodesics(&mesh)
        }
    }
}

/// What must stay as it is when the loops change.
fn digests((points, faces): &Mesh) -> Result<(), Box<dyn Error>> {
    let n = points.len();
    digest("one_ring", &adjacency::one_ring(n, faces));
    digest("vertex_faces", &adjacency::vertex_faces(n, faces));
    digest("edges", &adjacency::edges(n, faces));
    digest("census", &topology::census(points, faces));
    digest("laplacian", &laplacian(points, faces, Area::Mixed, false));
    digest("laplacian, Delaunay", &laplacian(points, faces, Area::Mixed, true));
    digest("simplify", &simplify::simplify(points, faces, n / 10));
    for metric in [Metric::Edges, Metric::Unfolded] {
        digest(&format!("{metric:?}"), &Geodesics::new(points, faces, metric)?.search().distances(&[1]));
    }
    Ok(())
}

fn loops((points, faces): &Mesh) {
    let n = points.len();
    measure("copy of the mesh", n, || (points.clone(), faces.clone()));
    measure("check_mesh", n, || adjacency::check_mesh(points, faces));
    measure("one_ring", n, || adjacency::one_ring(n, faces));
    measure("vertex_faces", n, || adjacency::vertex_faces(n, faces));
    measure("edges", n, || adjacency::edges(n, faces));
    measure("components", n, || topology::components(n, faces));
    measure("census", n, || topology::census(points, faces));
    measure("weld", n, || topology::weld(points, faces));
    measure("laplacian", n, || laplacian(points, faces, Area::Mixed, false));
    measure("laplacian, intrinsic Delaunay", n, || laplacian(points, faces, Area::Mixed, true));
    if let Ok(operator) = laplacian(points, faces, Area::Mixed, false) {
        measure("components of the operator", n, || operator.stiffness.components());
        let x: Vec<f64> = (0..n).map(|i| i as f64).collect();
        measure("operator times vector", n, || operator.stiffness.multiply(&x));
    }
    measure("simplify to a tenth", n, || simplify::simplify(points, faces, n / 10));
}

fn graph_of(points: &[[f64; 3]], faces: &[[u32; 3]], metric: Metric) -> Result<Graph, adjacency::MeshError> {
    if metric == Metric::Edges { Graph::edges(points, faces) } else { Graph::unfolded(points, faces) }
}

fn geodesics((points, faces): &Mesh) -> Result<(), Box<dyn Error>> {
    let n = points.len();
    for metric in [Metric::Edges, Metric::Unfolded] {
        measure(&format!("{metric:?}: graph"), n, || graph_of(points, faces, metric));
        let graph = graph_of(points, faces, metric)?;
        let mut work = Dijkstra::new();
        let mut turn = 0u32;
        let mut source = || {
            turn = (turn + 7919) % n as u32;
            turn
        };
        measure(&format!("{metric:?}: full"), n, || work.distances(&graph, &[source()]));
        let far = work.distances(&graph, &[0]).into_iter().filter(|d| d.is_finite()).fold(0.0, f64::max);
        for share in [0.02, 0.05, 0.1, 0.2] {
            let mut reached = 0;
            let sources: Vec<u32> = (0..50).map(|_| source()).collect();
            measure(&format!("{metric:?}: 50 balls of {share}"), n, || {
                reached = sources.iter().map(|&s| work.ball(&graph, &[s], share * far).inside.len()).sum();
            });
            println!("    {} vertices each", reached / 50);
        }
    }
    Ok(())
}

/// Cost of each metric, and its deviation from the exact one within balls of a share of the extent.
fn metrics((points, faces): &Mesh) -> Result<(), Box<dyn Error>> {
    let n = points.len();
    let prepared = [Metric::Edges, Metric::Unfolded, Metric::Heat, Metric::Exact]
        .map(|metric| Geodesics::new(points, faces, metric).map(|g| (metric, g)));
    let sources: Vec<u32> = (1..=10).map(|i| (7919 * i) % n as u32).collect();
    let mut exact: Vec<Vec<f64>> = Vec::new();
    let mut far = 0.0;
    for prepared in prepared.into_iter().rev() {
        let (metric, geodesics) = prepared?;
        let mut search = geodesics.search();
        measure(&format!("{metric:?}: preparation"), n, || Geodesics::new(points, faces, metric).is_ok());
        measure(&format!("{metric:?}: full"), n, || search.distances(&sources[..1]));
        if exact.is_empty() {
            exact = sources.iter().map(|&s| search.distances(&[s])).collect();
            far = exact[0].iter().copied().filter(|d| d.is_finite()).fold(0.0, f64::max);
        }
        measure(&format!("{metric:?}: 10 balls of 0.05"), n, || {
            sources.iter().map(|&s| search.ball(&[s], 0.05 * far).inside.len()).sum::<usize>()
        });
        for (from, to) in [(0.02, 0.05), (0.05, 0.1), (0.1, 2.0)] {
            let (mut sum, mut signed, mut count) = (0.0, 0.0, 0.0);
            for (&s, exact) in sources.iter().zip(&exact) {
                for (d, e) in search.distances(&[s]).iter().zip(exact) {
                    if (from * far..to * far).contains(e) {
                        sum += (d / e - 1.0).abs();
                        signed += d / e - 1.0;
                        count += 1.0;
                    }
                }
            }
            println!("    {from} to {to}: deviation {:.4}, bias {:+.4}", sum / count, signed / count);
        }
    }
    Ok(())
}
