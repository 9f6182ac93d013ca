//! Runs a plan: demand-driven, on a pool of workers, longest path first.
//!
//! A call is looked up as soon as the *digests* of its inputs are known. If its output is recorded,
//! nothing is loaded. If it is not, its inputs are brought into memory, and only then does an
//! input that was evicted from the cache run again. Keys are made of content, so an output that
//! comes out as before leaves everything after it a hit.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};
use petgraph::graph::NodeIndex;
use salient_sdk::{AnyArtefact, NodeError};

use super::cache::{Cache, CacheError, Entry};
use super::cone::Cone;
use super::coordinator::{Coordinator, Ended};
use super::event::{Event, Totals};
use super::held::Held;
use super::history::{Costs, RunRecord};
use super::key::Digest;
use super::record::Record;
use super::remember::Course;
use super::running::Running;
use super::sources::Sources;
use super::worker::{Job, Permits, Report, Shared, millis};
use crate::graph::Plan;

/// How often the coordinator looks whether it was cancelled.
const TICK: Duration = Duration::from_millis(50);

/// How a run is done; never what it finds.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How many threads compute, at least one.
    pub jobs: usize,
    /// How many bytes of artefacts are held in memory between calls.
    pub memory: u64,
    /// Stop at the first failure, rather than complete what does not rest on it.
    pub fail_fast: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { jobs: salient_sdk::context::processors(), memory: 4 << 30, fail_fast: false }
    }
}

/// Stops a run from another thread: finished work is kept, running nodes are asked to return.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<Stop>);

#[derive(Debug, Default)]
struct Stop {
    stopped: AtomicBool,
    spared: Mutex<Spared>,
}

/// Which running nodes are to finish, though the run is stopped.
#[derive(Debug, Default)]
enum Spared {
    #[default]
    None,
    Some(BTreeSet<NodeIndex>),
    All,
}

impl Cancel {
    /// A run that nobody has stopped.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Stops the run.
    pub fn cancel(&self) {
        *self.spared() = Spared::None;
        self.0.stopped.store(true, Ordering::Release);
    }

    /// Stops the run but for these calls, which go on if they are running. A run that was stopped altogether
    /// remains so.
    pub fn cancel_but(&self, calls: BTreeSet<NodeIndex>) {
        self.spare(Spared::Some(calls));
    }

    /// Starts no further node; those that are running go on.
    pub fn hold(&self) {
        if !self.is_cancelled() {
            self.spare(Spared::All);
        }
    }

    fn spare(&self, whom: Spared) {
        let mut spared = self.spared();
        if !self.is_cancelled() || !matches!(*spared, Spared::None) {
            *spared = whom;
            self.0.stopped.store(true, Ordering::Release);
        }
    }

    /// Whether the run was stopped.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.stopped.load(Ordering::Acquire)
    }

    /// Whether a running call is to return.
    #[must_use]
    pub fn stops(&self, call: NodeIndex) -> bool {
        self.is_cancelled()
            && match &*self.spared() {
                Spared::None => true,
                Spared::Some(calls) => !calls.contains(&call),
                Spared::All => false,
            }
    }

    fn spared(&self) -> MutexGuard<'_, Spared> {
        self.0.spared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How a call ended.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// Its output was in the cache.
    Hit(Box<Record>),
    /// It was executed.
    Computed(Box<Record>),
    /// It failed.
    Failed(NodeError),
    /// A call that it rests on failed: its address.
    Skipped(String),
    /// The run was stopped before it was done.
    Cancelled,
}

impl State {
    /// What is known of the output, if there is one.
    #[must_use]
    pub fn record(&self) -> Option<&Record> {
        match self {
            Self::Hit(record) | Self::Computed(record) => Some(record),
            _ => None,
        }
    }
}

/// What a run came to.
pub struct Outcome {
    /// How each call ended that the wanted results rest on.
    pub states: BTreeMap<NodeIndex, State>,
    /// How many calls ended how.
    pub totals: Totals,
    /// Wall time in seconds.
    pub seconds: f64,
    /// Whether the run was stopped.
    pub cancelled: bool,
    /// The run as it is remembered.
    pub record: RunRecord,
    held: Held,
}

impl Outcome {
    /// Whether everything wanted was found.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.totals.failed + self.totals.skipped + self.totals.cancelled == 0
    }

    /// A wanted output: `None` if its call did not get done, or if another process has removed it
    /// from the cache since.
    pub fn artefact(
        &self,
        plan: &Plan,
        call: NodeIndex,
        cache: &Cache,
    ) -> Result<Option<Arc<dyn AnyArtefact>>, CacheError> {
        let Some(record) = self.states.get(&call).and_then(State::record) else { return Ok(None) };
        if let Some(artefact) = self.held.get(call, &record.digest) {
            return Ok(Some(artefact));
        }
        let Entry::Found(bytes) = cache.object(&record.digest)? else { return Ok(None) };
        Ok((plan.dag[call].node.output().decode)(&bytes).ok())
    }
}

/// Computes the outputs of `wanted` and what they rest on.
///
/// Failures of nodes are in the outcome; the error is a cache that cannot be used. Events come in
/// order, from the calling thread.
pub fn run(
    plan: &Plan,
    wanted: &[NodeIndex],
    cache: &Cache,
    options: Options,
    cancel: &Cancel,
    on_event: &mut dyn FnMut(&Event),
) -> Result<Outcome, CacheError> {
    run_on(plan, wanted, cache, options, cancel, &Sources::new(), on_event)
}

/// As [`run`], on given input files: what was looked at can be asked of them afterwards.
pub fn run_on(
    plan: &Plan,
    wanted: &[NodeIndex],
    cache: &Cache,
    options: Options,
    cancel: &Cancel,
    sources: &Sources,
    on_event: &mut dyn FnMut(&Event),
) -> Result<Outcome, CacheError> {
    let (started, clock) = (SystemTime::now(), Instant::now());
    let mut running = Running::register(cache)?;
    let cone = Cone::of(plan, wanted, &Costs::of(plan, cache)?.weights(plan));
    let order: Vec<_> = cone.calls().collect();
    let jobs = options.jobs.max(1);
    on_event(&Event::RunStarted {
        graph: plan.file.display().to_string(),
        calls: cone.len(),
        shown: wanted.iter().map(|call| plan.name(*call).to_owned()).collect(),
        jobs,
    });
    let (reports, inbox) = unbounded();
    let shared = Shared {
        plan,
        cache,
        sources,
        cancel,
        stuck: AtomicBool::new(false),
        jobs,
        fail_fast: options.fail_fast,
        held: Held::new(options.memory),
        loading: cone.calls().map(|call| (call, Mutex::new(()))).collect(),
        permits: Permits::new(jobs),
        reports,
    };
    let mut coordinator = Coordinator::new(&shared, cone, on_event);
    std::thread::scope(|scope| {
        // Dropping the sender at the end of this scope sends the workers home.
        let (job_out, job_in) = unbounded();
        for _ in 0..jobs.min(coordinator.len().max(1)) {
            let (shared, job_in) = (&shared, job_in.clone());
            scope.spawn(move || job_in.iter().for_each(|job| shared.work(job)));
        }
        drive(&mut coordinator, &shared, &job_out, &inbox, &mut running);
    });
    let Ended { states, evicted, fatal } = coordinator.finish();
    if let Some(error) = fatal {
        return Err(error);
    }
    let totals = count(&states);
    let when = millis(started);
    let course = Course { plan, wanted, order: &order, states: &states, evicted: &evicted, sources, when, jobs };
    let record = course.record(cache, clock.elapsed())?;
    record.write(cache)?;
    let seconds = clock.elapsed().as_secs_f64();
    let held = shared.held;
    on_event(&Event::RunFinished { totals, seconds });
    Ok(Outcome { states, totals, seconds, cancelled: cancel.is_cancelled(), record, held })
}

/// Hands out jobs and takes in reports until there is nothing left to do.
fn drive(
    coordinator: &mut Coordinator,
    shared: &Shared,
    jobs: &Sender<Job>,
    inbox: &Receiver<Report>,
    running: &mut Running,
) {
    let mut busy = 0;
    loop {
        running.beat();
        if coordinator.is_stuck() {
            shared.stuck.store(true, Ordering::Relaxed);
        }
        while !shared.stopping() && coordinator.has_ready() {
            if shared.permits.take(1) == 0 {
                break;
            }
            let Some(job) = coordinator.next() else {
                shared.permits.give(1);
                continue;
            };
            busy += 1;
            // The receivers live in the workers, which end only after this sender is gone.
            let _ = jobs.send(job);
        }
        if busy == 0 {
            return;
        }
        match inbox.recv_timeout(TICK) {
            Ok(Report::Event(event)) => coordinator.emit(&event),
            Ok(Report::Done(call, result)) => {
                busy -= 1;
                shared.permits.give(1);
                coordinator.done(call, result);
            }
            Ok(Report::Idle) | Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

pub(super) fn count(states: &BTreeMap<NodeIndex, State>) -> Totals {
    let mut totals = Totals::default();
    for state in states.values() {
        *match state {
            State::Hit(_) => &mut totals.hits,
            State::Computed(_) => &mut totals.computed,
            State::Failed(_) => &mut totals.failed,
            State::Skipped(_) => &mut totals.skipped,
            State::Cancelled => &mut totals.cancelled,
        } += 1;
    }
    totals
}

/// The digest of a settled call, for the next ones.
pub(super) fn digest_of(state: &State) -> Option<Digest> {
    state.record().map(|record| record.digest)
}
