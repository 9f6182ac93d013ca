//! Artefacts of recorded runs, read from the cache.

use std::cell::RefCell;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use salient_sdk::{AnyArtefact, Mesh, Registry, Surfaces};

use super::side::Side;
use crate::engine::cache::Entry;
use crate::engine::{Cache, CacheError, Digest};

/// How many meshes are held.
const MESHES: usize = 32;

/// Reads artefacts; holds the meshes that were used last.
pub struct Library<'a> {
    cache: &'a Cache,
    registry: &'a Registry,
    meshes: RefCell<VecDeque<(Digest, Arc<Mesh>)>>,
}

impl<'a> Library<'a> {
    /// The artefacts of a cache, of the types that these nodes make.
    #[must_use]
    pub fn new(cache: &'a Cache, registry: &'a Registry) -> Self {
        Self { cache, registry, meshes: RefCell::default() }
    }

    /// The cache.
    #[must_use]
    pub fn cache(&self) -> &'a Cache {
        self.cache
    }

    /// A call's output; `None` if there is none, it was collected since, or this program cannot read its type.
    pub fn artefact(&self, side: &Side, call: usize) -> Result<Option<Arc<dyn AnyArtefact>>, CacheError> {
        let kind = side.kind(call);
        let output = self.registry.get(&kind.name).map(salient_sdk::AnyNode::output);
        let known = output.filter(|output| (output.name, output.format) == (kind.output.as_str(), kind.format));
        let (Some(output), Some(digest)) = (known, side.call(call).digest) else { return Ok(None) };
        let Entry::Found(bytes) = self.cache.object(&digest)? else { return Ok(None) };
        Ok((output.decode)(&bytes).ok())
    }

    fn mesh(&self, side: &Side, call: usize) -> Result<Option<Arc<Mesh>>, CacheError> {
        let Some(digest) = side.call(call).digest else { return Ok(None) };
        if let Some((_, mesh)) = self.meshes.borrow().iter().find(|(known, _)| *known == digest) {
            return Ok(Some(mesh.clone()));
        }
        let artefact = self.artefact(side, call)?;
        let Some(mesh) = artefact.and_then(|it| it.into_any().downcast::<Mesh>().ok()) else { return Ok(None) };
        let mut meshes = self.meshes.borrow_mut();
        meshes.push_front((digest, mesh.clone()));
        meshes.truncate(MESHES);
        Ok(Some(mesh))
    }

    /// For each port that both calls have wired, the nearest surfaces upward of it.
    pub fn surfaces(&self, sides: [&Side; 2], calls: [usize; 2]) -> Result<Surfaces, CacheError> {
        let (mut surfaces, mut seen) = (Surfaces::default(), BTreeSet::new());
        for (port, label, one) in &sides[0].call(calls[0]).inputs {
            // The first of a port that takes many stands for it.
            if !seen.insert(port) {
                continue;
            }
            let mut others = sides[1].call(calls[1]).inputs.iter();
            let Some((_, _, other)) = others.find(|(p, l, _)| (p, l) == (port, label)) else { continue };
            let (Some(one), Some(other)) = (sides[0].surface(*one), sides[1].surface(*other)) else { continue };
            if let (Some(one), Some(other)) = (self.mesh(sides[0], one)?, self.mesh(sides[1], other)?) {
                surfaces.push(port, one, other);
            }
        }
        Ok(surfaces)
    }
}
