//! Nodes repeated along their axes, with typed params; and what is shown of them.

use std::collections::{BTreeMap, BTreeSet};

use super::axes::{self, count};
use super::bind::{Binder, Text, texts};
use super::check::Linked;
use super::file::GraphFile;
use super::flatten::{Arg, Entry, Walk};
use super::overrides::{Override, matches, unmatched};
use super::syntax::Name;
use super::wires::Used;
use crate::diagnostics::suggest;

/// Calls that a plan may have.
pub const MOST_CALLS: usize = 4_000_000;

/// The bound params of a node's instances.
#[derive(Clone, Debug)]
pub enum Numbers {
    /// The same for all.
    One(usize),
    /// One for each.
    Each(Vec<usize>),
}

/// Something shown: a node with all its instances, or one of them.
#[derive(Clone, Debug)]
pub struct Show {
    pub address: String,
    pub flat: usize,
    pub instance: Option<usize>,
}

/// What is left to do for a variant is to add its calls to the plan.
pub struct Variant {
    pub prefix: String,
    pub linked: Linked,
    /// How many calls it has, before equal ones are merged.
    pub calls: usize,
    pub numbers: Vec<Numbers>,
    pub show: Vec<Show>,
    /// Names of the instances along each axis in use.
    pub labels: BTreeMap<usize, Vec<String>>,
    /// Addresses of each node: its own, and those of the subgraph calls whose output it is.
    pub addresses: Vec<Vec<String>>,
}

impl Walk<'_, '_> {
    /// Checks all that is left after flattening. Errors are reported; then the result is of no use.
    pub fn finish(&mut self, binder: &mut Binder, file: &GraphFile, prefix: String) -> Variant {
        let (linked, mut used) = self.link();
        let calls = linked.axis.iter().map(|a| a.map_or(1, |a| count(&self.axes, a))).sum();
        let addresses = self.addresses(&mut used);
        let (numbers, show, labels) = Default::default();
        let mut variant = Variant { prefix, linked, calls, numbers, show, labels, addresses };
        // The caller refuses it; to name all instances would take the memory that is not there.
        if calls > MOST_CALLS {
            return variant;
        }
        for axis in variant.linked.axis.iter().flatten() {
            variant.labels.entry(*axis).or_insert_with(|| axes::labels(&self.axes, *axis));
        }
        for flat in 0..self.flats.len() {
            let axis = variant.linked.axis.get(flat).copied().flatten();
            let labels = axis.and_then(|a| variant.labels.get(&a)).map(Vec::as_slice);
            let bound = self.bind(binder, flat, labels);
            variant.numbers.push(bound.unwrap_or(Numbers::One(0)));
        }
        variant.show = self.show(&mut used, file, &variant.linked, &variant.labels);
        self.report_unmatched(&variant.addresses);
        variant
    }

    /// Every address of each node, its own first.
    fn addresses(&mut self, used: &mut Used) -> Vec<Vec<String>> {
        let mut all: Vec<Vec<String>> = self.flats.iter().map(|f| vec![f.address.clone()]).collect();
        // Errors on the way were reported when outputs were checked.
        let reported = self.report.list.len();
        for scope in 1..self.scopes.len() {
            let file = self.scopes[scope].file.clone();
            let Some(output) = &file.output else { continue };
            // An output that is an input passed on has its address outside.
            if let Some(Entry::Input(_)) = self.scopes[scope].names.get(&output.text) {
                continue;
            }
            let address = self.scopes[scope].address.clone();
            let root = Name { text: address.clone(), span: output.span };
            if let Some(flat) = self.at_address(used, &root, &address) {
                all[flat].push(address);
            }
        }
        self.report.list.truncate(reported);
        all
    }

    /// Types the params of a node: once, or for each instance if they differ.
    fn bind(&mut self, binder: &mut Binder, flat: usize, labels: Option<&[String]>) -> Option<Numbers> {
        let each = self.flats[flat].params.iter().any(|(_, arg)| matches!(arg, Arg::Each(..)));
        let Some(labels) = labels else {
            // Without an axis for lack of order, there is no item to take.
            if each {
                return None;
            }
            let texts = texts(self.report, &self.flats[flat].params, &self.axes, 0);
            return binder.bind(self.report, &self.flats[flat], &texts).map(Numbers::One);
        };
        let special = self.instance_overrides(flat, labels);
        if !each && special.is_empty() {
            let texts = texts(self.report, &self.flats[flat].params, &self.axes, 0);
            return binder.bind(self.report, &self.flats[flat], &texts).map(Numbers::One);
        }
        let mut numbers = Vec::with_capacity(labels.len());
        let mut right = true;
        for item in 0..labels.len() {
            let mut texts = texts(self.report, &self.flats[flat].params, &self.axes, item);
            for (_, change) in special.iter().filter(|(at, _)| *at == item) {
                replace(&mut texts, self.text(change));
            }
            match binder.bind(self.report, &self.flats[flat], &texts) {
                Some(number) => numbers.push(number),
                None => right = false,
            }
        }
        right.then_some(Numbers::Each(numbers))
    }

    fn text(&self, change: &Override) -> Text {
        Text {
            name: change.param.text.clone(),
            ron: self.report.sources.text(change.value.span).into(),
            span: change.value.span,
            exact: true,
            dir: change.value.dir.clone(),
        }
    }

    /// The overrides that name instances of a node: (instance, override), in order.
    fn instance_overrides(&mut self, flat: usize, labels: &[String]) -> Vec<(usize, Override)> {
        let node = &self.flats[flat];
        let mut found = Vec::new();
        for (change, fate) in self.overrides.iter().zip(&mut self.fates) {
            if !change.instances {
                continue;
            }
            for (i, label) in labels.iter().enumerate() {
                if !matches(&change.node.text, &format!("{}[{label}]", node.address)) {
                    continue;
                }
                let param = &change.param.text;
                if node.kind.infos.iter().any(|info| info.name == *param) {
                    fate.matched = true;
                    found.push((i, change.clone()));
                } else if node.kind.node.ports().iter().any(|p| p.name == param) {
                    fate.wire = true;
                } else {
                    let known = || node.kind.infos.iter().map(|i| i.name.clone()).collect();
                    fate.lacks.get_or_insert_with(|| (node.kind.node.kind().to_owned(), known()));
                }
            }
        }
        found
    }

    fn show(
        &mut self,
        used: &mut Used,
        file: &GraphFile,
        linked: &Linked,
        labels: &BTreeMap<usize, Vec<String>>,
    ) -> Vec<Show> {
        let names = file.show.clone().unwrap_or_else(|| file.output.iter().cloned().collect());
        if names.is_empty() && !file.broken_show {
            self.report
                .error(file.span, "nothing-shown", "the graph shows nothing, so there is nothing to do")
                .hint("say which results are wanted: `show: [\"..\"]`");
        }
        let mut show = Vec::new();
        let mut seen = BTreeSet::new();
        for name in &names {
            if !seen.insert(&name.text) {
                let message = format!("`{}` is shown twice", name.text);
                self.report.error(name.span, "duplicate", message).hint("remove one of them");
            }
            let (node, label) = match name.text.strip_suffix(']').and_then(|t| t.split_once('[')) {
                Some((node, label)) => (node, Some(label)),
                None => (name.text.as_str(), None),
            };
            let Some(flat) = self.at_address(used, name, node) else { continue };
            let address = name.text.clone();
            let Some(label) = label else {
                show.push(Show { address, flat, instance: None });
                continue;
            };
            let along = linked.axis.get(flat).copied().flatten();
            let known = along.and_then(|a| labels.get(&a)).map_or(&[][..], Vec::as_slice);
            match known.iter().position(|l| l == label) {
                Some(i) => show.push(Show { address, flat, instance: Some(i) }),
                None if linked.order.len() == self.flats.len() => {
                    let known: Vec<&str> = known.iter().map(String::as_str).collect();
                    let hint = suggest(label, "instances", &known);
                    let message = format!("`{node}` has no instance `{label}`");
                    self.report.error(name.span, "unknown-node", message).hint(hint);
                }
                None => {}
            }
        }
        show
    }

    /// Overrides that change nothing in this variant; those of `--set` are judged over all variants.
    fn report_unmatched(&mut self, addresses: &[Vec<String>]) {
        if self.holes {
            return;
        }
        let mut known: Vec<&str> = addresses.iter().flatten().map(String::as_str).collect();
        known.extend(self.scopes.iter().map(|s| s.address.as_str()).filter(|a| !a.is_empty()));
        known.sort_unstable();
        known.dedup();
        for (change, fate) in self.overrides.iter().zip(&self.fates) {
            if !fate.matched && !change.outside {
                unmatched(self.report, change, fate, &known);
            }
        }
    }
}

fn replace(texts: &mut Vec<Text>, new: Text) {
    match texts.iter_mut().find(|t| t.name == new.name) {
        Some(old) => *old = new,
        None => texts.push(new),
    }
}
