//! Running one node in memory, for the tests of node authors.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use serde_json::Value;

use crate::context::{Context, Host};
use crate::error::NodeError;
use crate::memo::ItemKey;
use crate::node::Node;
use crate::port::PortValues;

/// A host in memory: files are given, progress is dropped, records are kept, and so are memos, for one node's tests.
#[derive(Default)]
pub struct TestHost {
    files: BTreeMap<(String, Option<String>), Arc<[u8]>>,
    workers: AtomicUsize,
    cancelled: AtomicBool,
    records: Mutex<BTreeMap<String, Value>>,
    memo: Mutex<BTreeMap<(String, ItemKey), Vec<u8>>>,
    started: Option<Instant>,
}

impl TestHost {
    /// A host that lends `workers` extra workers.
    #[must_use]
    #[expect(clippy::disallowed_methods, reason = "a host, not a node")]
    pub fn with_workers(workers: usize) -> Self {
        let started = Some(Instant::now());
        Self { workers: AtomicUsize::new(workers), started, ..Self::default() }
    }

    /// Makes `bytes` what the file param `param` names.
    #[must_use]
    pub fn file(mut self, param: &str, bytes: &[u8]) -> Self {
        self.files.insert((param.to_owned(), None), bytes.into());
        self
    }

    /// Makes `bytes` a file beside the one that `param` names.
    #[must_use]
    pub fn file_beside(mut self, param: &str, relative: &str, bytes: &[u8]) -> Self {
        self.files.insert((param.to_owned(), Some(relative.to_owned())), bytes.into());
        self
    }

    /// Stops the run from now on.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// What the node recorded under a name.
    #[must_use]
    pub fn recorded(&self, name: &str) -> Option<Value> {
        self.records.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned()
    }

    /// Runs a node on typed inputs.
    pub fn run<N: Node>(&self, params: &N::Params, inputs: N::Inputs) -> Result<N::Output, NodeError> {
        N::run(params, inputs, Context::new(self))
    }

    /// Runs a node on wired values, as the engine does.
    pub fn run_wired<N: Node>(&self, params: &N::Params, mut wired: PortValues) -> Result<N::Output, NodeError> {
        use crate::port::Inputs;
        let inputs = N::Inputs::take(&mut wired)?;
        self.run::<N>(params, inputs)
    }
}

impl Host for TestHost {
    fn read(&self, param: &str, beside: Option<&str>) -> Result<Arc<[u8]>, NodeError> {
        let key = (param.to_owned(), beside.map(str::to_owned));
        let missing = || NodeError::passing(format!("no file for `{param}` {beside:?}"));
        self.files.get(&key).cloned().ok_or_else(missing)
    }
    fn progress(&self, _: f64) {}
    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
    fn record(&self, name: &str, value: Value) {
        self.records.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), value);
    }
    fn seconds(&self) -> f64 {
        self.started.map_or(0.0, |started| started.elapsed().as_secs_f64())
    }
    fn borrow_workers(&self, wanted: usize) -> usize {
        self.workers.load(Ordering::Relaxed).min(wanted)
    }
    fn return_workers(&self, _: usize) {}
    fn recall(&self, scope: &Value, keys: &[ItemKey]) -> Result<Vec<Option<Vec<u8>>>, NodeError> {
        let memo = self.memo.lock().unwrap_or_else(PoisonError::into_inner);
        let scope = scope.to_string();
        Ok(keys.iter().map(|key| memo.get(&(scope.clone(), *key)).cloned()).collect())
    }
    fn keep(&self, scope: &Value, items: Vec<(ItemKey, Vec<u8>)>) -> Result<(), NodeError> {
        let mut memo = self.memo.lock().unwrap_or_else(PoisonError::into_inner);
        memo.extend(items.into_iter().map(|(key, bytes)| ((scope.to_string(), key), bytes)));
        Ok(())
    }
}
