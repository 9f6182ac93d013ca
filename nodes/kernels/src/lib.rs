//! Numerical kernels for spectral shape analysis: pure functions on plain arrays, no files, no threads, no global state.

pub mod eigen;
pub mod laplacian;
pub mod patch_spectrum;
pub mod sparse;
