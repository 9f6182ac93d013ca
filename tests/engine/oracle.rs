//! Random graphs, edits and damage against an oracle that evaluates everything from scratch and
//! remembers every (node, params, input values) that was ever computed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::time::Duration;

use petgraph::graph::NodeIndex;
use proptest::prelude::*;
use salient::engine::upkeep::Limits;

use crate::lab::{Graph, Lab, files};
use crate::toy::{Scale, Sign, Sum, Wide};

#[derive(Clone, Debug)]
enum Node {
    Read(usize),
    Scale(usize, i8),
    Sign(usize),
    Wide(usize),
    Sum(usize, usize),
}

#[derive(Clone, Debug)]
enum Action {
    /// Writes a number to a file.
    Edit(usize, i8),
    /// Replaces a factor.
    Factor(usize, i8),
    /// Damages an object, or removes it.
    Object(usize, bool),
    /// Damages a record, or removes it.
    Record(usize, bool),
    /// Collects everything.
    Collect,
    /// Other workers and memory.
    Effort(usize, bool),
    /// Shows another node.
    Show(usize),
}

fn node() -> impl Strategy<Value = Node> {
    prop_oneof![
        (0..3_usize).prop_map(Node::Read),
        (any::<usize>(), -2..3_i8).prop_map(|(x, f)| Node::Scale(x, f)),
        any::<usize>().prop_map(Node::Sign),
        any::<usize>().prop_map(Node::Wide),
        (any::<usize>(), any::<usize>()).prop_map(|(x, y)| Node::Sum(x, y)),
    ]
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        4 => (0..3_usize, -2..3_i8).prop_map(|(file, x)| Action::Edit(file, x)),
        3 => (any::<usize>(), -2..3_i8).prop_map(|(i, f)| Action::Factor(i, f)),
        3 => (any::<usize>(), any::<bool>()).prop_map(|(i, gone)| Action::Object(i, gone)),
        2 => (any::<usize>(), any::<bool>()).prop_map(|(i, gone)| Action::Record(i, gone)),
        1 => Just(Action::Collect),
        2 => (1..5_usize, any::<bool>()).prop_map(|(jobs, none)| Action::Effort(jobs, none)),
        2 => any::<usize>().prop_map(Action::Show),
    ]
}

struct World {
    lab: Lab,
    nodes: Vec<Node>,
    numbers: [i8; 3],
    show: usize,
    /// Every computation ever needed.
    seen: BTreeSet<String>,
    /// Whether the cache lost something since.
    damaged: bool,
}

impl World {
    /// The inputs of a node; the first ones read.
    fn inputs(&self, i: usize) -> Vec<usize> {
        match self.nodes[i] {
            Node::Read(_) => vec![],
            Node::Scale(x, _) | Node::Sign(x) | Node::Wide(x) => vec![x % i],
            Node::Sum(x, y) => vec![x % i, y % i],
        }
    }

    /// Values and computations of the shown node's cone, by index.
    fn oracle(&self) -> BTreeMap<usize, (Vec<f64>, String)> {
        let (mut cone, mut left) = (BTreeSet::new(), vec![self.show]);
        while let Some(i) = left.pop() {
            if cone.insert(i) {
                left.extend(self.inputs(i));
            }
        }
        let mut known: BTreeMap<usize, (Vec<f64>, String)> = BTreeMap::new();
        for i in cone {
            let inputs: Vec<_> = self.inputs(i).iter().map(|x| known[x].0.clone()).collect();
            // -0.0 is written as 0.0.
            let map = |f: &dyn Fn(f64) -> f64| inputs[0].iter().map(|x| f(*x) + 0.0).collect();
            let (name, values): (String, Vec<f64>) = match self.nodes[i] {
                Node::Read(file) => {
                    let x = f64::from(self.numbers[file]);
                    (format!("read {x}"), vec![x, 1.5])
                }
                Node::Scale(_, factor) => (format!("scale {factor}"), map(&|x| x * f64::from(factor))),
                Node::Sign(_) => ("sign".into(), map(&f64::signum)),
                Node::Wide(_) => ("wide".into(), map(&|x| x * x / 3.0)),
                Node::Sum(..) => ("sum".into(), vec![inputs.iter().flatten().sum::<f64>() + 0.0]),
            };
            known.insert(i, (values, format!("{name} of {inputs:?}")));
        }
        known
    }

    fn graph(&self) -> Graph {
        let mut graph = Graph::new();
        let mut calls: Vec<NodeIndex> = Vec::new();
        for (i, node) in self.nodes.iter().enumerate() {
            let name = format!("n{i}");
            let inputs: Vec<_> = self.inputs(i).into_iter().map(|x| calls[x]).collect();
            calls.push(match node {
                Node::Read(file) => graph.read(&name, &self.lab.dir.path().join(format!("{file}.txt"))),
                Node::Scale(_, factor) => {
                    graph.call(&name, &Scale::<1>, &[("factor", &factor.to_string())], &[("x", inputs[0])])
                }
                Node::Sign(_) => graph.call(&name, &Sign, &[], &[("x", inputs[0])]),
                Node::Wide(_) => graph.call(&name, &Wide, &[], &[("x", inputs[0])]),
                Node::Sum(..) => graph.call(&name, &Sum, &[], &[("terms", inputs[0]), ("terms", inputs[1])]),
            });
        }
        graph.show(&[&format!("n{}", self.show)])
    }

    fn act(&mut self, action: &Action) {
        let damage = |part: &str, i: usize, gone: bool| {
            let all = files(&self.lab.dir.path().join("cache").join(part));
            let Some(path) = all.get(i % all.len().max(1)) else { return };
            if gone { fs::remove_file(path).unwrap() } else { fs::write(path, "x").unwrap() }
        };
        match *action {
            Action::Edit(file, x) => self.numbers[file] = x,
            Action::Factor(i, factor) => {
                let i = i % self.nodes.len();
                if let Node::Scale(_, old) = &mut self.nodes[i] {
                    *old = factor;
                }
            }
            Action::Object(i, gone) => damage("objects", i, gone),
            Action::Record(i, gone) => damage("records", i, gone),
            Action::Collect => {
                let max_age = Some(Duration::ZERO);
                let limits = Limits { max_age, max_size: None, grace: Duration::ZERO };
                self.lab.cache().gc(limits).unwrap();
            }
            Action::Effort(jobs, none) => {
                self.lab.options.jobs = jobs;
                self.lab.options.memory = if none { 0 } else { 1 << 30 };
            }
            Action::Show(i) => self.show = i % self.nodes.len(),
        }
        self.damaged |= matches!(action, Action::Object(..) | Action::Record(..) | Action::Collect);
        for (file, x) in self.numbers.iter().enumerate() {
            self.lab.file(&format!("{file}.txt"), &format!("{x}\n1.5\n"));
        }
    }

    fn check(&mut self) {
        let (graph, expected) = (self.graph(), self.oracle());
        let ran = self.lab.run(&graph);
        assert!(ran.outcome.complete(), "{:?} {:?}", ran.events, ran.outcome.states);
        assert!(ran.failures().is_empty() && ran.skipped().is_empty(), "{:?}", ran.events);
        assert_eq!(ran.values[&format!("n{}", self.show)], expected[&self.show].0);
        let computations: BTreeSet<_> = expected.values().map(|(_, name)| name.clone()).collect();
        let executed: Vec<_> =
            ran.executed.iter().map(|name| expected[&name[1..].parse::<usize>().unwrap()].1.clone()).collect();
        if !self.damaged {
            let new: Vec<_> = computations.difference(&self.seen).cloned().collect();
            let mut executed = executed.clone();
            executed.sort();
            assert_eq!(executed, new, "exactly what is new executes, and once");
        }
        self.seen.extend(computations);
        assert_eq!(self.lab.run(&graph).executed, [""; 0], "all is known now");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn random_edits_and_damage_never_give_a_wrong_result(
        rest in prop::collection::vec(node(), 1..9),
        actions in prop::collection::vec(action(), 1..12),
    ) {
        let mut nodes = vec![Node::Read(0)];
        nodes.extend(rest);
        let show = nodes.len() - 1;
        let lab = Lab::new();
        let (seen, numbers) = (BTreeSet::new(), [0, 1, 2]);
        let mut world = World { lab, nodes, numbers, show, seen, damaged: false };
        world.act(&Action::Effort(2, false));
        world.check();
        for action in &actions {
            world.act(action);
            world.check();
        }
    }
}
