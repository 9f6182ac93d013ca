//! The stages of spectral shape analysis as dataflow nodes, one file each.

use salient_sdk::AnyNode;

pub mod load;

/// All nodes of this package.
pub static NODES: &[&dyn AnyNode] = &[&load::Load];
