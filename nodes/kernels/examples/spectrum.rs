//! Eigenvalues of an OBJ or OFF file's mesh: `spectrum FILE PAIRS [values]` prints size, time and certificate, and the values if asked.
#![expect(clippy::disallowed_methods, reason = "a program, not a node")]

use salient_kernels::eigen::{Options, eigenpairs};
use salient_kernels::laplacian::{Area, laplacian};
use std::error::Error;
use std::time::Instant;

#[path = "peers/mesh.rs"]
#[expect(dead_code, reason = "the peers refine, this program does not")]
mod mesh;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, k, rest @ ..] = &arguments[..] else {
        return Err("usage: spectrum FILE PAIRS [values] [delaunay]".into());
    };
    let has = |word: &str| rest.iter().any(|r| r == word);
    let mesh::Mesh { vertices, faces } = mesh::Mesh::from_source(path)?;
    let start = Instant::now();
    let operator = laplacian(&vertices, &faces, Area::Mixed, has("delaunay"))?;
    let assembled = start.elapsed();
    let start = Instant::now();
    let pairs = eigenpairs(&operator, k.parse()?, &Options::default(), &())?;
    println!(
        "n {} assembly {:.4} s eigen {:.4} s {:?}",
        pairs.n,
        assembled.as_secs_f64(),
        start.elapsed().as_secs_f64(),
        pairs.certificate
    );
    if has("values") {
        for value in &pairs.values {
            println!("{value:e}");
        }
    }
    Ok(())
}
