//! The side of `salient` in `benches/peers`: makes the inputs, and solves what its peers solve, one problem per process.
//!
//! ```text
//! peers mesh SOURCE LEVELS OUT       OUT.mesh and OUT.operator; SOURCE is FILE.obj, FILE.off or creature:N
//! peers eigen OPERATOR K THREADS OUT the K smallest pairs to OUT
//! peers cut MESH SIZE COUNT STEM     COUNT discs of about SIZE vertices: STEM-i.mesh, and STEM-i.operator of the doubled disc
//! peers patches STEM COUNT VALUES THREADS OUT   the spectra of those discs
//! peers geodesics MESH COUNT SIZE OUT           the sum of distances from each of COUNT vertices; SIZE 0 is without limit
//! ```
//!
//! Each computation prints one line of JSON: seconds, bytes, and what else is known. `benches/peers/README.md` has the rest.
#![expect(clippy::disallowed_methods, reason = "a program, not a node")]

mod files;
mod local;
mod mesh;
mod meter;

use mesh::Mesh;
use meter::{Cost, measured};
use salient_kernels::eigen::{Hooks, Options, eigenpairs};
use salient_kernels::laplacian::{Area, laplacian};
use salient_sdk::threads;
use std::error::Error;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["mesh", source, levels, out] => make(source, levels.parse()?, out),
        ["eigen", operator, k, threads, out] => eigen(operator, k.parse()?, threads.parse()?, out),
        ["cut", mesh, size, count, stem] => local::cut(mesh, size.parse()?, count.parse()?, stem),
        ["patches", stem, count, values, threads, out] => {
            local::patches(stem, count.parse()?, values.parse()?, threads.parse()?, out)
        }
        ["geodesics", mesh, count, size, out] => local::geodesics(mesh, count.parse()?, size.parse()?, out),
        _ => Err("usage: peers mesh|eigen ... (see the documentation at the head of this file)".into()),
    }
}

fn report(cost: &Cost, rest: &str) {
    println!(r#"{{"wall": {}, "cpu": {:.6}, "memory": {}{rest}}}"#, cost.wall, cost.cpu, cost.memory);
}

fn make(source: &str, levels: usize, out: &str) -> Result<(), Box<dyn Error>> {
    let mesh = Mesh::from_source(source)?.refined(levels);
    let (operator, cost) = measured(|| Ok(laplacian(&mesh.vertices, &mesh.faces, Area::Mixed, false)?))?;
    files::write_mesh(&format!("{out}.mesh"), &mesh)?;
    files::write_operator(&format!("{out}.operator"), &operator)?;
    report(&cost, &format!(r#", "n": {}"#, mesh.vertices.len()));
    Ok(())
}

fn eigen(path: &str, k: usize, threads: usize, out: &str) -> Result<(), Box<dyn Error>> {
    let operator = files::read_operator(path)?;
    let folder = Path::new(out).parent().unwrap_or(Path::new("."));
    let host = Host { idle: AtomicUsize::new(threads.saturating_sub(1)), folder };
    let (pairs, cost) = measured(|| Ok(eigenpairs(&operator, k, &Options::default(), &host)?))?;
    files::write_pairs(out, &pairs)?;
    let certificate = &pairs.certificate;
    report(&cost, &format!(r#", "rounds": {}, "method": "{:?}""#, certificate.rounds, certificate.method));
    Ok(())
}

/// Lends the kernel threads as long as there are idle ones, and a file beside the result.
struct Host<'a> {
    idle: AtomicUsize,
    folder: &'a Path,
}

impl Hooks for Host<'_> {
    fn scratch(&self) -> io::Result<Option<File>> {
        tempfile::tempfile_in(self.folder).map(Some)
    }

    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let mut lent = 0;
        let left = |idle: usize| {
            lent = idle.min(count.saturating_sub(1));
            Some(idle - lent)
        };
        // It cannot fail.
        let _idle = self.idle.fetch_update(Ordering::Relaxed, Ordering::Relaxed, left);
        threads::each(lent, count, task);
        self.idle.fetch_add(lent, Ordering::Relaxed);
    }
}
