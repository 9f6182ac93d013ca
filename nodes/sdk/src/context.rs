//! All that a running node may ask of the world outside its inputs.

use std::fs::File;
use std::io;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::Value;

use crate::error::NodeError;
use crate::memo::ItemKey;
use crate::threads;

/// What the host of a node offers. The engine implements it; tests use [`crate::testing`].
pub trait Host: Sync {
    /// Reads the file that the param `param` names, or with `beside` the file of that relative path
    /// in the same folder, and records the read for the cache key.
    fn read(&self, param: &str, beside: Option<&str>) -> Result<Arc<[u8]>, NodeError>;
    /// How much of the work is done, 0 to 1.
    fn progress(&self, fraction: f64);
    /// Whether the run was stopped: the node should return [`NodeError::cancelled`] soon.
    fn cancelled(&self) -> bool;
    /// Keeps a figure in the record of the run (times and counts that do not belong to the artefact).
    fn record(&self, name: &str, value: Value);
    /// Seconds since the node was started, for nodes with a time limit.
    fn seconds(&self) -> f64;
    /// Takes up to `wanted` idle workers for this node and says how many it got.
    fn borrow_workers(&self, wanted: usize) -> usize;
    /// Gives workers back.
    fn return_workers(&self, count: usize);
    /// An empty file that nobody else uses, gone once it is closed; `None` if this host has none to lend.
    fn scratch(&self) -> io::Result<Option<File>> {
        Ok(None)
    }
    /// The values that were kept under these keys by nodes of this kind and version with this scope, in order; `None` for those that
    /// are not known. See [`crate::memo`]. May be fewer than asked for: the rest is not known.
    fn recall(&self, _scope: &Value, _keys: &[ItemKey]) -> Result<Vec<Option<Vec<u8>>>, NodeError> {
        Ok(Vec::new())
    }
    /// Keeps values for later executions.
    fn keep(&self, _scope: &Value, _items: Vec<(ItemKey, Vec<u8>)>) -> Result<(), NodeError> {
        Ok(())
    }
}

/// A node's view of its [`Host`].
#[derive(Clone, Copy)]
pub struct Context<'a> {
    host: &'a dyn Host,
}

impl<'a> Context<'a> {
    /// A context on a host.
    #[must_use]
    pub fn new(host: &'a dyn Host) -> Self {
        Self { host }
    }

    pub(crate) fn host(&self) -> &'a dyn Host {
        self.host
    }

    /// The bytes of the file that the file param `param` names.
    pub fn read(&self, param: &str) -> Result<Arc<[u8]>, NodeError> {
        self.host.read(param, None)
    }

    /// The bytes of a file by its path relative to the folder of the file that `param` names.
    pub fn read_beside(&self, param: &str, relative: &str) -> Result<Arc<[u8]>, NodeError> {
        self.host.read(param, Some(relative))
    }

    /// Reports progress, 0 to 1.
    pub fn progress(&self, fraction: f64) {
        self.host.progress(fraction.clamp(0.0, 1.0));
    }

    /// Whether the run was stopped.
    #[must_use]
    pub fn cancelled(&self) -> bool {
        self.host.cancelled()
    }

    /// Returns the error of a stopped run if the run was stopped; for use with `?` in long loops.
    pub fn check(&self) -> Result<(), NodeError> {
        if self.cancelled() { Err(NodeError::cancelled()) } else { Ok(()) }
    }

    /// Seconds since the node was started. A result that depends on it may differ from run to run, and
    /// must say so; params with a time limit are never a default.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.host.seconds()
    }

    /// An empty file to read and write, gone once it is closed: for what is large and not needed for a while. `None` if the host has none to lend; what is
    /// computed must not depend on that.
    pub fn scratch(&self) -> io::Result<Option<File>> {
        self.host.scratch()
    }

    /// Keeps a figure in the record of the run.
    pub fn record(&self, name: &str, value: impl Into<Value>) {
        self.host.record(name, value.into());
    }

    /// Runs `task(0)` to `task(count - 1)` on the workers that are idle. Of a run that was stopped some are left out.
    pub fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let extra = Borrowed::new(self.host, count.saturating_sub(1));
        threads::each(extra.count, count, &|i| {
            if !self.cancelled() {
                task(i);
            }
        });
    }

    /// Applies `f` to every item on the workers that are idle, and returns the results in order.
    ///
    /// The result does not depend on the number of workers as long as `f` is a pure function. The
    /// error of the lowest index wins, so errors are reproducible too.
    pub fn map<T: Sync, R: Send>(
        &self,
        items: &[T],
        f: impl Fn(usize, &T) -> Result<R, NodeError> + Sync,
    ) -> Result<Vec<R>, NodeError> {
        let extra = Borrowed::new(self.host, items.len().saturating_sub(1));
        // Of the items after one that failed, those that were not begun are left out.
        let first_failed = AtomicUsize::new(usize::MAX);
        let results: Vec<Mutex<Option<Result<R, NodeError>>>> = items.iter().map(|_| Mutex::new(None)).collect();
        threads::each(extra.count, items.len(), &|i| {
            if i > first_failed.load(Ordering::Relaxed) {
                return;
            }
            let result = if self.cancelled() { Err(NodeError::cancelled()) } else { f(i, &items[i]) };
            if result.is_err() {
                first_failed.fetch_min(i, Ordering::Relaxed);
            }
            *results[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
        });
        let taken = results.into_iter().map_while(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner));
        taken.collect()
    }
}

/// Workers on loan: given back even if a node panics.
struct Borrowed<'a> {
    host: &'a dyn Host,
    count: usize,
}

impl<'a> Borrowed<'a> {
    fn new(host: &'a dyn Host, wanted: usize) -> Self {
        Self { host, count: if wanted == 0 { 0 } else { host.borrow_workers(wanted) } }
    }
}

impl Drop for Borrowed<'_> {
    fn drop(&mut self) {
        self.host.return_workers(self.count);
    }
}

/// The number of processors, for hosts that are not told how many workers to use.
#[must_use]
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, NonZeroUsize::get)
}
