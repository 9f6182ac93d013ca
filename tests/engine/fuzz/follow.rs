//! A watch in this process beside random edits: it always arrives at what the model says.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use salient::engine::{Cache, Event, Options, Outcome};
use salient::graph::{Overrides, Plan};
use salient::watch::{Observer, Subject, Watch};

use super::model::Model;
use super::world::{World, registry, write};
use crate::toy::Numbers;

/// Only a hang takes so long.
const DEADLINE: Duration = Duration::from_secs(120);

type Values = BTreeMap<String, Vec<u64>>;

struct Listener {
    said: Sender<Values>,
    broken: Sender<String>,
}

impl Observer for Listener {
    fn event(&mut self, event: &Event) {
        if let Event::Broken { text, .. } = event {
            let _ = self.broken.send(text.clone());
        }
    }

    fn outcome(&mut self, plan: &Plan, outcome: &Outcome, cache: &Cache) -> Vec<PathBuf> {
        let mut values = Values::new();
        for shown in &plan.show {
            if let Some(artefact) = outcome.artefact(plan, shown.call, cache).unwrap() {
                let numbers = artefact.into_any().downcast::<Numbers>().unwrap();
                values.insert(shown.address.clone(), numbers.values.iter().map(|x| x.to_bits()).collect());
            }
        }
        let _ = self.said.send(values);
        Vec::new()
    }
}

fn expected(model: &Model) -> Values {
    let calls = model.evaluate();
    let value = |address: String| Some((calls[&address].output.clone()?.0, address)).map(|(v, a)| (a, v));
    model.shown().into_iter().filter_map(value).collect()
}

fn wait(said: &Receiver<Values>, broken: &Receiver<String>, last: &mut Option<Values>, wanted: &Values, what: &str) {
    let start = Instant::now();
    while last.as_ref() != Some(wanted) {
        let left = DEADLINE.saturating_sub(start.elapsed());
        match said.recv_timeout(left) {
            Ok(values) => *last = Some(values),
            Err(e) => panic!("{e}: {what}: {last:?}, not {wanted:?}; {:?}", broken.try_iter().collect::<Vec<_>>()),
        }
    }
}

pub fn follow(seed: u64, steps: usize) {
    let mut world = World::new(seed);
    // What is not in files cannot be followed.
    let registry = registry(1);
    let settle = |model: &mut Model| {
        model.version = 1;
        model.forget_sets();
    };
    settle(&mut world.model);
    let dir = world.dir.path().to_owned();
    write(&dir, &world.model);
    let subject = Subject {
        graph: dir.join("g.ron"),
        overrides: Overrides::default(),
        registry: &registry,
        cache: dir.join("cache"),
        options: Options { jobs: 2, ..Options::default() },
        poll: None,
    };
    let watch = Watch::new(subject);
    let stop = watch.stopper();
    let ((said, heard), (broken, wrong)) = (channel(), channel());
    std::thread::scope(|scope| {
        let ended = scope.spawn(move || watch.run(&mut Listener { said, broken }));
        // Stops the watch also when a check fails, so that the failure is seen.
        let guard = Stopping(stop);
        let mut last = None;
        wait(&heard, &wrong, &mut last, &expected(&world.model), &format!("seed {seed}"));
        for step in 0..steps {
            let mut what = format!("seed {seed}, step {step}:");
            // Several at once, or one after another while the watch is at work.
            for _ in 0..=world.dice.roll(3) {
                what = format!("{what} {};", world.model.edit(&mut world.dice));
                settle(&mut world.model);
                write(&dir, &world.model);
            }
            wait(&heard, &wrong, &mut last, &expected(&world.model), &what);
        }
        drop(guard);
        ended.join().unwrap().unwrap();
    });
}

struct Stopping(salient::watch::Stop);

impl Drop for Stopping {
    fn drop(&mut self) {
        self.0.stop();
    }
}
