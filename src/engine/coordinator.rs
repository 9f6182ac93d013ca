//! Decides what is to be done next: the state of every call of a run.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};
use std::sync::Arc;

use petgraph::graph::NodeIndex;
use salient_sdk::NodeError;

use super::cache::CacheError;
use super::cone::{Cone, Root};
use super::estimate::Estimate;
use super::event::Event;
use super::key::{Digest, Ingredients};
use super::record::Record;
use super::schedule::{State, digest_of};
use super::worker::{Done, Halt, Job, Shared};

/// How often a call may find that its inputs vanished from the cache before it gives up.
const MAX_LACKS: usize = 8;

/// What a call is about to do.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Step {
    Execute,
    Load,
    Resolve,
}

struct Progress {
    /// Producers whose output it waits for: not yet known, or to be computed again.
    waiting: BTreeSet<NodeIndex>,
    /// How it ended; may be opened again when its output was evicted and is needed after all.
    state: Option<State>,
    ingredients: Option<Arc<Ingredients>>,
    /// Its output is recorded but gone: execute whatever the lookup says.
    forced: bool,
    /// Consumers that may still take its output.
    pending: BTreeSet<NodeIndex>,
    lacks: usize,
    /// It has looked again, as an equal call was computed while it looked.
    looked_again: bool,
}

/// Lookups first (they are cheap and show what there is to do), then what rests on the most urgent root, and of that the most urgent call.
type Rank = (Step, Root, u64, Reverse<NodeIndex>);

/// How a run ended.
pub(super) struct Ended {
    pub states: BTreeMap<NodeIndex, State>,
    /// Calls executed again because their bytes were gone, with a call that needed them.
    pub evicted: BTreeMap<NodeIndex, NodeIndex>,
    /// Why the cache failed, if it did.
    pub fatal: Option<CacheError>,
}

pub(super) struct Coordinator<'a> {
    shared: &'a Shared<'a>,
    cone: Cone,
    calls: BTreeMap<NodeIndex, Progress>,
    ready: BinaryHeap<Rank>,
    /// For each key being computed: by whom, and who waits for it.
    in_flight: BTreeMap<Digest, (NodeIndex, Vec<NodeIndex>)>,
    /// Calls whose output was known but gone, with a call that needed it.
    evicted: BTreeMap<NodeIndex, NodeIndex>,
    /// Whether a call failed.
    broken: bool,
    estimate: Estimate,
    /// Keys computed in this run.
    made: BTreeSet<Digest>,
    fatal: Option<CacheError>,
    on_event: &'a mut dyn FnMut(&Event),
}

impl<'a> Coordinator<'a> {
    pub(super) fn new(shared: &'a Shared<'a>, cone: Cone, on_event: &'a mut dyn FnMut(&Event)) -> Self {
        let progress = |call| {
            let place = cone.place(call);
            let progress = Progress {
                waiting: place.producers.clone(),
                state: None,
                ingredients: None,
                forced: false,
                pending: place.consumers.clone(),
                lacks: 0,
                looked_again: false,
            };
            (call, progress)
        };
        let calls = cone.calls().map(progress).collect();
        let known = |call: NodeIndex| (shared.plan.dag[call].node.kind(), cone.place(call).cost);
        let estimate = Estimate::new(cone.calls().map(known), shared.jobs);
        let (ready, in_flight, evicted, made) = Default::default();
        let (broken, fatal) = (false, None);
        let mut it = Self { shared, cone, calls, ready, in_flight, evicted, broken, estimate, made, fatal, on_event };
        let sources: Vec<_> = it.cone.calls().filter(|call| it.calls[call].waiting.is_empty()).collect();
        for call in sources {
            it.push(Step::Resolve, call);
        }
        it
    }

    pub(super) fn len(&self) -> usize {
        self.calls.len()
    }

    pub(super) fn has_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    /// Whether going on makes no sense: the cache failed, or a call did and that is to stop the run.
    pub(super) fn is_stuck(&self) -> bool {
        self.fatal.is_some() || (self.broken && self.shared.fail_fast)
    }

    pub(super) fn emit(&mut self, event: &Event) {
        (self.on_event)(event);
    }

    /// How it all ended.
    pub(super) fn finish(self) -> Ended {
        let state = |it: Progress| it.state.unwrap_or(State::Cancelled);
        let states = self.calls.into_iter().map(|(call, it)| (call, state(it))).collect();
        Ended { states, evicted: self.evicted, fatal: self.fatal }
    }

    fn push(&mut self, step: Step, call: NodeIndex) {
        let place = self.cone.place(call);
        self.ready.push((step, place.root, place.urgency.max(0.0).to_bits(), Reverse(call)));
    }

    fn at(&mut self, call: NodeIndex) -> &mut Progress {
        self.calls.get_mut(&call).expect("only calls of the cone are scheduled")
    }

    fn digest(&self, call: NodeIndex) -> Option<Digest> {
        self.calls[&call].state.as_ref().and_then(digest_of)
    }

    /// The most urgent job.
    ///
    /// `None` if the next call turned out to rest on one that has failed since.
    pub(super) fn next(&mut self) -> Option<Job> {
        let (step, .., Reverse(call)) = self.ready.pop()?;
        let place = self.cone.place(call);
        let producers = &place.producers;
        // What is known already needs no inputs.
        let needed = |p: &&NodeIndex| step != Step::Load && !place.dispensable.contains(p);
        if let Some(because) = producers.iter().filter(needed).find_map(|p| self.blame(*p)) {
            self.skip(call, &because);
            return None;
        }
        let inputs = producers.iter().filter_map(|p| Some((*p, self.digest(*p)?))).collect();
        match step {
            Step::Resolve => Some(Job::Resolve { call, inputs }),
            Step::Load => Some(Job::Load { call, digest: self.digest(call)? }),
            Step::Execute => {
                let ingredients = self.at(call).ingredients.clone()?;
                Some(Job::Execute { call, inputs, ingredients })
            }
        }
    }

    /// Takes in what came of a job.
    pub(super) fn done(&mut self, call: NodeIndex, result: Result<Done, Halt>) {
        match result {
            Ok(Done::Hit(ingredients, record)) => self.hit(call, ingredients, record),
            Ok(Done::Miss(ingredients)) => self.miss(call, ingredients),
            Ok(Done::Loaded) => self.announce_hit(call),
            Ok(Done::Lacks(producers)) => self.lacks(call, &producers),
            Ok(Done::Computed(record)) => self.computed(call, record),
            Err(Halt::Node(error)) => self.failed(call, error),
            Err(Halt::Cache(error)) => {
                self.fatal.get_or_insert(error);
            }
        }
        if self.estimate.is_due() {
            let (done, calls) = (self.estimate.done(), self.calls.len());
            self.emit(&Event::Tally { done, calls, remaining: self.estimate.remaining() });
        }
    }

    /// Says how a call ended. Outputs that are brought back count only once.
    fn end(&mut self, call: NodeIndex, state: State) {
        if self.calls[&call].state.is_none() {
            let seconds = match &state {
                State::Computed(record) => Some(record.seconds),
                _ => None,
            };
            self.estimate.settle(self.shared.plan.dag[call].node.kind(), seconds);
        }
        self.at(call).state = Some(state);
    }

    fn hit(&mut self, call: NodeIndex, ingredients: Arc<Ingredients>, record: Box<Record>) {
        if self.calls[&call].forced {
            return self.miss(call, ingredients);
        }
        self.release_followers(call);
        let it = self.at(call);
        it.ingredients = Some(ingredients);
        self.end(call, State::Hit(record));
        if self.cone.place(call).wanted {
            self.push(Step::Load, call);
        } else {
            self.announce_hit(call);
        }
        self.settled(call);
    }

    fn announce_hit(&mut self, call: NodeIndex) {
        let Some(digest) = self.digest(call) else { return };
        let (node, kind) = self.title(call);
        self.emit(&Event::Hit { node, kind, digest });
    }

    fn miss(&mut self, call: NodeIndex, ingredients: Arc<Ingredients>) {
        let key = ingredients.key();
        if self.calls[&call].ingredients.as_ref().is_some_and(|before| before.key() != key) {
            self.release_followers(call);
        }
        self.at(call).ingredients = Some(ingredients);
        let forced = self.calls[&call].forced;
        match self.in_flight.get_mut(&key) {
            // A forced call follows nobody: its leader may be waiting for this very output, as a
            // call may have the key of its own input (idempotent nodes).
            Some((leader, followers)) if *leader != call && !forced => followers.push(call),
            // It may have looked just before that was stored. Once only: not every output is recorded.
            None if !forced && self.made.contains(&key) && !self.calls[&call].looked_again => {
                self.at(call).looked_again = true;
                self.push(Step::Resolve, call);
            }
            _ => {
                self.in_flight.entry(key).or_insert((call, Vec::new()));
                self.push(Step::Execute, call);
            }
        }
    }

    /// Equal calls that waited for this one look again.
    fn release_followers(&mut self, call: NodeIndex) {
        let Some(ingredients) = &self.calls[&call].ingredients else { return };
        let key = ingredients.key();
        if self.in_flight.get(&key).is_none_or(|(leader, _)| *leader != call) {
            return;
        }
        let (_, followers) = self.in_flight.remove(&key).unwrap_or_default();
        for follower in followers {
            // What this call has stored serves the follower too.
            self.at(follower).forced = false;
            self.push(Step::Resolve, follower);
        }
    }

    /// Outputs that are needed are gone: their calls run again, then this one looks again.
    fn lacks(&mut self, call: NodeIndex, producers: &[NodeIndex]) {
        self.at(call).lacks += 1;
        if self.calls[&call].lacks > MAX_LACKS {
            let message = "what it needs keeps vanishing from the cache while the run lasts";
            return self.failed(call, NodeError::passing(message));
        }
        for producer in producers.iter().copied() {
            if let Some(because) = self.blame(producer) {
                return self.skip(call, &because);
            }
            // It may have been computed again just after this call looked for its output.
            let again = matches!(self.calls[&producer].state, Some(State::Computed(_)))
                && !self.calls[&producer].forced
                && self.calls[&call].lacks == 1;
            if !again {
                if producer != call {
                    self.at(call).waiting.insert(producer);
                }
                self.evicted.entry(producer).or_insert(call);
                self.force(producer);
            }
        }
        if self.calls[&call].waiting.is_empty() && !self.calls[&call].forced {
            self.push(Step::Resolve, call);
        }
    }

    /// Executes a call whose output is known but gone.
    fn force(&mut self, call: NodeIndex) {
        if self.calls[&call].forced {
            return;
        }
        let it = self.at(call);
        it.forced = true;
        // Its inputs are wanted once more.
        for producer in self.cone.place(call).producers.clone() {
            self.at(producer).pending.insert(call);
        }
        match self.calls[&call].ingredients.clone() {
            Some(ingredients) => self.miss(call, ingredients),
            None => self.push(Step::Resolve, call),
        }
    }

    fn computed(&mut self, call: NodeIndex, record: Box<Record>) {
        self.made.insert(record.ingredients.key());
        self.release_followers(call);
        let (node, kind) = self.title(call);
        let event = Event::Finished {
            node: node.clone(),
            kind,
            seconds: record.seconds,
            bytes: record.bytes,
            digest: record.digest,
            figures: record.figures.clone(),
        };
        self.emit(&event);
        let before = self.digest(call);
        if let Some(recorded) = before.filter(|before| *before != record.digest) {
            self.emit(&Event::Irreproducible { node, recorded, now: record.digest });
        }
        self.at(call).forced = false;
        self.end(call, State::Computed(record));
        self.settled(call);
    }

    /// The output of a call is known: whoever waits for it may be next, and what it took can go.
    fn settled(&mut self, call: NodeIndex) {
        for consumer in self.cone.place(call).consumers.clone() {
            self.no_longer_waits(consumer, call);
        }
        self.let_go(call);
    }

    /// Drops from memory what nobody will take any more.
    fn let_go(&mut self, call: NodeIndex) {
        for producer in self.cone.place(call).producers.clone() {
            self.at(producer).pending.remove(&call);
            self.drop_unneeded(producer);
        }
        self.drop_unneeded(call);
    }

    fn drop_unneeded(&self, call: NodeIndex) {
        if self.calls[&call].pending.is_empty() && !self.cone.place(call).wanted {
            self.shared.held.drop_one(call);
        }
    }

    fn failed(&mut self, call: NodeIndex, error: NodeError) {
        self.release_followers(call);
        if error.cancelled && self.shared.stopping() {
            // What rests on it is not done either; nobody is to blame.
            self.end(call, State::Cancelled);
            return;
        }
        self.broken = true;
        let (node, kind) = self.title(call);
        let (message, help) = (error.message.clone(), error.help.clone());
        let files = self.shared.plan.dag[call].files.values().map(|path| path.display().to_string()).collect();
        self.emit(&Event::Failed { node: node.clone(), kind, files, message, help });
        self.end(call, State::Failed(error));
        self.let_go(call);
        self.skip_after(call, &node);
    }

    /// The address of the failed call because of which this one has no output, if so.
    fn blame(&self, call: NodeIndex) -> Option<String> {
        match &self.calls[&call].state {
            Some(State::Failed(_)) => Some(self.title(call).0),
            Some(State::Skipped(because)) => Some(because.clone()),
            _ => None,
        }
    }

    fn skip(&mut self, call: NodeIndex, because: &str) {
        if matches!(self.calls[&call].state, Some(State::Skipped(_))) {
            return;
        }
        self.release_followers(call);
        let (node, kind) = self.title(call);
        self.emit(&Event::Skipped { node, kind, because: because.to_owned() });
        self.end(call, State::Skipped(because.to_owned()));
        self.let_go(call);
        self.skip_after(call, because);
    }

    /// Skips what waits for this call's output, unless it does without. A consumer that took the output before it was lost
    /// goes on.
    fn skip_after(&mut self, call: NodeIndex, because: &str) {
        for consumer in self.cone.place(call).consumers.clone() {
            if !self.calls[&consumer].waiting.contains(&call) {
                continue;
            }
            if self.cone.place(consumer).dispensable.contains(&call) {
                self.no_longer_waits(consumer, call);
            } else {
                self.skip(consumer, because);
            }
        }
    }

    /// A consumer has all that it gets from a producer, and may be next.
    fn no_longer_waits(&mut self, consumer: NodeIndex, producer: NodeIndex) {
        let it = self.at(consumer);
        if it.waiting.remove(&producer) && it.waiting.is_empty() {
            self.push(Step::Resolve, consumer);
        }
    }

    fn title(&self, call: NodeIndex) -> (String, String) {
        let plan = self.shared.plan;
        (plan.name(call).to_owned(), plan.dag[call].node.kind().to_owned())
    }
}
