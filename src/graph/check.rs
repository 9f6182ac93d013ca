//! Whether the wires fit: names, types, arity, cycles and axes.

use std::collections::BTreeSet;

use petgraph::algo::kosaraju_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use salient_sdk::Arity;

use super::axes::{Along, stems};
use super::flatten::{Arg, Flat, Walk};
use super::syntax::Value;
use super::wires::{Target, Used};
use crate::diagnostics::{Span, suggest};

/// A wire into a node of the flat list.
#[derive(Clone, Debug)]
pub struct Link {
    pub port: usize,
    pub from: Target,
    /// For a port that takes many: the name of what is wired.
    pub label: String,
    pub span: Span,
}

/// The flat list with its wires understood.
#[derive(Default)]
pub struct Linked {
    /// Wires into each node, by port.
    pub links: Vec<Vec<Link>>,
    /// The axis that each node is repeated along.
    pub axis: Vec<Option<usize>>,
    /// Whether an error hides which axis a node is on.
    pub unsure: Vec<bool>,
    /// The nodes, each after all that feed it.
    pub order: Vec<usize>,
}

impl Walk<'_, '_> {
    /// Understands and checks all wires.
    pub fn link(&mut self) -> (Linked, Used) {
        let mut used = Used::default();
        self.check_inputs(&mut used);
        let mut linked = Linked::default();
        for flat in 0..self.flats.len() {
            let (links, torn) = self.links(&mut used, flat);
            linked.links.push(links);
            let broken = self.flats[flat].params.iter().any(|(_, arg)| matches!(arg, Arg::Broken));
            linked.unsure.push(torn || broken);
        }
        self.check_outputs(&mut used);
        linked.order = self.order(&linked.links);
        self.name_file_axes();
        linked.axis = vec![None; self.flats.len()];
        for i in 0..linked.order.len() {
            let flat = linked.order[i];
            linked.unsure[flat] |= linked.links[flat].iter().any(|l| linked.unsure[l.from.flat]);
            linked.axis[flat] = self.axis_of(flat, &linked);
            self.check_gathering(flat, &linked);
        }
        self.unused_inputs(&used);
        (linked, used)
    }

    /// Declared types of inputs, and what callers wire to them.
    fn check_inputs(&mut self, used: &mut Used) {
        let types: Vec<&str> = self.kinds.artefacts();
        for scope in 0..self.scopes.len() {
            let file = self.scopes[scope].file.clone();
            for (i, (name, artefact)) in file.inputs.iter().enumerate() {
                if !types.contains(&artefact.text.as_str()) {
                    let hint = suggest(&artefact.text, "types", &types);
                    let message = format!("no node makes a `{}`", artefact.text);
                    self.report.error(artefact.span, "unknown-type", message).hint(hint);
                    used.broken.insert((scope, i));
                    continue;
                }
                let Some(value) = self.scopes[scope].inputs.get(i).cloned().flatten() else {
                    continue;
                };
                let parent = self.scopes[scope].parent;
                let Some(target) = self.target(used, parent, &value) else {
                    used.broken.insert((scope, i));
                    continue;
                };
                let made = self.flats[target.flat].kind.node.output().name;
                if made != artefact.text {
                    let message = format!("the input `{}` takes `{}`, but this is `{made}`", name.text, artefact.text);
                    self.wrong_type(value.span, message, &artefact.text, (parent, None));
                    used.broken.insert((scope, i));
                }
            }
        }
    }

    /// `place` is the scope whose nodes are suggested, and the node that is not.
    fn wrong_type(&mut self, span: Span, message: String, wanted: &str, place: (usize, Option<usize>)) {
        let fits =
            |(i, f): &(usize, &Flat)| f.scope == place.0 && place.1 != Some(*i) && f.kind.node.output().name == wanted;
        let name = |(_, f): (usize, &Flat)| format!("`{}`", f.address.rsplit('/').next().unwrap_or_default());
        let names: Vec<String> = self.flats.iter().enumerate().filter(fits).take(6).map(name).collect();
        let hint = if names.is_empty() {
            let makers = self.kinds.makers(wanted);
            format!("a {wanted} is made by {}", makers.join(", "))
        } else {
            format!("nodes here that make `{wanted}`: {}", names.join(", "))
        };
        self.report.error(span, "wrong-type", message).hint(hint);
    }

    /// The wires into a node, and whether one is wrong.
    fn links(&mut self, used: &mut Used, flat: usize) -> (Vec<Link>, bool) {
        let kind = self.flats[flat].kind.clone();
        let wires = self.flats[flat].wires.clone();
        let scope = self.flats[flat].scope;
        let (mut links, mut torn) = (Vec::new(), false);
        for (at, port) in kind.node.ports().iter().enumerate() {
            let Some((_, value)) = wires.iter().find(|(p, _)| *p == at) else {
                if port.arity != Arity::Optional {
                    let (name, artefact) = (port.name, port.artefact);
                    let message = format!("the input `{name}` of `{}` is not wired", kind.node.kind());
                    let span = self.flats[flat].span;
                    self.report
                        .error(span, "missing-input", message)
                        .hint(format!("add `{name}: \"..\"`, the name of a node that makes `{artefact}`"));
                }
                continue;
            };
            for (position, value) in self.wired(port.arity, port.name, value).into_iter().enumerate() {
                let Some(from) = self.target(used, scope, &value) else {
                    torn = true;
                    continue;
                };
                let made = self.flats[from.flat].kind.node.output().name;
                if made != port.artefact {
                    let message = format!(
                        "`{}` of `{}` takes `{}`, but this is `{made}`",
                        port.name,
                        kind.node.kind(),
                        port.artefact
                    );
                    self.wrong_type(value.span, message, port.artefact, (scope, Some(flat)));
                    torn = true;
                    continue;
                }
                // Labels are part of a key, names of nodes are not.
                let many = port.arity.is_many() && !from.all;
                let label = if many { position.to_string() } else { String::new() };
                links.push(Link { port: at, from, label, span: value.span });
            }
        }
        (links, torn)
    }

    /// The single wires of what is written at a port: a port that takes many may have a list.
    fn wired(&mut self, arity: Arity, port: &str, value: &Value) -> Vec<Value> {
        match value.list(self.report) {
            Some(list) if arity.is_many() => list,
            Some(_) => {
                self.report
                    .error(value.span, "bad-wire", format!("`{port}` takes one wire, not a list"))
                    .hint("write the name of one node");
                Vec::new()
            }
            None => vec![value.clone()],
        }
    }

    /// Outputs of subgraphs that nothing uses must name a node all the same.
    fn check_outputs(&mut self, used: &mut Used) {
        for scope in 0..self.scopes.len() {
            if let Some(output) = self.scopes[scope].file.output.clone() {
                self.check_name(used, scope, &output);
            }
        }
    }

    /// The nodes in an order in which each comes after all that feed it, and otherwise as in the
    /// files. Cycles are reported.
    fn order(&mut self, links: &[Vec<Link>]) -> Vec<usize> {
        let mut feeds = vec![Vec::new(); links.len()];
        let mut open: Vec<usize> = links.iter().map(Vec::len).collect();
        for (to, links) in links.iter().enumerate() {
            for link in links {
                feeds[link.from.flat].push(to);
            }
        }
        let mut ready: BTreeSet<usize> = (0..links.len()).filter(|i| open[*i] == 0).collect();
        let mut order = Vec::with_capacity(links.len());
        while let Some(flat) = ready.pop_first() {
            order.push(flat);
            for to in &feeds[flat] {
                open[*to] -= 1;
                if open[*to] == 0 {
                    ready.insert(*to);
                }
            }
        }
        if order.len() == links.len() {
            return order;
        }
        self.cycles(links);
        Vec::new()
    }

    fn cycles(&mut self, links: &[Vec<Link>]) {
        let edges = links
            .iter()
            .enumerate()
            .flat_map(|(to, links)| links.iter().map(move |link| (link.from.flat as u32, to as u32)));
        let graph: DiGraph<(), ()> = DiGraph::from_edges(edges);
        for mut group in kosaraju_scc(&graph) {
            group.sort();
            let first = group[0];
            if group.len() > 1 || graph.contains_edge(first, first) {
                self.report_cycle(links, &group);
            }
        }
    }

    fn report_cycle(&mut self, links: &[Vec<Link>], group: &[NodeIndex]) {
        // Walking against the wires within the group must come back to a node seen before.
        let inside = |flat: usize| group.binary_search(&NodeIndex::new(flat)).is_ok();
        let mut path: Vec<usize> = vec![group[0].index()];
        let start = loop {
            let last = path[path.len() - 1];
            let Some(link) = links[last].iter().find(|link| inside(link.from.flat)) else { return };
            if let Some(start) = path.iter().position(|flat| *flat == link.from.flat) {
                break start;
            }
            path.push(link.from.flat);
        };
        let mut cycle = path[start..].to_vec();
        cycle.reverse();
        let least = (0..cycle.len()).min_by_key(|i| cycle[*i]).unwrap_or(0);
        cycle.rotate_left(least);
        cycle.push(cycle[0]);
        let names: Vec<&str> = cycle.iter().map(|flat| self.flats[*flat].address.as_str()).collect();
        let message = format!("these nodes feed each other: {}", names.join(" -> "));
        let link = links[cycle[0]].iter().find(|link| link.from.flat == cycle[cycle.len() - 2]);
        let span = link.map_or(self.flats[cycle[0]].span, |link| link.span);
        self.report.error(span, "cycle", message).hint("one of these wires has to go");
    }

    /// Axes that files are read from are named by the files' stems.
    fn name_file_axes(&mut self) {
        let mut axes = Vec::new();
        for flat in &self.flats {
            for (name, arg) in &flat.params {
                let file = flat.kind.infos.iter().any(|info| info.name == *name && info.file);
                if let Arg::Each(axis, _) = arg
                    && file
                {
                    axes.push(*axis);
                }
            }
        }
        axes.sort_unstable();
        axes.dedup();
        for axis in axes {
            stems(self.report, &mut self.axes[axis]);
        }
    }

    /// The axis of a node: that of its params and of what is wired to it.
    fn axis_of(&mut self, flat: usize, linked: &Linked) -> Option<usize> {
        let mut found: Vec<(usize, Span)> = Vec::new();
        for (_, arg) in &self.flats[flat].params {
            if let Arg::Each(axis, span) = arg {
                found.push((*axis, *span));
            }
        }
        for link in linked.links[flat].iter().filter(|link| !link.from.all) {
            let from = linked.axis[link.from.flat];
            match link.from.role {
                None => found.extend(from.map(|axis| (axis, link.span))),
                Some((pairs, _)) => {
                    let Along::Pairs { of, .. } = self.axes[pairs].along else { continue };
                    if from == Some(of) || linked.unsure[link.from.flat] {
                        found.push((pairs, link.span));
                    } else {
                        let axis = &self.axes[of].name;
                        let message = format!("this node is not repeated along the axis `{axis}`");
                        self.report
                            .error(link.span, "bad-axis", message)
                            .hint("wire it without `@`: it is the same for all pairs");
                    }
                }
            }
        }
        let (first, _) = *found.first()?;
        if let Some((other, span)) = found.iter().find(|(axis, _)| *axis != first) {
            self.two_axes(first, *other, *span);
        }
        Some(first)
    }

    fn two_axes(&mut self, first: usize, other: usize, span: Span) {
        let (one, two) = (&self.axes[first].name, &self.axes[other].name);
        let message = format!("a node is repeated along one axis, but here along `{one}` and `{two}`");
        let sides = [first, other].iter().find_map(|axis| match &self.axes[*axis].along {
            Along::Pairs { of, roles } if [first, other].contains(of) => Some(roles.clone()),
            _ => None,
        });
        let hint = match sides {
            Some([a, b]) => format!("say which of the pair with `@{a}` or `@{b}`"),
            None => "gather one of them with `all(\"..\")`, or make pairs of one axis with \
                     `pairs(of: .., as: (.., ..))`"
                .into(),
        };
        self.report.error(span, "two-axes", message).hint(hint);
    }

    /// `all(..)` goes with ports that take many, and only they take an axis as a whole.
    fn check_gathering(&mut self, flat: usize, linked: &Linked) {
        let kind = self.flats[flat].kind.clone();
        for link in &linked.links[flat] {
            let port = kind.node.ports()[link.port];
            let source = self.flats[link.from.flat].address.clone();
            let repeated = linked.axis[link.from.flat].is_some();
            let many = port.arity.is_many();
            if link.from.all && !many {
                let message = format!("`{}` takes one wire, not all instances", port.name);
                self.report
                    .error(link.span, "bad-axis", message)
                    .hint(format!("wire \"{source}\": the node is then repeated along its axis"));
            } else if link.from.all && !repeated && !linked.unsure[link.from.flat] {
                let message = format!("`{source}` is not repeated along an axis");
                self.report.error(link.span, "bad-axis", message).hint("wire it without `all(..)`");
            } else if many && repeated && !link.from.all {
                let axis = linked.axis[link.from.flat].map_or("", |a| self.axes[a].name.as_str());
                let message = format!("`{source}` is repeated along `{axis}`, and `{}` takes many", port.name);
                self.report
                    .error(link.span, "bad-axis", message)
                    .hint(format!("gather the instances with all(\"{source}\")"));
            }
        }
    }

    fn unused_inputs(&mut self, used: &Used) {
        if self.holes {
            return;
        }
        for (at, scope) in self.scopes.iter().enumerate() {
            for (i, (name, _)) in scope.file.inputs.iter().enumerate() {
                if !used.inputs.contains(&(at, i)) && !used.torn.contains(&at) {
                    let message = format!("nothing is wired to the input `{}`", name.text);
                    self.report.error(name.span, "unused-input", message).hint("wire it to a node, or remove it");
                }
            }
        }
    }
}
