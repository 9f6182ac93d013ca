//! Beside a run: looks at its inputs, and stops what an edit has superseded.

use std::collections::BTreeSet;
use std::sync::Mutex;

use crossbeam::channel::Sender;

use super::notice::Message;
use super::spare::{World, spared};
use super::{Changes, Planned, Told, Watch, lock};
use crate::engine::sources::Sources;
use crate::engine::{Cache, CacheError, Cancel, Event, Outcome, run_on};
use crate::graph::{Observed, Plan};

/// A run that is going on.
struct Current<'a> {
    plan: &'a Plan,
    observed: &'a Observed,
    sources: &'a Sources,
    cancel: &'a Cancel,
    /// Addresses of the nodes that are running.
    running: &'a Mutex<BTreeSet<String>>,
}

impl Watch<'_> {
    /// Runs a plan until it is done or superseded, with the files that it read and, if the graph has changed
    /// meanwhile, what was made of it.
    pub(super) fn listen(
        &self,
        plan: &Plan,
        observed: &Observed,
        cache: &Cache,
        observer: &Told,
    ) -> (Result<Outcome, CacheError>, Sources, Option<Planned>) {
        let cancel = Cancel::new();
        let sources = Sources::watched(self.known.clone(), {
            let (cancel, inbox) = (cancel.clone(), self.stop.inbox.clone());
            move || {
                cancel.hold();
                // The watch outlives its runs.
                let _ = inbox.send(Message::Look);
            }
        });
        let running = Mutex::new(BTreeSet::new());
        let current = Current { plan, observed, sources: &sources, cancel: &cancel, running: &running };
        let wanted: Vec<_> = plan.show.iter().map(|shown| shown.call).collect();
        let (outcome, newest) = std::thread::scope(|scope| {
            let listener = scope.spawn(|| self.beside(&current, observer));
            let over = Over(&self.stop.inbox);
            let outcome = run_on(plan, &wanted, cache, self.subject.options, &cancel, &sources, &mut |event| {
                note(&running, event);
                lock(observer).event(event);
            });
            drop(over);
            let newest = listener.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            (outcome, newest)
        });
        (outcome, sources, newest)
    }

    /// Listens until the run is over. Returns the newest planning, if there was one.
    fn beside(&self, current: &Current, observer: &Told) -> Option<Planned> {
        let mut newest: Option<Planned> = None;
        loop {
            match self.wait() {
                Message::Over => return newest,
                Message::Stop => current.cancel.cancel(),
                Message::Look => {}
            }
            if self.stop.is_stopped() {
                continue;
            }
            let observed = newest.as_ref().map_or(current.observed, |newest| &newest.observed);
            let changes = self.look(observed, Some(current.sources));
            if changes.is_empty() {
                continue;
            }
            self.tell(&changes, true, observer);
            if !changes.planning.is_empty() {
                newest = Some(self.plan(observer));
            }
            self.supersede(current, newest.as_ref(), &changes);
        }
    }

    /// Stops the run, but lets nodes finish that are wanted as they are. While the graph is broken and no file
    /// has changed, the run goes on.
    fn supersede(&self, current: &Current, newest: Option<&Planned>, changes: &Changes) {
        let plan = match newest.map(|newest| &newest.result) {
            Some(Ok(plan)) => plan,
            Some(Err(_)) if changes.files.is_empty() => return,
            _ => current.plan,
        };
        let fresh = Sources::watched(self.known.clone(), || {});
        let before = World { plan: current.plan, sources: current.sources };
        let running = lock(current.running).clone();
        let spared = spared(before, World { plan, sources: &fresh }, &running, &changes.files);
        current.cancel.cancel_but(spared);
    }
}

fn note(running: &Mutex<BTreeSet<String>>, event: &Event) {
    match event {
        Event::Started { node, .. } => drop(lock(running).insert(node.clone())),
        Event::Finished { node, .. } | Event::Failed { node, .. } => drop(lock(running).remove(node)),
        _ => {}
    }
}

/// Says that the run is over, also if it panicked: the listener must not wait for ever.
struct Over<'a>(&'a Sender<Message>);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        // The inbox is part of the watch, which outlives its runs.
        let _ = self.0.send(Message::Over);
    }
}
