//! Eigenvalues against scipy: see golden/eigenvalues.py, which made the figures from a Laplacian assembled independently.

mod common;

use common::{Mesh, assert_close, bumpy_torus, union};
use salient_kernels::eigen::{Options, eigenpairs};
use salient_kernels::laplacian::{Area, laplacian};

const GOLDEN: &str = include_str!("golden/eigenvalues.csv");

/// `sheet` of the script.
fn sheet(p: usize, q: usize) -> Mesh {
    let mut points = Vec::new();
    for j in 0..=q {
        for i in 0..=p {
            let (a, b) = (i as f64, j as f64);
            let x = (a + 0.3 * (3.0 * a + 5.0 * b).sin()) / p as f64;
            let y = (b + 0.3 * (4.0 * a - 3.0 * b).cos()) / q as f64;
            points.push([x, y, 0.3 * (4.0 * x + 1.0).sin() * (3.0 * y).cos()]);
        }
    }
    let corner = |i: usize, j: usize| (j * (p + 1) + i) as u32;
    let cells = (0..q).flat_map(|j| (0..p).map(move |i| (i, j)));
    let faces = cells.flat_map(|(i, j)| {
        let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
        [[a, b, c], [a, c, d]]
    });
    (points, faces.collect())
}

fn mesh(name: &str) -> Mesh {
    match name {
        "torus" => bumpy_torus(40, 20),
        "sheet" => sheet(30, 24),
        _ => {
            let mut patch = sheet(16, 14);
            patch.0.iter_mut().for_each(|p| p[0] += 5.0);
            union(&bumpy_torus(24, 12), &patch)
        }
    }
}

#[test]
fn scipy_agrees() {
    for (name, zeros) in [("torus", 1), ("sheet", 1), ("pair", 2)] {
        for (area, column) in [(Area::Mixed, "mixed"), (Area::Barycentric, "barycentric")] {
            let prefix = format!("{name},{column},");
            let rows = GOLDEN.lines().filter_map(|line| line.strip_prefix(&prefix));
            let expected: Vec<f64> = rows.map(|r| r.split(',').nth(1).unwrap().parse().unwrap()).collect();
            assert_eq!(expected.len(), 60);
            let (points, faces) = mesh(name);
            let operator = laplacian(&points, &faces, area, false).expect("a good mesh");
            for dense_limit in [0, 10_000] {
                let options = Options { dense_limit, ..Options::default() };
                let pairs = eigenpairs(&operator, 60, &options, &()).expect("certified");
                assert!(pairs.values[..zeros].iter().all(|v| *v == 0.0));
                assert!(expected[..zeros].iter().all(|v| v.abs() < 1e-9));
                assert_close(&pairs.values[zeros..], &expected[zeros..], 1e-9);
            }
        }
    }
}
