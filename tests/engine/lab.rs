//! Hand-built plans, and runs of them that say what was executed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use petgraph::graph::NodeIndex;
use salient::engine::{Cache, Cancel, Event, Options, Outcome, run};
use salient::graph::{Call, Plan, Shown, Wire};
use salient_sdk::AnyNode;
use tempfile::TempDir;

use crate::toy::Numbers;

/// A folder with a cache and files in it.
pub struct Lab {
    pub dir: TempDir,
    pub options: Options,
}

/// What a run did.
pub struct Ran {
    pub outcome: Outcome,
    pub events: Vec<Event>,
    /// Addresses of the calls that executed, sorted.
    pub executed: Vec<String>,
    /// Values of the shown results, by address; absent if there is no result.
    pub values: BTreeMap<String, Vec<f64>>,
}

impl Lab {
    pub fn new() -> Self {
        let options = Options { jobs: 2, ..Options::default() };
        Self { dir: tempfile::tempdir().unwrap(), options }
    }

    pub fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.dir.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }

    pub fn cache(&self) -> Cache {
        Cache::open(&self.dir.path().join("cache")).unwrap()
    }

    pub fn run(&self, graph: &Graph) -> Ran {
        self.run_until(graph, |_| false)
    }

    /// Runs, and cancels after the first event for which `stop` holds.
    pub fn run_until(&self, graph: &Graph, stop: impl Fn(&Event) -> bool) -> Ran {
        let (plan, cache, cancel) = (&graph.plan, self.cache(), Cancel::new());
        let wanted: Vec<_> = plan.show.iter().map(|shown| shown.call).collect();
        let mut events = Vec::new();
        let mut on_event = |event: &Event| {
            events.push(event.clone());
            if stop(event) {
                cancel.cancel();
            }
        };
        let outcome = run(plan, &wanted, &cache, self.options, &cancel, &mut on_event).unwrap();
        let mut executed: Vec<_> = events
            .iter()
            .filter_map(|event| match event {
                Event::Started { node, .. } => Some(node.clone()),
                _ => None,
            })
            .collect();
        executed.sort();
        let mut values = BTreeMap::new();
        for shown in &plan.show {
            if let Some(artefact) = outcome.artefact(plan, shown.call, &cache).unwrap() {
                let numbers = artefact.into_any().downcast::<Numbers>().unwrap();
                values.insert(shown.address.clone(), numbers.values.clone());
            }
        }
        Ran { outcome, events, executed, values }
    }

    /// The object files, by name.
    pub fn objects(&self) -> BTreeMap<String, Vec<u8>> {
        files(&self.dir.path().join("cache/objects"))
            .into_iter()
            .map(|path| {
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                (name, std::fs::read(path).unwrap())
            })
            .collect()
    }

    /// The object file of a call's output.
    pub fn object(&self, ran: &Ran, graph: &Graph, address: &str) -> PathBuf {
        let call = graph.plan.addresses[address];
        let digest = ran.outcome.states[&call].record().unwrap().digest;
        self.cache().object_path(&digest)
    }
}

impl Ran {
    pub fn failures(&self) -> Vec<(String, String)> {
        let failure = |event: &Event| match event {
            Event::Failed { node, message, .. } => Some((node.clone(), message.clone())),
            _ => None,
        };
        self.events.iter().filter_map(failure).collect()
    }

    pub fn skipped(&self) -> Vec<(String, String)> {
        let skipped = |event: &Event| match event {
            Event::Skipped { node, because, .. } => Some((node.clone(), because.clone())),
            _ => None,
        };
        let mut all: Vec<_> = self.events.iter().filter_map(skipped).collect();
        all.sort();
        all
    }

    pub fn corrupt(&self) -> usize {
        self.events.iter().filter(|e| matches!(e, Event::CacheCorrupt { .. })).count()
    }
}

/// All files below a folder, sorted.
pub fn files(dir: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(dir).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(files(&path)) } else { all.push(path) }
    }
    all.sort();
    all
}

/// A plan being built.
#[derive(Default, Clone)]
pub struct Graph {
    pub plan: Plan,
}

impl Graph {
    pub fn new() -> Self {
        let mut graph = Self::default();
        graph.plan.file = "toy.ron".into();
        graph
    }

    pub fn call(
        &mut self,
        name: &str,
        node: &'static dyn AnyNode,
        params: &[(&str, &str)],
        inputs: &[(&str, NodeIndex)],
    ) -> NodeIndex {
        let bound = node.bind(params).unwrap_or_else(|e| panic!("{e:?}"));
        let is_file = |name: &str| node.params().iter().any(|p| p.name == name && p.file);
        let files = params
            .iter()
            .filter(|(name, _)| is_file(name))
            .map(|(name, text)| ((*name).to_owned(), PathBuf::from(text.trim_matches('"'))));
        let files = files.collect();
        let addresses = vec![name.to_owned()];
        let call = self.plan.dag.add_node(Call { node, bound, files, addresses });
        for (i, (port, from)) in inputs.iter().enumerate() {
            let port = node.ports().iter().find(|p| p.name == *port).unwrap().name;
            let label = if inputs.len() > 1 { i.to_string() } else { String::new() };
            self.plan.dag.add_edge(*from, call, Wire { port, label });
        }
        self.plan.addresses.insert(name.to_owned(), call);
        call
    }

    pub fn read(&mut self, name: &str, path: &Path) -> NodeIndex {
        self.call(name, &crate::toy::Read, &[("path", &format!("{:?}", path.display().to_string()))], &[])
    }

    pub fn show(mut self, names: &[&str]) -> Self {
        for name in names {
            let call = self.plan.addresses[*name];
            self.plan.show.push(Shown { address: (*name).to_owned(), call });
        }
        self
    }
}
