//! Artefacts in memory, within a budget: what does not fit is read from the cache again.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use petgraph::graph::NodeIndex;
use salient_sdk::AnyArtefact;

use super::key::Digest;

struct Entry {
    artefact: Arc<dyn AnyArtefact>,
    digest: Digest,
    bytes: u64,
    used: u64,
}

#[derive(Default)]
struct Inner {
    entries: BTreeMap<NodeIndex, Entry>,
    bytes: u64,
    clock: u64,
}

/// Outputs of calls, in memory. Size is counted in encoded bytes.
pub(super) struct Held {
    budget: u64,
    inner: Mutex<Inner>,
}

impl Held {
    pub(super) fn new(budget: u64) -> Self {
        Self { budget, inner: Mutex::default() }
    }

    pub(super) fn get(&self, call: NodeIndex, digest: &Digest) -> Option<Arc<dyn AnyArtefact>> {
        let mut inner = self.lock();
        inner.clock += 1;
        let now = inner.clock;
        let entry = inner.entries.get_mut(&call).filter(|entry| entry.digest == *digest)?;
        entry.used = now;
        Some(entry.artefact.clone())
    }

    /// Holds an artefact and drops those longest unused until all fit the budget.
    pub(super) fn put(&self, call: NodeIndex, digest: Digest, bytes: u64, artefact: Arc<dyn AnyArtefact>) {
        let mut inner = self.lock();
        inner.clock += 1;
        let entry = Entry { artefact, digest, bytes, used: inner.clock };
        inner.bytes += bytes;
        if let Some(old) = inner.entries.insert(call, entry) {
            inner.bytes -= old.bytes;
        }
        while inner.bytes > self.budget {
            let oldest = inner.entries.iter().min_by_key(|(_, entry)| entry.used);
            let Some(call) = oldest.map(|(call, _)| *call) else { break };
            inner.remove(call);
        }
    }

    pub(super) fn drop_one(&self, call: NodeIndex) {
        self.lock().remove(call);
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn remove(&mut self, call: NodeIndex) {
        if let Some(entry) = self.entries.remove(&call) {
            self.bytes -= entry.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use salient_sdk::Mesh;

    #[test]
    fn the_longest_unused_goes_first() {
        let held = Held::new(10);
        let (a, b, c) = (NodeIndex::new(0), NodeIndex::new(1), NodeIndex::new(2));
        let digest = Digest::of(b"");
        let put = |call, bytes| held.put(call, digest, bytes, Arc::new(Mesh::default()));
        put(a, 4);
        put(b, 4);
        assert!(held.get(a, &digest).is_some());
        put(c, 4);
        assert!(held.get(b, &digest).is_none());
        assert!(held.get(a, &digest).is_some() && held.get(c, &digest).is_some());
        assert!(held.get(a, &Digest::of(b"other")).is_none());
        put(b, 11);
        assert!([a, b, c].iter().all(|call| held.get(*call, &digest).is_none()));
        put(a, 10);
        assert!(held.get(a, &digest).is_some());
    }
}
