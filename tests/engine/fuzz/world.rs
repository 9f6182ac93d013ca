//! A model on disk with a cache, and what is known of that cache.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use salient::engine::upkeep::Limits;
use salient::engine::{Cache, Cancel, Event, Options, Outcome, State, run};
use salient::graph::{Overrides, Plan, plan};
use salient_sdk::{AnyNode, Registry};
use tempfile::TempDir;

use super::model::{Call, Dice, Model, Output};
use crate::toy::{Numbers, Read, Scale, Sign, Sum, Wide};

static FIRST: &[&dyn AnyNode] = &[&Read, &Scale::<1>, &Sign, &Sum, &Wide];
static SECOND: &[&dyn AnyNode] = &[&Read, &Scale::<2>, &Sign, &Sum, &Wide];

/// The nodes, with `scale` in some version.
pub fn registry(version: u32) -> Registry {
    Registry::new(&[if version == 1 { FIRST } else { SECOND }]).unwrap()
}

pub struct World {
    pub dir: TempDir,
    pub model: Model,
    pub dice: Dice,
    options: Options,
    /// Where the record of an identity, and the object of an output, are or were.
    records: BTreeMap<String, PathBuf>,
    objects: BTreeMap<Output, PathBuf>,
    /// What is there, and whole.
    recorded: BTreeSet<String>,
    stored: BTreeSet<Output>,
    story: Vec<String>,
}

/// Writes the files of a model, and removes others.
pub fn write(dir: &Path, model: &Model) {
    let files = model.files();
    fs::create_dir_all(dir.join("in")).unwrap();
    for entry in fs::read_dir(dir.join("in")).unwrap() {
        let path = entry.unwrap().path();
        if !files.contains_key(&format!("in/{}", path.file_name().unwrap().to_string_lossy())) {
            fs::remove_file(path).unwrap();
        }
    }
    for (name, text) in files {
        let path = dir.join(name);
        // A file that is as it was is touched or not; one that is not is replaced.
        if fs::read_to_string(&path).ok().as_ref() != Some(&text) {
            fs::write(dir.join("new"), text).unwrap();
            fs::rename(dir.join("new"), path).unwrap();
        }
    }
}

struct Ran {
    outcome: Outcome,
    /// Addresses of executed calls, in order.
    started: Vec<String>,
    failed: BTreeSet<String>,
}

impl World {
    pub fn new(seed: u64) -> Self {
        let mut dice = Dice(seed.wrapping_mul(0x5851_f42d_4c95_7f2d));
        let model = Model::new(&mut dice);
        let options = Options { jobs: 2, ..Options::default() };
        let story = vec![format!("seed {seed}")];
        let (records, objects, recorded, stored) = Default::default();
        let dir = tempfile::tempdir().unwrap();
        Self { dir, model, dice, options, records, objects, recorded, stored, story }
    }

    /// So many random steps.
    pub fn play(&mut self, steps: usize) {
        self.check();
        for _ in 0..steps {
            let what = match self.dice.roll(10) {
                0..=5 => self.model.edit(&mut self.dice),
                6 => self.damage(),
                7 => self.collect(),
                8 => {
                    self.options.jobs = 1 + self.dice.roll(4);
                    self.options.memory = [0, 1 << 30][self.dice.roll(2)];
                    format!("{:?}", self.options)
                }
                _ => {
                    // An edit of which the run is stopped.
                    let what = self.model.edit(&mut self.dice);
                    let after = self.dice.roll(12);
                    self.story.push(what);
                    self.stopped(after);
                    format!("stopped after {after} events")
                }
            };
            self.story.push(what);
            self.check();
        }
    }

    fn cache(&self) -> Cache {
        Cache::open(&self.dir.path().join("cache")).unwrap()
    }

    fn plan(&self) -> Plan {
        write(self.dir.path(), &self.model);
        let overrides = Overrides { sets: self.model.sets(), variants: None };
        let graph = self.dir.path().join("g.ron");
        plan(&graph, &overrides, &registry(self.model.version)).unwrap_or_else(|e| panic!("{e}\n{:#?}", self.story))
    }

    fn run(&self, plan: &Plan, cache: &Cache, options: Options, stop_after: usize) -> Ran {
        let wanted: Vec<_> = plan.show.iter().map(|shown| shown.call).collect();
        let (mut started, mut failed, cancel) = (Vec::new(), BTreeSet::new(), Cancel::new());
        let left = AtomicUsize::new(stop_after);
        let mut on_event = |event: &Event| {
            match event {
                Event::Started { node, .. } => started.push(node.clone()),
                Event::Failed { node, .. } => drop(failed.insert(node.clone())),
                Event::Irreproducible { .. } => panic!("{event:?}\n{:#?}", self.story),
                _ => {}
            }
            if left.fetch_sub(1, Ordering::Relaxed) == 0 {
                cancel.cancel();
            }
        };
        let outcome = run(plan, &wanted, cache, options, &cancel, &mut on_event).unwrap();
        Ran { outcome, started, failed }
    }

    fn check(&mut self) {
        let (plan, cache, calls) = (self.plan(), self.cache(), self.model.evaluate());
        let shown: BTreeSet<_> = plan.show.iter().map(|shown| shown.address.clone()).collect();
        assert_eq!(shown, self.model.shown().into_iter().collect(), "{:#?}", self.story);
        let ran = self.run(&plan, &cache, self.options, usize::MAX);
        self.judge(&plan, &calls, &ran, true);
        self.learn(&plan, &cache, &calls, &ran);
        // The same as from an empty cache.
        let empty = tempfile::tempdir().unwrap();
        let other = Cache::open(empty.path()).unwrap();
        let options = Options { jobs: 1, ..Options::default() };
        let fresh = self.run(&plan, &other, options, usize::MAX);
        assert_eq!(ran.failed, fresh.failed, "{:#?}", self.story);
        for (call, state) in &fresh.outcome.states {
            let (here, there) = (ran.outcome.states[call].record(), state.record());
            let digests = (here.map(|r| r.digest), there.map(|r| r.digest));
            assert_eq!(digests.0, digests.1, "{} {:#?}", plan.name(*call), self.story);
        }
        for shown in &plan.show {
            let bytes = |ran: &Ran, cache: &Cache| {
                ran.outcome.artefact(&plan, shown.call, cache).unwrap().map(|artefact| artefact.to_bytes().unwrap().0)
            };
            assert_eq!(bytes(&ran, &cache), bytes(&fresh, &other), "{} {:#?}", shown.address, self.story);
        }
        // And nothing is left to do but what fails.
        let again = self.run(&plan, &cache, self.options, usize::MAX);
        let tried: BTreeSet<_> = again.started.iter().cloned().collect();
        assert_eq!(tried, again.failed, "{:#?}", self.story);
    }

    /// Runs what an edit made, and stops it.
    fn stopped(&mut self, after: usize) {
        let (plan, cache, calls) = (self.plan(), self.cache(), self.model.evaluate());
        let ran = self.run(&plan, &cache, self.options, after);
        self.judge(&plan, &calls, &ran, false);
        self.learn(&plan, &cache, &calls, &ran);
    }

    /// Results are what the model says; what was executed is what the keys and the cache called for.
    fn judge(&self, plan: &Plan, calls: &BTreeMap<String, Call>, ran: &Ran, whole: bool) {
        let story = || format!("{:#?}\n{}\n{:?}", self.story, self.model.files()["g.ron"], ran.started);
        for (call, state) in &ran.outcome.states {
            let name = plan.name(*call);
            match (state, &calls[name].output, calls[name].identity.is_some()) {
                (State::Hit(_) | State::Computed(_), Some(_), _)
                | (State::Failed(_), None, true)
                | (State::Skipped(_), None, false) => {}
                (State::Cancelled, ..) if !whole => {}
                _ => panic!("{name} is {state:?} and should be {:?}: {}", calls[name], story()),
            }
        }
        for shown in &plan.show {
            let artefact = ran.outcome.artefact(plan, shown.call, &self.cache()).unwrap();
            let found = artefact.map(|artefact| {
                let numbers = artefact.into_any().downcast::<Numbers>().unwrap();
                let values = numbers.values.iter().map(|x| x.to_bits()).collect();
                (values, numbers.defects.iter().flat_map(|defect| defect.first.clone()).collect())
            });
            if whole || found.is_some() {
                assert_eq!(found, calls[&shown.address].output, "{} {}", shown.address, story());
            }
        }
        self.judge_executions(plan, calls, ran, whole, &story);
    }

    fn judge_executions(
        &self,
        plan: &Plan,
        calls: &BTreeMap<String, Call>,
        ran: &Ran,
        whole: bool,
        story: &dyn Fn() -> String,
    ) {
        let cone: Vec<&str> = ran.outcome.states.keys().map(|call| plan.name(*call)).collect();
        let missing = |name: &str| calls[name].identity.as_ref().is_some_and(|it| !self.recorded.contains(it));
        let lost = |name: &str| calls[name].output.as_ref().is_some_and(|it| !self.stored.contains(it));
        let mut must: BTreeMap<&String, usize> = BTreeMap::new();
        for name in cone.iter().filter(|name| missing(name)) {
            *must.entry(calls[*name].identity.as_ref().unwrap()).or_default() += 1;
        }
        // Outputs that are needed though they are known: shown, or taken by what executes.
        let wanted: BTreeSet<&str> = plan.show.iter().map(|shown| plan.name(shown.call)).collect();
        let mut may: BTreeSet<&str> = BTreeSet::new();
        let mut left: Vec<&str> = cone.iter().copied().filter(|name| missing(name)).collect();
        left.extend(wanted.iter().filter(|name| !missing(name) && lost(name)));
        while let Some(name) = left.pop() {
            let is_new = missing(name) || may.insert(name);
            if is_new || missing(name) {
                let inputs = calls[name].inputs.iter().map(String::as_str);
                left.extend(inputs.filter(|from| !missing(from) && lost(from) && !may.contains(from)));
            }
        }
        let lost_ones: BTreeSet<&String> = may.iter().filter_map(|name| calls[*name].identity.as_ref()).collect();
        let mut times: BTreeMap<&String, usize> = BTreeMap::new();
        for name in &ran.started {
            *times.entry(calls[name].identity.as_ref().unwrap_or(name)).or_default() += 1;
        }
        for (identity, count) in &times {
            let fails = calls.values().any(|it| it.identity.as_ref() == Some(*identity) && it.output.is_none());
            let most = match must.get(identity) {
                // Each that fails is tried; of others equal ones are one.
                Some(calls) if fails => *calls,
                Some(_) => 1,
                None => 0,
            };
            let lost = if lost_ones.contains(identity) { cone.len() } else { 0 };
            assert!(*count <= most + lost, "{identity} was executed {count} times, not {most}+{lost}: {}", story());
        }
        if whole {
            for identity in must.keys() {
                assert!(times.contains_key(*identity), "{identity} was not executed: {}", story());
            }
        }
    }

    /// Takes down what the cache holds now.
    fn learn(&mut self, plan: &Plan, cache: &Cache, calls: &BTreeMap<String, Call>, ran: &Ran) {
        for (call, state) in &ran.outcome.states {
            let Some(record) = state.record() else { continue };
            let it = &calls[plan.name(*call)];
            let (Some(identity), Some(output)) = (&it.identity, &it.output) else { continue };
            self.records.insert(identity.clone(), cache.record_path(record));
            self.objects.insert(output.clone(), cache.object_path(&record.digest));
            self.recorded.insert(identity.clone());
            if matches!(state, State::Computed(_)) {
                self.stored.insert(output.clone());
            }
        }
        // Outputs that were brought back, by whomever; damaged ones that nobody needed remain as they are.
        for name in &ran.started {
            self.stored.extend(calls[name].output.clone());
        }
    }

    /// Removes or damages a record, an object, or everything.
    fn damage(&mut self) -> String {
        let how = self.dice.roll(3);
        let spoil = |path: &Path, dice: &mut Dice| match how {
            0 => fs::remove_file(path).unwrap(),
            1 => {
                let mut bytes = fs::read(path).unwrap();
                let at = dice.roll(bytes.len());
                bytes[at] ^= 1 << dice.roll(8);
                fs::write(path, bytes).unwrap();
            }
            _ => {
                let bytes = fs::read(path).unwrap();
                fs::write(path, &bytes[..dice.roll(bytes.len())]).unwrap();
            }
        };
        match self.dice.roll(8) {
            0 => {
                fs::remove_dir_all(self.dir.path().join("cache")).unwrap();
                self.recorded.clear();
                self.stored.clear();
                "the cache is gone".into()
            }
            1..=3 if !self.recorded.is_empty() => {
                let all: Vec<_> = self.recorded.iter().cloned().collect();
                let identity = self.dice.pick(&all).clone();
                spoil(&self.records[&identity], &mut self.dice);
                self.recorded.remove(&identity);
                format!("record damaged ({how}): {identity}")
            }
            _ if !self.stored.is_empty() => {
                let all: Vec<_> = self.stored.iter().cloned().collect();
                let mut spoilt = Vec::new();
                for _ in 0..=self.dice.roll(3) {
                    let output = self.dice.pick(&all).clone();
                    if self.stored.remove(&output) {
                        spoil(&self.objects[&output], &mut self.dice);
                        spoilt.push(output);
                    }
                }
                format!("objects damaged ({how}): {spoilt:?}")
            }
            _ => "nothing to damage".into(),
        }
    }

    fn collect(&mut self) -> String {
        let size = [None, Some(0), Some(200)][self.dice.roll(3)];
        let age = if size.is_none() { Some(Duration::ZERO) } else { None };
        let limits = Limits { max_size: size, max_age: age, grace: Duration::ZERO };
        self.cache().gc(limits).unwrap();
        self.recorded.retain(|identity| self.records[identity].exists());
        self.stored.retain(|output| self.objects[output].exists());
        format!("collected: size {size:?}, age {age:?}")
    }
}
