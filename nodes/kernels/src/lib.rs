//! Numerical kernels for spectral shape analysis: pure functions on plain arrays, no files, no threads, no global state.

pub mod adjacency;
pub mod assignment;
pub mod creature;
pub mod disc;
pub mod eigen;
pub mod geodesic;
pub mod laplacian;
pub mod nearest;
pub mod object;
pub mod patch_spectrum;
pub mod random;
pub mod retrieval;
pub mod signature;
mod simd;
pub mod simplify;
pub mod sparse;
pub mod stop;
mod surgery;
pub mod topology;
mod vec3;
