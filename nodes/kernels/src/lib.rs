//! Numerical kernels for spectral shape analysis: pure functions on plain arrays, no files, no threads, no global state but memory
//! that a thread keeps from one patch spectrum to the next, and how much freed memory the allocator keeps.

pub mod adjacency;
pub mod assignment;
pub mod creature;
pub mod disc;
pub mod eigen;
mod freed;
pub mod geodesic;
mod heap;
pub mod laplacian;
mod multifrontal;
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
mod sturm;
mod surgery;
pub mod topology;
mod vec3;
