//! What the benches measure on: synthesised creatures, and real meshes where the data lies beside the repository.
#![allow(dead_code, reason = "each bench uses its part")]

use salient_kernels::creature::{self, CreatureParams};
use salient_kernels::laplacian::{Area, Operator, laplacian};
use std::path::Path;

#[path = "../../nodes/kernels/examples/peers/mesh.rs"]
mod mesh;
pub use mesh::Mesh;

/// A creature of about `vertices` vertices.
pub fn creature(vertices: usize) -> Mesh {
    let made = creature::generate(&CreatureParams { vertices, ..CreatureParams::default() }).expect("a creature");
    Mesh { vertices: made.vertices, faces: made.faces }
}

/// Creatures of the sizes that the eigensolver is made for; the larger ones are subdivided and shaken.
pub fn refined(name: &str) -> Mesh {
    match name {
        "1k" => creature(1000),
        "5k" => creature(5000),
        "10k" => creature(10_000),
        "43k" => creature(10_812).refined(1),
        _ => creature(10_812).refined(2),
    }
}

/// A mesh of `../shared/data`, or `None`, which is said.
pub fn real(file: &str) -> Option<Mesh> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(file);
    let found = path.exists().then(|| Mesh::from_source(&path.to_string_lossy()).expect("a mesh file"));
    if found.is_none() {
        eprintln!("skipped: {file} is not in ../shared/data");
    }
    found
}

/// The cotangent Laplacian with mixed areas.
pub fn operator(mesh: &Mesh) -> Operator {
    laplacian(&mesh.vertices, &mesh.faces, Area::Mixed, false).expect("a mesh without defects")
}
