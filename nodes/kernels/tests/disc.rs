//! Geodesic discs against analytic areas and against the laws of a surface.
#![allow(clippy::unwrap_used)] // Helpers of tests fail by panicking, as tests do.
#![allow(clippy::float_cmp)] // Values taken over unchanged are compared as such.

mod geom;

use geom::{Mesh, cylinder, permuted, plane, sphere, torus};
use salient_kernels::disc::{CUT, DiscCutter, Patch, PatchKind};
use salient_kernels::geodesic::{Ball, Dijkstra, Graph};
use salient_kernels::topology::{census, surface_area};
use std::f64::consts::PI;

/// A disc by graph distances.
fn disc(mesh: &Mesh, center: u32, radius: f64, clip: bool) -> Patch {
    let graph = Graph::unfolded(&mesh.0, &mesh.1).unwrap();
    let mut work = Dijkstra::new();
    let patch = DiscCutter::new(&mesh.0, &mesh.1).unwrap().cut(center, &work.ball(&graph, &[center], radius), clip);
    check(mesh, &patch, radius);
    patch
}

/// A disc by exact distances, so that only the cutting is measured.
fn exact_disc(mesh: &Mesh, center: u32, radius: f64, clip: bool, exact: impl Fn([f64; 3], [f64; 3]) -> f64) -> Patch {
    let c = mesh.0[center as usize];
    let mut all: Vec<(u32, f64)> = (0u32..).zip(mesh.0.iter().map(|&p| exact(c, p))).collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (inside, rim): (Vec<_>, Vec<_>) = all.into_iter().partition(|&(_, d)| d <= radius);
    let ball = Ball { radius, inside: &inside, rim: &rim };
    let patch = DiscCutter::new(&mesh.0, &mesh.1).unwrap().cut(center, &ball, clip);
    check(mesh, &patch, radius);
    patch
}

/// What holds for every patch: a connected oriented manifold that agrees with its own description.
fn check(mesh: &Mesh, patch: &Patch, radius: f64) {
    if patch.faces.is_empty() {
        assert_eq!(patch.kind, PatchKind::TooSmall);
        return;
    }
    let found = census(&patch.vertices, &patch.faces).unwrap();
    assert!(found.non_manifold_edges.is_empty() && found.non_manifold_vertices.is_empty());
    assert!(found.inconsistent_edges.is_empty() && found.unreferenced_vertices.is_empty());
    assert_eq!((found.euler.as_slice(), found.boundary_loops), (&[patch.euler][..], patch.loops));
    let area = surface_area(&patch.vertices, &patch.faces).unwrap();
    assert!((area - patch.area).abs() <= 1e-12 * area);
    assert_eq!(patch.distance[patch.center as usize], 0.0);
    for (i, &s) in patch.source.iter().enumerate() {
        assert!(s == CUT || patch.vertices[i] == mesh.0[s as usize]);
        assert!(patch.distance[i] <= radius * 1.2);
    }
}

fn flat(p: [f64; 3], q: [f64; 3]) -> f64 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

fn on_sphere(p: [f64; 3], q: [f64; 3]) -> f64 {
    (0..3).map(|k| p[k] * q[k]).sum::<f64>().clamp(-1.0, 1.0).acos()
}

#[test]
fn flat_disc_areas_converge() {
    let mut errors = Vec::new();
    for n in [20, 40, 80, 160] {
        let mesh = plane(n, 0.2);
        let center = ((n / 2) * (n + 1) + n / 2) as u32;
        let error = |clip, r: f64| {
            let patch = exact_disc(&mesh, center, r, clip, flat);
            assert_eq!(patch.kind, PatchKind::Disk);
            (patch.area / (PI * r * r) - 1.0).abs()
        };
        let worst = |clip| [0.45, 0.52, 0.61, 0.7].map(|r| error(clip, r)).into_iter().fold(0.0, f64::max);
        errors.push((worst(true), worst(false)));
    }
    println!("clipped, unclipped: {errors:?}");
    for (k, &(clipped, unclipped)) in errors.iter().enumerate() {
        // First order in the edge length without clipping, second order (up to snapping) with it.
        let h = 0.1 / f64::from(1 << k);
        assert!(unclipped < 6.0 * h && unclipped > 0.5 * h);
        assert!(clipped < 1.5 * h * h + 0.02 * h, "{clipped} {h}");
        assert!(clipped < unclipped / 10.0);
    }
}

#[test]
fn sphere_caps_have_their_area() {
    let mesh = sphere(4);
    for angle in [0.3, 0.7, 1.2, 2.0, 2.9] {
        let cap = 2.0 * PI * (1.0 - f64::cos(angle));
        let exact = exact_disc(&mesh, 17, angle, true, on_sphere);
        assert!((exact.area / cap - 1.0).abs() < 0.0015 + 0.001 / angle.powi(2), "{angle}: {}", exact.area / cap);
        assert_eq!(exact.kind, PatchKind::Disk);
        // Graph distances are too long by up to 4 %: the cap is that of a slightly smaller angle.
        let graph = disc(&mesh, 17, angle, true);
        assert!(graph.area < exact.area * 1.001 && graph.area > 0.9 * exact.area, "{angle}");
        assert_eq!(graph.kind, PatchKind::Disk);
    }
}

#[test]
fn a_radius_beyond_everything_gives_the_whole() {
    for mesh in [sphere(2), torus(14, 8)] {
        let euler = if mesh.0.len() == 162 { 2 } else { 0 };
        for clip in [true, false] {
            let patch = disc(&mesh, 5, 100.0, clip);
            assert_eq!((patch.kind, patch.euler, patch.loops), (PatchKind::Whole, euler, 0));
            assert_eq!((patch.vertices.len(), patch.faces.len()), (mesh.0.len(), mesh.1.len()));
            assert_eq!(patch.source[patch.center as usize], 5);
        }
    }
    // An open surface has a boundary, whatever the radius.
    assert_eq!(disc(&plane(6, 0.1), 24, 100.0, true).kind, PatchKind::Disk);
}

#[test]
fn a_wide_disc_wraps_around_a_cylinder() {
    let mesh = cylinder(40, 60, 10.0, 0.15);
    let center = 30 * 40 + 7;
    for clip in [true, false] {
        assert_eq!(disc(&mesh, center, 2.6, clip).kind, PatchKind::Disk);
        let wrapped = disc(&mesh, center, 4.2, clip);
        assert_eq!((wrapped.kind, wrapped.loops, wrapped.euler), (PatchKind::Annulus, 2, 0));
    }
    // On a torus, wrapping around the tube and then around the hole as well.
    let kind = |radius| {
        let patch = disc(&torus(80, 32), 0, radius, true);
        (patch.kind, patch.euler, patch.loops)
    };
    assert_eq!(kind(0.8), (PatchKind::Disk, 1, 1));
    assert_eq!(kind(1.7), (PatchKind::Annulus, 0, 2));
}

#[test]
fn too_small_discs_say_so() {
    let mesh = plane(10, 0.2);
    assert_eq!(disc(&mesh, 60, 1e-6, false).kind, PatchKind::TooSmall);
    assert_eq!(disc(&mesh, 60, -1.0, true).kind, PatchKind::TooSmall);
    assert_eq!(disc(&mesh, 60, f64::NAN, true).kind, PatchKind::TooSmall);
    // Clipping makes a disc of any radius; without it one needs the whole ring.
    assert_eq!(disc(&mesh, 60, 0.08, true).kind, PatchKind::Disk);
    assert_eq!(disc(&mesh, 60, 0.19, false).kind, PatchKind::TooSmall);
    assert_eq!(disc(&mesh, 60, 0.5, false).kind, PatchKind::Disk);
    // At a corner of an open mesh the centre cannot be inside; that is the mesh's doing, and said apart.
    let corner = disc(&mesh, 0, 0.5, true);
    assert!(corner.kind == PatchKind::Disk && corner.center_on_boundary);
    assert!(!disc(&mesh, 60, 0.5, true).center_on_boundary);
    // A centre that is not in the mesh, or in no face.
    let graph = Graph::edges(&mesh.0, &mesh.1).unwrap();
    let mut work = Dijkstra::new();
    let patch = DiscCutter::new(&mesh.0, &mesh.1).unwrap().cut(9999, &work.ball(&graph, &[9999], 1.0), true);
    assert_eq!(patch.kind, PatchKind::TooSmall);
}

#[test]
fn renumbering_vertices_changes_nothing() {
    let mesh = sphere(3);
    for seed in 1..6 {
        let (other, new_of) = permuted(&mesh, seed);
        for (center, radius, clip) in [(0u32, 0.4, true), (100, 1.0, true), (333, 0.9, false), (77, 4.0, true)] {
            let (a, b) = (disc(&mesh, center, radius, clip), disc(&other, new_of[center as usize], radius, clip));
            assert_eq!((a.kind, a.euler, a.loops, a.faces.len()), (b.kind, b.euler, b.loops, b.faces.len()));
            assert!((a.area - b.area).abs() < 1e-11);
            let sources = |p: &Patch| p.source.iter().filter(|&&s| s != CUT).count();
            assert_eq!(sources(&a), sources(&b));
        }
    }
}

#[test]
fn only_the_centres_part_is_kept_and_touching_points_are_split() {
    // Two flat squares sharing one vertex only (a bow-tie), and a far square: the disc keeps the centre's square.
    let (mut vertices, mut faces) = plane(4, 0.0);
    let n = vertices.len() as u32;
    let corner = n - 1;
    let (more, more_faces) = plane(4, 0.0);
    vertices.extend(more.iter().map(|p| [p[0] + 2.0, p[1] + 2.0, 0.0]));
    faces.extend(more_faces.iter().map(|f| f.map(|v| if v == 0 { corner } else { v + n })));
    let mesh = (vertices, faces);
    let patch = disc(&mesh, 18, 3.0, true);
    assert_eq!((patch.faces.len(), patch.kind), (32, PatchKind::Disk));
    // A ring of triangles that closes in a point only: one disc whose pinch is two vertices.
    let ring = |k: u32| f64::from(k) * PI / 3.0;
    let mut vertices: Vec<[f64; 3]> = (0..7).map(|k| [2.0 * ring(k).cos(), 2.0 * ring(k).sin(), 0.0]).collect();
    vertices.extend((0..6).map(|k| [ring(k).cos(), ring(k).sin(), 0.0]));
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for k in 0..5 {
        faces.extend([[k, k + 1, k + 7], [k + 1, k + 8, k + 7]]);
    }
    faces.push([5, 0, 12]);
    let patch = disc(&(vertices, faces), 9, 50.0, true);
    assert_eq!((patch.kind, patch.loops, patch.faces.len()), (PatchKind::Disk, 1, 11));
    assert_eq!(patch.source.iter().filter(|&&s| s == 0).count(), 2);
}

#[test]
fn seams_of_three_faces_are_cut() {
    // A fin along an edge of a flat square: the patch is manifold, and the fin is not in it.
    let (mut vertices, mut faces) = plane(6, 0.0);
    let fin = vertices.len() as u32;
    vertices.push([0.0, 0.0, 0.3]);
    faces.push([24, 25, fin]);
    let patch = disc(&(vertices, faces), 17, 0.9, true);
    assert!(patch.kind == PatchKind::Disk && !patch.source.contains(&fin));
}

#[test]
fn clipped_patches_have_no_slivers() {
    // On well-shaped meshes the smallest angle of a cut triangle is bounded by the snapping.
    let mesh = sphere(4);
    for k in 0..40 {
        let patch = disc(&mesh, k * 60, 0.2 + 0.02 * f64::from(k), true);
        for f in &patch.faces {
            let [a, b, c] = f.map(|v| patch.vertices[v as usize]);
            let side2 = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>();
            let longest = side2(a, b).max(side2(b, c)).max(side2(c, a));
            let u = [0, 1, 2].map(|k| b[k] - a[k]);
            let w = [0, 1, 2].map(|k| c[k] - a[k]);
            let cross = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
            let doubled = cross.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(doubled > 0.01 * longest, "height ratio {}", doubled / longest);
        }
    }
}
