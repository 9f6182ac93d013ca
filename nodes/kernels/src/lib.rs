//! Numerical kernels for spectral shape analysis.

pub mod assignment;
