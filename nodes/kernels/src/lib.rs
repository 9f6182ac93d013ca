//! Numerical kernels for spectral shape analysis: pure functions on plain arrays, no files, no threads, no global state.

pub mod laplacian;
pub mod sparse;
