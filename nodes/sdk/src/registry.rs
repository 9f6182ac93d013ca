//! All kinds of node that a host offers.

use std::collections::BTreeMap;

use crate::artefact::ArtefactType;
use crate::node::AnyNode;

/// Kinds of node by name.
#[derive(Clone, Default)]
pub struct Registry {
    nodes: BTreeMap<&'static str, &'static dyn AnyNode>,
}

impl Registry {
    /// The nodes of several slices together; the error names a kind that two of them claim.
    pub fn new(slices: &[&[&'static dyn AnyNode]]) -> Result<Self, String> {
        let mut nodes = BTreeMap::new();
        for node in slices.iter().copied().flatten() {
            if nodes.insert(node.kind(), *node).is_some() {
                return Err(format!("two nodes are called `{}`", node.kind()));
            }
        }
        Ok(Self { nodes })
    }

    /// The node of a kind.
    #[must_use]
    pub fn get(&self, kind: &str) -> Option<&'static dyn AnyNode> {
        self.nodes.get(kind).copied()
    }

    /// All nodes, by name.
    pub fn iter(&self) -> impl Iterator<Item = &'static dyn AnyNode> {
        self.nodes.values().copied()
    }

    /// The artefact types that the nodes make, by name.
    #[must_use]
    pub fn artefacts(&self) -> BTreeMap<&'static str, ArtefactType> {
        self.iter().map(|node| (node.output().name, node.output())).collect()
    }
}
