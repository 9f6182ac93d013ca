//! Patches and geodesics: many small problems on one mesh.

use crate::files;
use crate::meter::measured;
use crate::report;
use salient_kernels::disc::DiscCutter;
use salient_kernels::geodesic::{Dijkstra, Graph};
use salient_kernels::laplacian::{Area, laplacian};
use salient_kernels::patch_spectrum::{PatchOptions, patch_spectrum};
use salient_kernels::topology;
use std::collections::BTreeMap;
use std::error::Error;

use crate::mesh::Mesh;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// `count` vertices, spread over the numbering.
fn centres(n: usize, count: usize) -> impl Iterator<Item = u32> {
    (0..count).map(move |i| (i * n / count) as u32)
}

/// The radius of a flat disc with `size` of the mesh's vertices.
fn radius_of(mesh: &Mesh, size: f64) -> Result<f64> {
    let area = topology::surface_area(&mesh.vertices, &mesh.faces)?;
    Ok((size / mesh.vertices.len() as f64 * area / std::f64::consts::PI).sqrt())
}

/// Writes up to `count` discs of about `size` vertices as `OUT-i.mesh`, and the operators of their doubles as `OUT-i.operator`.
pub fn cut(path: &str, size: f64, count: usize, out: &str) -> Result<()> {
    let mesh = files::read_mesh(path)?;
    let radius = radius_of(&mesh, size)?;
    let graph = Graph::unfolded(&mesh.vertices, &mesh.faces)?;
    let mut cutter = DiscCutter::new(&mesh.vertices, &mesh.faces)?;
    let mut dijkstra = Dijkstra::new();
    let (mut sizes, mut made) = (Vec::new(), 0);
    for centre in centres(mesh.vertices.len(), count) {
        let patch = cutter.cut(centre, &dijkstra.ball(&graph, &[centre], radius), true);
        if patch.faces.is_empty() {
            continue;
        }
        let patch = Mesh { vertices: patch.vertices, faces: patch.faces };
        let double = doubled(&patch);
        let operator = laplacian(&double.vertices, &double.faces, Area::Mixed, false)?;
        files::write_mesh(&format!("{out}-{made}.mesh"), &patch)?;
        files::write_operator(&format!("{out}-{made}.operator"), &operator)?;
        sizes.push(patch.vertices.len());
        made += 1;
    }
    println!(r#"{{"count": {made}, "sizes": {sizes:?}}}"#);
    Ok(())
}

/// The patch glued to its mirror copy along its boundary, the edges with one face.
fn doubled(patch: &Mesh) -> Mesh {
    let mut faces_at = BTreeMap::new();
    for &[a, b, c] in &patch.faces {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            *faces_at.entry((p.min(q), p.max(q))).or_insert(0) += 1;
        }
    }
    let mut mirror = vec![u32::MAX; patch.vertices.len()];
    for (&(p, q), _) in faces_at.iter().filter(|e| *e.1 == 1) {
        mirror[p as usize] = p;
        mirror[q as usize] = q;
    }
    let mut vertices = patch.vertices.clone();
    for (v, image) in mirror.iter_mut().enumerate().filter(|e| *e.1 == u32::MAX) {
        *image = vertices.len() as u32;
        vertices.push(patch.vertices[v]);
    }
    let copies = patch.faces.iter().map(|&[a, b, c]| [a, c, b].map(|v| mirror[v as usize]));
    Mesh { vertices, faces: patch.faces.iter().copied().chain(copies).collect() }
}

/// The first `values` nonzero eigenvalues of every double of `STEM-0.mesh .. STEM-(count - 1).mesh`, assembly included.
pub fn patches(stem: &str, count: usize, values: usize, threads: usize, out: &str) -> Result<()> {
    let meshes: Vec<Mesh> = (0..count).map(|i| files::read_mesh(&format!("{stem}-{i}.mesh"))).collect::<Result<_>>()?;
    let (spectra, cost) = measured(|| spectra(&meshes, values, threads))?;
    files::write_floats(out, &spectra)?;
    report(&cost, "");
    Ok(())
}

/// Patches are independent of each other: thread t takes those with index t modulo the number of threads.
fn spectra(meshes: &[Mesh], values: usize, threads: usize) -> Result<Vec<f64>> {
    let one = |mesh: &Mesh| patch_spectrum(&mesh.vertices, &mesh.faces, values, &PatchOptions::default(), &());
    let share =
        |t: usize| meshes.iter().skip(t).step_by(threads.max(1)).map(one).collect::<std::result::Result<Vec<_>, _>>();
    let shares = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|t| scope.spawn(move || share(t))).collect();
        std::iter::once(share(0))
            .chain(others.into_iter().map(|o| o.join().expect("the kernel does not panic")))
            .collect::<Vec<_>>()
    });
    let shares = shares.into_iter().collect::<std::result::Result<Vec<_>, _>>()?;
    Ok((0..meshes.len()).flat_map(|i| shares[i % threads.max(1)][i / threads.max(1)].values.iter().copied()).collect())
}

/// Distances along edges from `count` vertices: to all others, or within the radius of a disc of `size` vertices if that is not 0.
pub fn geodesics(path: &str, count: usize, size: f64, out: &str) -> Result<()> {
    let mesh = files::read_mesh(path)?;
    let radius = if size > 0.0 { radius_of(&mesh, size)? } else { f64::INFINITY };
    let n = mesh.vertices.len();
    let graph = Graph::edges(&mesh.vertices, &mesh.faces)?;
    let mut dijkstra = Dijkstra::new();
    let (sums, cost) = measured(|| {
        Ok(centres(n, count)
            .map(|centre| {
                if radius == f64::INFINITY {
                    return dijkstra.distances(&graph, &[centre]).iter().sum();
                }
                dijkstra.within(&graph, &[centre], radius).iter().map(|v| v.1).sum()
            })
            .collect::<Vec<f64>>())
    })?;
    files::write_floats(out, &sums)?;
    report(&cost, &format!(r#", "radius": {}"#, if radius.is_finite() { radius } else { 0.0 }));
    Ok(())
}
