//! What a worker does: looks up keys, loads and executes calls, and stores what they make.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant, SystemTime};

use crossbeam::channel::Sender;
use petgraph::graph::NodeIndex;
use salient_sdk::{AnyArtefact, Context, Host, ItemKey, NodeError, PortValues};
use serde_json::{Map, Value};

use super::cache::{Cache, CacheError, Entry, PutError};
use super::event::Event;
use super::held::Held;
use super::key::{Digest, Ingredients, wires};
use super::memo;
use super::record::{Read, Record, beside};
use super::schedule::Cancel;
use super::sources::Sources;
use super::working::Stay;
use crate::graph::{Call, Plan};

/// What the coordinator asks of a worker.
pub(super) enum Job {
    /// Make the key and look it up. The inputs' digests are known.
    Resolve { call: NodeIndex, inputs: BTreeMap<NodeIndex, Digest> },
    /// Read a wanted output into memory.
    Load { call: NodeIndex, digest: Digest },
    /// Run the node.
    Execute { call: NodeIndex, inputs: BTreeMap<NodeIndex, Digest>, ingredients: Arc<Ingredients> },
}

impl Job {
    pub(super) fn call(&self) -> NodeIndex {
        match self {
            Self::Resolve { call, .. } | Self::Load { call, .. } | Self::Execute { call, .. } => *call,
        }
    }
}

/// What came of a job.
pub(super) enum Done {
    /// The key is recorded.
    Hit(Arc<Ingredients>, Box<Record>),
    /// The key is not recorded.
    Miss(Arc<Ingredients>),
    /// The output is in memory.
    Loaded,
    /// The outputs of these calls are needed, but are neither in memory nor in the cache.
    Lacks(Vec<NodeIndex>),
    /// The node ran, and its output is stored.
    Computed(Box<Record>),
}

/// What an execution cost; see [`Record`].
#[derive(Clone, Copy)]
struct Cost {
    seconds: f64,
    working: Option<u64>,
}

/// Why a job did not get done.
pub(super) enum Halt {
    Node(NodeError),
    Cache(CacheError),
}

impl From<NodeError> for Halt {
    fn from(error: NodeError) -> Self {
        Self::Node(error)
    }
}

impl From<CacheError> for Halt {
    fn from(error: CacheError) -> Self {
        Self::Cache(error)
    }
}

/// What workers tell the coordinator.
pub(super) enum Report {
    Event(Event),
    Done(NodeIndex, Result<Done, Halt>),
    /// Lent workers came back.
    Idle,
}

/// Workers that are not busy.
pub(super) struct Permits(AtomicUsize);

impl Permits {
    pub(super) fn new(count: usize) -> Self {
        Self(AtomicUsize::new(count))
    }

    /// Takes up to `wanted` and says how many.
    pub(super) fn take(&self, wanted: usize) -> usize {
        let taken = self
            .0
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |free| Some(free - free.min(wanted)))
            .unwrap_or_default();
        taken.min(wanted)
    }

    pub(super) fn give(&self, count: usize) {
        self.0.fetch_add(count, Ordering::AcqRel);
    }
}

/// What all workers of a run share.
pub(super) struct Shared<'a> {
    pub plan: &'a Plan,
    pub cache: &'a Cache,
    pub sources: &'a Sources,
    pub cancel: &'a Cancel,
    /// The cache failed, or a call did and the first failure stops the run: going on makes no sense.
    pub stuck: AtomicBool,
    pub jobs: usize,
    /// Whether the first failure stops the run.
    pub fail_fast: bool,
    pub held: Held,
    pub loading: BTreeMap<NodeIndex, Mutex<()>>,
    pub permits: Permits,
    pub reports: Sender<Report>,
}

impl Shared<'_> {
    /// Whether nothing further is to be started.
    pub(super) fn stopping(&self) -> bool {
        self.stuck.load(Ordering::Relaxed) || self.cancel.is_cancelled()
    }

    /// Does a job; a panic anywhere in it is the failure of its call.
    pub(super) fn work(&self, job: Job) {
        let call = job.call();
        let result = catch_unwind(AssertUnwindSafe(|| match job {
            Job::Resolve { call, inputs } => self.resolve(call, &inputs),
            Job::Load { call, digest } => {
                let _stay = Stay::enter();
                Ok(match self.materialise(call, digest)? {
                    Some(_) => Done::Loaded,
                    None => Done::Lacks(vec![call]),
                })
            }
            Job::Execute { call, inputs, ingredients } => self.execute(call, &inputs, ingredients),
        }));
        let result = result.unwrap_or_else(|panic| Err(Halt::Node(self.panicked(call, panic.as_ref()))));
        self.send(Report::Done(call, result));
    }

    fn send(&self, report: Report) {
        // The coordinator outlives its workers; if it died of a panic there is nobody to tell.
        let _ = self.reports.send(report);
    }

    fn panicked(&self, call: NodeIndex, panic: &(dyn std::any::Any + Send)) -> NodeError {
        let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
        let kind = self.plan.dag[call].node.kind();
        let text = text.unwrap_or_else(|| "no message".into());
        NodeError::passing(format!("the node `{kind}` panicked: {text}"))
            .help("this is a bug in the node: please report it with the graph file and the panic's message")
    }

    fn resolve(&self, call: NodeIndex, inputs: &BTreeMap<NodeIndex, Digest>) -> Result<Done, Halt> {
        let own = Ingredients::own(self.plan, call, self.sources)?;
        let ingredients = Arc::new(own.with_inputs(self.plan, call, |from| inputs.get(&from).copied()));
        let (found, corrupt) = lookup(&self.plan.dag[call], &ingredients.key(), self.cache, self.sources)?;
        for path in corrupt {
            self.corrupt(call, &path);
        }
        Ok(match found {
            Some(mut record) => {
                // Equal but for names and paths, which are now as this run has them; and held once.
                record.ingredients = ingredients.clone();
                // Keeps the object from being collected while this run may want it.
                let _ = self.cache.has_object(&record.digest);
                Done::Hit(ingredients, Box::new(record))
            }
            None => Done::Miss(ingredients),
        })
    }

    fn corrupt(&self, call: NodeIndex, path: &Path) {
        let (node, path) = (self.plan.name(call).to_owned(), path.display().to_string());
        self.send(Report::Event(Event::CacheCorrupt { node, path }));
    }

    /// A call's output, from memory or from the cache; `None` if it is in neither.
    fn materialise(&self, call: NodeIndex, digest: Digest) -> Result<Option<Arc<dyn AnyArtefact>>, Halt> {
        if let Some(artefact) = self.held.get(call, &digest) {
            return Ok(Some(artefact));
        }
        // Two consumers at once read the file once.
        let _guard = self.loading[&call].lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(artefact) = self.held.get(call, &digest) {
            return Ok(Some(artefact));
        }
        let bytes = match self.cache.object(&digest)? {
            Entry::Found(bytes) => bytes,
            Entry::Missing => return Ok(None),
            Entry::Corrupt(path) => {
                self.corrupt(call, &path);
                return Ok(None);
            }
        };
        let Ok(artefact) = (self.plan.dag[call].node.output().decode)(&bytes) else {
            let path = self.cache.remove_object(&digest)?;
            self.corrupt(call, &path);
            return Ok(None);
        };
        self.held.put(call, digest, bytes.len() as u64, artefact.clone());
        Ok(Some(artefact))
    }

    fn execute(
        &self,
        call: NodeIndex,
        inputs: &BTreeMap<NodeIndex, Digest>,
        ingredients: Arc<Ingredients>,
    ) -> Result<Done, Halt> {
        let mut stay = Stay::enter();
        let (mut values, mut lacks) = (PortValues::default(), BTreeSet::new());
        for (wire, from) in wires(self.plan, call) {
            // What a failure left out; the coordinator lets that through to ports that do without only.
            let Some(digest) = inputs.get(&from) else {
                values.push_missing(wire.port, &wire.label);
                continue;
            };
            match self.materialise(from, *digest)? {
                Some(artefact) => values.push(wire.port, &wire.label, artefact),
                None => drop(lacks.insert(from)),
            }
        }
        if !lacks.is_empty() {
            return Ok(Done::Lacks(lacks.into_iter().collect()));
        }
        let it = &self.plan.dag[call];
        let (node, kind) = (self.plan.name(call).to_owned(), it.node.kind().to_owned());
        self.send(Report::Event(Event::Started { node, kind }));
        let host = NodeHost::new(self, call);
        stay.begin();
        let start = Instant::now();
        let artefact = it.bound.run(&mut values, Context::new(&host))?;
        let cost = Cost { seconds: start.elapsed().as_secs_f64(), working: stay.gained() };
        drop(values);
        let record = self.store(call, artefact, ingredients, cost, host)?;
        Ok(Done::Computed(Box::new(record)))
    }

    fn store(
        &self,
        call: NodeIndex,
        artefact: Arc<dyn AnyArtefact>,
        ingredients: Arc<Ingredients>,
        cost: Cost,
        host: NodeHost,
    ) -> Result<Record, Halt> {
        let output = self.plan.dag[call].node.output();
        let unwritable = |e: salient_sdk::FormatError| {
            NodeError::new(format!("its output, a {}, cannot be written: {e}", output.name))
        };
        let (digest, written) = self.cache.put_object(|file| artefact.write(file)).map_err(|e| match e {
            PutError::Format(e) => Halt::from(unwritable(e)),
            PutError::Cache(e) => e.into(),
        })?;
        // Downstream must see what a later run will read.
        let artefact = if written.changed {
            let (bytes, _) = artefact.to_bytes().map_err(unwritable)?;
            (output.decode)(&bytes).map_err(unwritable)?
        } else {
            artefact
        };
        let reliable = !host.unreliable.load(Ordering::Acquire);
        let record = Record {
            ingredients,
            reads: unlock(host.reads).into_iter().collect(),
            digest,
            bytes: written.bytes,
            seconds: cost.seconds,
            working: cost.working,
            when: millis(SystemTime::now()),
            figures: unlock(host.figures),
            defects: artefact.defects(),
        };
        if reliable {
            self.cache.put_record(&record)?;
        }
        self.held.put(call, digest, record.bytes, artefact);
        Ok(record)
    }
}

/// The record of a key whose discovered reads are all as they were, and damaged files that were
/// removed.
pub(super) fn lookup(
    call: &Call,
    key: &Digest,
    cache: &Cache,
    sources: &Sources,
) -> Result<(Option<Record>, Vec<std::path::PathBuf>), Halt> {
    let (records, corrupt) = cache.records(key)?;
    for record in records {
        if record.changed_read(call, sources)?.is_none() {
            return Ok((Some(record), corrupt));
        }
    }
    Ok((None, corrupt))
}

/// Milliseconds since 1970.
pub(super) fn millis(time: SystemTime) -> u64 {
    time.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_millis() as u64
}

fn unlock<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// A cache that fails a node in the middle would fail it at its end as well.
fn unusable(error: CacheError) -> NodeError {
    NodeError::passing(error.message).help(error.help)
}

/// What one execution may ask of the world.
struct NodeHost<'a> {
    shared: &'a Shared<'a>,
    call: NodeIndex,
    reads: Mutex<BTreeSet<Read>>,
    figures: Mutex<Map<String, Value>>,
    /// A read failed in a way that may pass: the output must not be recorded.
    unreliable: AtomicBool,
    percent: AtomicU32,
    started: Instant,
}

impl<'a> NodeHost<'a> {
    fn new(shared: &'a Shared<'a>, call: NodeIndex) -> Self {
        Self {
            shared,
            call,
            reads: Mutex::default(),
            figures: Mutex::default(),
            unreliable: AtomicBool::new(false),
            percent: AtomicU32::new(0),
            started: Instant::now(),
        }
    }

    /// The group of this node's items with this scope.
    fn group(&self, scope: &Value) -> Digest {
        let node = self.shared.plan.dag[self.call].node;
        memo::group(node.kind(), node.version(), scope)
    }

    fn pinned(&self, path: &Path) -> Result<Option<Arc<[u8]>>, NodeError> {
        let unreliable = |_: &NodeError| self.unreliable.store(true, Ordering::Release);
        self.shared.sources.read(path).inspect_err(unreliable)
    }
}

impl Host for NodeHost<'_> {
    fn read(&self, param: &str, relative: Option<&str>) -> Result<Arc<[u8]>, NodeError> {
        let call = &self.shared.plan.dag[self.call];
        let sources = self.shared.sources;
        let nameless = || NodeError::new(format!("the param `{param}` names no file"));
        let Some(relative) = relative else {
            let path = call.files.get(param).ok_or_else(nameless)?;
            return self.pinned(path)?.ok_or_else(|| sources.absent(path));
        };
        if Path::new(relative).is_absolute() {
            let message = format!("`{relative}`, asked for beside `{param}`, is not a relative path");
            return Err(NodeError::new(message));
        }
        let path = beside(call, param, relative).ok_or_else(nameless)?;
        let bytes = self.pinned(&path)?;
        let read =
            Read { param: param.to_owned(), beside: relative.to_owned(), digest: bytes.as_deref().map(Digest::of) };
        self.reads.lock().unwrap_or_else(PoisonError::into_inner).insert(read);
        let by = call.files.get(param).map(|file| file.display().to_string()).unwrap_or_default();
        bytes.ok_or_else(|| sources.absent(&path).help(format!("{by} names it, relative to itself")))
    }

    fn progress(&self, fraction: f64) {
        let percent = (fraction * 100.0) as u32;
        if self.percent.fetch_max(percent, Ordering::Relaxed) < percent {
            let node = self.shared.plan.name(self.call).to_owned();
            self.shared.send(Report::Event(Event::Progress { node, fraction }));
        }
    }

    fn cancelled(&self) -> bool {
        self.shared.stuck.load(Ordering::Relaxed) || self.shared.cancel.stops(self.call)
    }

    fn record(&self, name: &str, value: Value) {
        let mut figures = self.figures.lock().unwrap_or_else(PoisonError::into_inner);
        figures.insert(name.to_owned(), value);
    }

    fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn scratch(&self) -> io::Result<Option<File>> {
        self.shared.cache.scratch().map(Some)
    }

    fn borrow_workers(&self, wanted: usize) -> usize {
        self.shared.permits.take(wanted)
    }

    fn return_workers(&self, count: usize) {
        if count > 0 {
            self.shared.permits.give(count);
            self.shared.send(Report::Idle);
        }
    }

    fn recall(&self, scope: &Value, keys: &[ItemKey]) -> Result<Vec<Option<Vec<u8>>>, NodeError> {
        let mut found = self.shared.cache.recall(&self.group(scope), keys).map_err(unusable)?;
        for path in &found.corrupt {
            self.shared.corrupt(self.call, path);
        }
        Ok(keys.iter().map(|key| found.items.remove(key)).collect())
    }

    fn keep(&self, scope: &Value, items: Vec<(ItemKey, Vec<u8>)>) -> Result<(), NodeError> {
        self.shared.cache.keep(&self.group(scope), &items.into_iter().collect()).map_err(unusable)
    }
}
