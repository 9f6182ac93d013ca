//! Placeholder.

pub mod adjacency;
pub mod disc;
pub mod geodesic;
pub mod nearest;
pub mod simplify;
mod surgery;
pub mod topology;
mod vec3;
