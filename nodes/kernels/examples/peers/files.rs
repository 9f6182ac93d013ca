//! What `salient` and its peers hand each other: little-endian arrays with their counts in front.
//!
//! - operator: u64 n, u64 nnz, u64 offsets\[n + 1\], u32 columns\[nnz\], f64 values\[nnz\] (all of M, row by row), f64 mass\[n\];
//! - mesh: u64 vertices, u64 faces, f64 positions\[3 vertices\], u32 corners\[3 faces\];
//! - pairs: u64 n, u64 k, f64 values\[k\], f64 vectors\[n k\], vector after vector.

use crate::mesh::Mesh;
use salient_kernels::eigen::Eigenpairs;
use salient_kernels::laplacian::Operator;
use salient_kernels::sparse::SymmetricCsr;
use std::error::Error;
use std::fs;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// A file being read.
struct Bytes {
    all: Vec<u8>,
    at: usize,
}

impl Bytes {
    fn open(path: &str) -> Result<Self> {
        Ok(Self { all: fs::read(path)?, at: 0 })
    }

    fn array<T, const N: usize>(&mut self, count: usize, convert: impl Fn([u8; N]) -> T) -> Result<Vec<T>> {
        let end = count.checked_mul(N).and_then(|len| self.at.checked_add(len)).ok_or("a count is too large")?;
        let part = self.all.get(self.at..end).ok_or("the file ends early")?;
        self.at = end;
        Ok(part.as_chunks().0.iter().map(|&bytes| convert(bytes)).collect())
    }

    fn sizes(&mut self, count: usize) -> Result<Vec<usize>> {
        self.array(count, |bytes| u64::from_le_bytes(bytes) as usize)
    }
}

pub fn read_operator(path: &str) -> Result<Operator> {
    let mut file = Bytes::open(path)?;
    let [n, nnz] = file.sizes(2)?[..] else { return Err("no counts".into()) };
    let offsets = file.sizes(n + 1)?;
    let columns = file.array(nnz, u32::from_le_bytes)?;
    let values = file.array(nnz, f64::from_le_bytes)?;
    let mass = file.array(n, f64::from_le_bytes)?;
    Ok(Operator { stiffness: SymmetricCsr::from_parts(offsets, columns, values)?, mass })
}

pub fn read_mesh(path: &str) -> Result<Mesh> {
    let mut file = Bytes::open(path)?;
    let [vertices, faces] = file.sizes(2)?[..] else { return Err("no counts".into()) };
    let positions = file.array(3 * vertices, f64::from_le_bytes)?;
    let corners = file.array(3 * faces, u32::from_le_bytes)?;
    Ok(Mesh { vertices: positions.as_chunks().0.to_vec(), faces: corners.as_chunks().0.to_vec() })
}

/// The bytes of counts.
fn counts(values: impl IntoIterator<Item = usize>) -> Vec<u8> {
    values.into_iter().flat_map(|v| (v as u64).to_le_bytes()).collect()
}

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn indices(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub fn write_operator(path: &str, operator: &Operator) -> Result<()> {
    let m = &operator.stiffness;
    let head = counts([m.n(), m.columns().len()].into_iter().chain(m.offsets().iter().copied()));
    Ok(fs::write(path, [head, indices(m.columns()), floats(m.values()), floats(&operator.mass)].concat())?)
}

pub fn write_mesh(path: &str, mesh: &Mesh) -> Result<()> {
    let head = counts([mesh.vertices.len(), mesh.faces.len()]);
    Ok(fs::write(path, [head, floats(mesh.vertices.as_flattened()), indices(mesh.faces.as_flattened())].concat())?)
}

pub fn write_pairs(path: &str, pairs: &Eigenpairs) -> Result<()> {
    let head = counts([pairs.n, pairs.values.len()]);
    Ok(fs::write(path, [head, floats(&pairs.values), floats(&pairs.vectors)].concat())?)
}

pub fn write_floats(path: &str, values: &[f64]) -> Result<()> {
    Ok(fs::write(path, floats(values))?)
}
