//! Runs a graph again whenever one of its inputs changes.
//!
//! | module | does |
//! |---|---|
//! | `places` | which folders to watch for which files |
//! | `notice` | notices from the system |
//! | `listen` | beside a run: looks, and stops what an edit has superseded |
//! | `spare` | which running nodes are worth finishing all the same |
//!
//! Notices only say when to look; what has changed is found by looking. Planning is a function of what
//! [`Observed`] lists, and a run of what its [`Sources`] pinned, so both are looked at again by content, and
//! notices may come twice, late, for other files, or get lost: then it takes until the next look at all, which
//! comes every two seconds. Results are announced only if, at one moment after the run, everything was as the
//! run had seen it.

mod listen;
mod notice;
mod places;
mod spare;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};
use salient_sdk::Registry;

use crate::diagnostics::Diagnostics;
use crate::engine::fingerprints::Fingerprints;
use crate::engine::sources::{Change, Sources};
use crate::engine::{Cache, CacheError, Digest, Event, Options, Outcome};
use crate::graph::{Difference, Observed, Overrides, Plan, plan_observed};
use notice::{Message, Notices};
use places::{Places, is_remote};

/// An edit is over when nothing was noticed for so long: editors save in several steps.
const QUIET: Duration = Duration::from_millis(25);
/// But no longer than this after its first notice.
const LONGEST_EDIT: Duration = Duration::from_millis(500);
/// Between the steps of saving a file no more time passes than this, mostly.
const BETWEEN_STEPS: Duration = Duration::from_millis(150);
/// How often everything is looked at where the system gives notice.
const WITH_NOTICES: Duration = Duration::from_secs(2);
/// The same where it does not, or only of what this host does.
const WITHOUT_NOTICES: Duration = Duration::from_millis(500);

/// What to watch.
pub struct Subject<'a> {
    /// The graph file.
    pub graph: PathBuf,
    /// Changes from outside.
    pub overrides: Overrides,
    /// The kinds of node.
    pub registry: &'a Registry,
    /// The cache directory.
    pub cache: PathBuf,
    /// How fast to compute.
    pub options: Options,
    /// Do not wait for notices of the system, but look so often.
    pub poll: Option<Duration>,
}

/// Who is told. Several (terminal, JSON lines, a page) can be one that passes on.
pub trait Observer: Send {
    /// Something happened. Events come in order, though from several threads.
    fn event(&mut self, event: &Event);
    /// A run has seen one state of its inputs, and this came of it. Returns the files that it wrote, which are
    /// never inputs.
    fn outcome(&mut self, plan: &Plan, outcome: &Outcome, cache: &Cache) -> Vec<PathBuf>;
}

/// Ends a watch from another thread.
#[derive(Clone)]
pub struct Stop {
    inbox: Sender<Message>,
    stopped: Arc<AtomicBool>,
}

impl Stop {
    /// Stops what is running and ends the watch.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Release);
        // If nobody listens any more, the watch has ended.
        let _ = self.inbox.send(Message::Stop);
    }

    /// Whether it was called.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Acquire)
    }
}

/// A plan, or what is wrong with the graph, and what that follows from.
struct Planned {
    result: Result<Plan, Diagnostics>,
    observed: Observed,
}

/// Inputs that are not as they were.
#[derive(Default)]
struct Changes {
    planning: Vec<Difference>,
    files: Vec<Change>,
}

/// What came of a run.
struct After {
    /// The files that it read.
    sources: Sources,
    /// Whether another run is due.
    again: bool,
    /// The graph was planned anew meanwhile.
    next: Option<Planned>,
}

type Told<'a> = Mutex<&'a mut dyn Observer>;

/// A watch.
pub struct Watch<'a> {
    subject: Subject<'a>,
    inbox: Receiver<Message>,
    stop: Stop,
    notices: Mutex<Notices>,
    known: Arc<Fingerprints>,
    /// Own output.
    written: BTreeSet<PathBuf>,
    /// Changes that were told since the last run began, with the content then.
    told: Mutex<BTreeMap<PathBuf, Option<Digest>>>,
    /// Notices do not reach far enough.
    deaf: AtomicBool,
    /// The cache failed in the last run.
    retried: bool,
}

impl<'a> Watch<'a> {
    /// Nothing is done before [`Watch::run`].
    #[must_use]
    pub fn new(subject: Subject<'a>) -> Self {
        let (sender, inbox) = unbounded();
        let (notices, deaf) = match subject.poll {
            Some(_) => (Notices::none(), true),
            None => Notices::new(sender.clone()),
        };
        Self {
            subject,
            inbox,
            stop: Stop { inbox: sender, stopped: Arc::default() },
            notices: Mutex::new(notices),
            known: Arc::new(Fingerprints::new()),
            written: BTreeSet::new(),
            told: Mutex::default(),
            deaf: AtomicBool::new(deaf),
            retried: false,
        }
    }

    /// Ends it from elsewhere.
    #[must_use]
    pub fn stopper(&self) -> Stop {
        self.stop.clone()
    }

    /// Watches until it is stopped. The error is a cache that cannot be used.
    pub fn run(mut self, observer: &mut dyn Observer) -> Result<(), CacheError> {
        let observer = Mutex::new(observer);
        let mut planned = self.plan(&observer);
        let mut sources = None;
        while !self.stop.is_stopped() {
            if let Ok(plan) = &planned.result {
                let after = self.once(plan, &planned.observed, &observer)?;
                sources = Some(after.sources);
                if let Some(next) = after.next {
                    planned = next;
                }
                if after.again && planned.result.is_ok() {
                    continue;
                }
            }
            // A graph that cannot be run reads no files.
            let files = sources.as_ref().filter(|_| planned.result.is_ok());
            let Some(changes) = self.idle(&planned.observed, files, &observer) else { break };
            if !changes.planning.is_empty() {
                planned = self.plan(&observer);
            }
        }
        Ok(())
    }

    /// Plans, and tells what is wrong with the graph.
    fn plan(&self, observer: &Told) -> Planned {
        let Subject { graph, overrides, registry, .. } = &self.subject;
        let (result, observed) = plan_observed(graph, overrides, registry);
        if let Err(diagnostics) = &result {
            let event = Event::Broken { diagnostics: diagnostics.json(), text: diagnostics.render(false) };
            lock(observer).event(&event);
        }
        Planned { result, observed }
    }

    /// Runs a plan, and announces what came of it if it is still true.
    fn once(&mut self, plan: &Plan, observed: &Observed, observer: &Told) -> Result<After, CacheError> {
        lock(&self.told).clear();
        self.attend(observed, None);
        let cache = Cache::open(&self.subject.cache)?;
        let (outcome, sources, newest) = match self.listen(plan, observed, &cache, observer) {
            (Ok(outcome), sources, newest) => (outcome, sources, newest),
            (Err(error), ..) if self.retried => return Err(error),
            // Somebody may have removed the cache under the run.
            (Err(_), sources, next) => {
                self.retried = true;
                return Ok(After { sources, again: true, next });
            }
        };
        self.retried = false;
        let latest = newest.as_ref().map_or(observed, |newest| &newest.observed);
        self.attend(latest, Some(&sources));
        let changes = self.look(latest, Some(&sources));
        self.tell(&changes, false, observer);
        let next = if changes.planning.is_empty() { newest } else { Some(self.plan(observer)) };
        let is_true = changes.files.is_empty() && !outcome.cancelled;
        let superseded = next.as_ref().is_some_and(|next| next.result.is_ok());
        // A graph that was broken meanwhile does not make the results of the former one untrue.
        if is_true && !superseded {
            let written = lock(observer).outcome(plan, &outcome, &cache);
            self.written.extend(written.iter().filter_map(|path| std::path::absolute(path).ok()));
        }
        Ok(After { sources, again: !is_true || superseded, next })
    }

    /// Waits for a change. `None` if the watch was stopped.
    fn idle(&self, observed: &Observed, sources: Option<&Sources>, observer: &Told) -> Option<Changes> {
        let mut announced = false;
        loop {
            // What changes before the system is asked for notices is found by looking.
            let (files, folders) = self.attend(observed, sources);
            let changes = self.look(observed, sources);
            if !changes.is_empty() {
                self.tell(&changes, false, observer);
                return Some(changes);
            }
            if !announced {
                let (graph, every) = (self.subject.graph.display().to_string(), self.period().as_secs_f64());
                lock(observer).event(&Event::Watching { graph, files, folders, every });
                announced = true;
            }
            self.wait();
            if self.stop.is_stopped() {
                return None;
            }
        }
    }

    /// The next message, when what came with it has settled.
    fn wait(&self) -> Message {
        let first = match self.inbox.recv_timeout(self.period()) {
            Ok(Message::Look) => Instant::now(),
            Ok(message) => return message,
            Err(_) => return Message::Look,
        };
        while first.elapsed() < LONGEST_EDIT {
            match self.inbox.recv_timeout(QUIET) {
                Ok(Message::Look) => {}
                Ok(message) => return message,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => break,
            }
        }
        Message::Look
    }

    fn period(&self) -> Duration {
        let deaf = self.deaf.load(Ordering::Relaxed);
        self.subject.poll.unwrap_or(if deaf { WITHOUT_NOTICES } else { WITH_NOTICES })
    }

    /// Asks for notices of all that was looked at; says how many files and folders that is.
    fn attend(&self, observed: &Observed, sources: Option<&Sources>) -> (usize, usize) {
        let mut files: BTreeSet<PathBuf> = observed.files().map(Path::to_owned).collect();
        files.extend(sources.map(Sources::files).unwrap_or_default());
        let mut places = Places::default();
        for file in &files {
            places.file(file);
        }
        for folder in observed.folders() {
            places.folder(&folder);
        }
        let counts = (files.len(), places.folders.len());
        let mounts = std::fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
        let remote = places.folders.iter().any(|folder| is_remote(folder, &mounts));
        if lock(&self.notices).attend(places).is_err() || remote {
            self.deaf.store(true, Ordering::Relaxed);
        }
        counts
    }

    /// Looks at everything again. What is gone or empty may be about to be written, so it is looked at twice.
    fn look(&self, observed: &Observed, sources: Option<&Sources>) -> Changes {
        let changes = self.look_once(observed, sources);
        if !changes.may_be_half() {
            return changes;
        }
        std::thread::sleep(BETWEEN_STEPS);
        self.look_once(observed, sources)
    }

    fn look_once(&self, observed: &Observed, sources: Option<&Sources>) -> Changes {
        let own = |path: &Path| std::path::absolute(path).is_ok_and(|path| self.written.contains(&path));
        let mut planning = observed.differences();
        planning.retain(|difference| !own(difference.path()));
        let mut files = sources.map(Sources::changes).unwrap_or_default();
        files.retain(|change| !own(&change.path));
        Changes { planning, files }
    }

    /// Tells of changes, each once.
    fn tell(&self, changes: &Changes, running: bool, observer: &Told) {
        let (mut changed, mut added, mut removed) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
        let mut told = lock(&self.told);
        for Change { path, before, now } in &changes.files {
            if told.insert(path.clone(), *now).is_some_and(|before| before == *now) {
                continue;
            }
            let list = match (before, now) {
                (_, None) => &mut removed,
                (None, _) => &mut added,
                _ => &mut changed,
            };
            list.insert(path.display().to_string());
        }
        for difference in &changes.planning {
            let list = match difference {
                Difference::Added(_) => &mut added,
                Difference::Removed(_) => &mut removed,
                Difference::Graph(_) | Difference::Folder(_) => &mut changed,
            };
            list.insert(difference.path().display().to_string());
        }
        if changed.len() + added.len() + removed.len() > 0 {
            let [changed, added, removed] = [changed, added, removed].map(|list| list.into_iter().collect());
            lock(observer).event(&Event::Changed { changed, added, removed, running });
        }
    }
}

impl Changes {
    /// Whether a file is gone or empty: some programs save by removing or emptying the file first.
    fn may_be_half(&self) -> bool {
        let is_bare = |path: &Path| std::fs::metadata(path).map_or(true, |meta| meta.len() == 0);
        let planning = |difference: &Difference| match difference {
            Difference::Added(path) | Difference::Graph(path) => is_bare(path),
            Difference::Removed(_) => true,
            Difference::Folder(_) => false,
        };
        self.planning.iter().any(planning) || self.files.iter().any(|change| is_bare(&change.path))
    }

    fn is_empty(&self) -> bool {
        self.planning.is_empty() && self.files.is_empty()
    }
}

fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
