//! Why a call is not in the cache: what changed, since when, back to the file or param that did it.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt;
use std::sync::Arc;

use petgraph::graph::NodeIndex;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::cache::{Cache, CacheError};
use super::forecast::{Forecast, Verdict};
use super::history::{RunOutcome, RunRecord};
use super::key::{Digest, Ingredients, wires};
use super::schedule::State;
use super::sources::Sources;
use crate::graph::Plan;

/// How many changed inputs of one call are followed up.
const MAX_INPUTS: usize = 5;
/// How many calls of a kind are compared when the graph has not run before.
const MAX_NEAREST: usize = 200;

/// One thing that is not as it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Cause {
    /// Nothing like it was ever computed in this cache.
    NeverComputed,
    /// It failed in the run compared with.
    FailedBefore {
        /// What it said.
        message: String,
    },
    /// The address means a node of another kind.
    Kind {
        /// Then.
        before: String,
        /// Now.
        now: String,
    },
    /// A param has another value. For a file param this is the extension.
    Param {
        /// The param.
        name: String,
        /// Its value then; none if it did not exist.
        before: Option<Value>,
        /// Its value now.
        now: Option<Value>,
    },
    /// An input file has other content.
    File {
        /// The param that names it.
        param: String,
        /// Its path then.
        before: String,
        /// Its path now.
        now: String,
    },
    /// A file that the node found beside its own has other content, appeared or vanished.
    Read {
        /// The param beside whose file it lies.
        param: String,
        /// Its path relative to that file's folder.
        beside: String,
    },
    /// An input has other content, or may have, as its call executes.
    Input {
        /// The port.
        port: String,
        /// The label on a port that takes many.
        label: String,
        /// Address of the producer now.
        from: String,
        /// Why that is; empty if it was said before, and in the record of a run, where it is said of the producer.
        because: Vec<Cause>,
    },
    /// More inputs changed than are listed.
    MoreInputs {
        /// How many.
        count: usize,
    },
    /// A port is fed by another number of calls, or by calls of other labels.
    Rewired {
        /// The port.
        port: String,
        /// Producers then.
        before: Vec<String>,
        /// Producers now.
        now: Vec<String>,
    },
    /// The node has another version.
    Version {
        /// Then.
        before: u32,
        /// Now.
        now: u32,
    },
    /// The output has another byte layout.
    Format {
        /// Then.
        before: u32,
        /// Now.
        now: u32,
    },
    /// The output is known, but its bytes were collected, and they are needed.
    Evicted {
        /// Address of a call that needs them.
        needed_by: String,
    },
    /// Nothing changed, but the record of the output was collected or damaged.
    RecordGone,
    /// An input file cannot be read.
    Unreadable {
        /// Which, and why.
        message: String,
    },
}

/// In words.
impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |value: &Option<Value>| value.as_ref().map_or_else(|| "nothing".to_owned(), Value::to_string);
        match self {
            Self::NeverComputed => f.write_str("it was never computed in this cache"),
            Self::FailedBefore { message } => write!(f, "it failed last time: {message}"),
            Self::Kind { before, now } => write!(f, "it was a `{before}`, is a `{now}`"),
            Self::Param { name, before, now } => write!(f, "param `{name}` was {}, is {}", value(before), value(now)),
            Self::File { param, before, now } if before == now => {
                write!(f, "the content of {now} (param `{param}`) changed")
            }
            Self::File { param, before, now } => {
                write!(f, "param `{param}` names {now}, whose content is not that of {before}")
            }
            Self::Read { param, beside } => {
                write!(f, "the content of {beside}, which lies beside the file of `{param}`, changed")
            }
            Self::Input { port, label, from, because } => {
                let label = if label.is_empty() { String::new() } else { format!(" [{label}]") };
                let because = if because.is_empty() { " (see above)" } else { ":" };
                write!(f, "input `{port}`{label} from {from} changed or may change{because}")
            }
            Self::MoreInputs { count: 1 } => f.write_str("and 1 more input"),
            Self::MoreInputs { count } => write!(f, "and {count} more inputs"),
            Self::Rewired { port, before, now } => rewired(port, before, now, f),
            Self::Version { before, now } => write!(f, "the node's version was {before}, is {now}"),
            Self::Format { before, now } => write!(f, "the format of its output was {before}, is {now}"),
            Self::Evicted { needed_by } => {
                write!(f, "its output was removed from the cache, and {needed_by} needs it")
            }
            Self::RecordGone => f.write_str("nothing changed, but what the cache knew of it was removed or damaged"),
            Self::Unreadable { message } => f.write_str(message),
        }
    }
}

/// Of long lists, what came and went.
fn rewired(port: &str, before: &[String], now: &[String], f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let without = |these: &[String], those: &[String]| -> Vec<String> {
        let those: BTreeSet<&String> = those.iter().collect();
        these.iter().filter(|name| !those.contains(name)).cloned().collect()
    };
    let (gone, new) = (without(before, now), without(now, before));
    if before.len().max(now.len()) <= 3 || gone.len() + new.len() == 0 || gone.len() == before.len() {
        return write!(f, "port `{port}` was fed by {}, is fed by {}", list(before), list(now));
    }
    let [gone, new] = [(gone, "no longer"), (new, "also")]
        .map(|(names, word)| if names.is_empty() { None } else { Some(format!("{word} by {}", list(&names))) });
    let both: Vec<_> = [new, gone].into_iter().flatten().collect();
    write!(f, "port `{port}` is fed {}", both.join(", "))
}

/// The first of some names.
fn list(names: &[String]) -> String {
    match names {
        [] => "nothing".into(),
        [a, b, c, _, ..] => format!("{a}, {b}, {c} and {} more", names.len() - 3),
        _ => names.join(", "),
    }
}

/// Why a call would execute.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// Its address.
    pub node: String,
    /// What would become of it.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// When the run was that it is compared with, in milliseconds since 1970.
    pub since: Option<u64>,
    /// What changed; empty for a hit.
    pub causes: Vec<Cause>,
}

/// Explains what would become of a call that is in the forecast.
pub fn why(plan: &Plan, forecast: &Forecast, call: NodeIndex, cache: &Cache) -> Result<Explanation, CacheError> {
    let verdict = forecast.calls[&call].verdict.clone();
    let runs = cache.recent(&plan.file)?;
    let sources = Sources::new();
    let mut inquiry = Inquiry::new(plan, forecast, cache, &runs, &sources);
    let causes = match &verdict {
        Verdict::Hit => Vec::new(),
        _ => inquiry.causes(call)?,
    };
    let since = inquiry.before(call)?.and_then(|before| before.when);
    Ok(Explanation { node: plan.name(call).to_owned(), verdict, since, causes })
}

/// What is known of the calls now.
trait Now {
    /// What the output depends on, without inputs that are not known yet.
    fn ingredients(&self, call: NodeIndex) -> Option<Arc<Ingredients>>;
    /// Hash of the output, if it is known.
    fn digest(&self, call: NodeIndex) -> Option<Digest>;
    /// What would become of it, before a run.
    fn verdict(&self, call: NodeIndex) -> Option<&Verdict>;
}

impl Now for Forecast {
    fn ingredients(&self, call: NodeIndex) -> Option<Arc<Ingredients>> {
        self.calls[&call].ingredients.clone()
    }
    fn digest(&self, call: NodeIndex) -> Option<Digest> {
        self.calls[&call].record.as_ref().map(|record| record.digest)
    }
    fn verdict(&self, call: NodeIndex) -> Option<&Verdict> {
        Some(&self.calls[&call].verdict)
    }
}

/// The calls as a run has left them.
struct Ended<'a> {
    plan: &'a Plan,
    states: &'a BTreeMap<NodeIndex, State>,
    sources: &'a Sources,
}

impl Now for Ended<'_> {
    fn ingredients(&self, call: NodeIndex) -> Option<Arc<Ingredients>> {
        if let Some(record) = self.states.get(&call)?.record() {
            return Some(record.ingredients.clone());
        }
        let own = Ingredients::own(self.plan, call, self.sources).ok()?;
        let digests: Option<HashMap<_, _>> =
            wires(self.plan, call).into_iter().map(|(_, from)| Some((from, self.digest(from)?))).collect();
        let digests = digests?;
        Some(Arc::new(own.with_inputs(self.plan, call, |from| digests.get(&from).copied())))
    }
    fn digest(&self, call: NodeIndex) -> Option<Digest> {
        self.states.get(&call)?.record().map(|record| record.digest)
    }
    fn verdict(&self, _: NodeIndex) -> Option<&Verdict> {
        None
    }
}

/// Why the calls of a run were executed, asked after it.
pub(super) struct Hindsight<'a> {
    now: Ended<'a>,
    cache: &'a Cache,
    runs: Vec<RunRecord>,
}

impl<'a> Hindsight<'a> {
    pub(super) fn new(
        plan: &'a Plan,
        states: &'a BTreeMap<NodeIndex, State>,
        sources: &'a Sources,
        cache: &'a Cache,
    ) -> Result<Self, CacheError> {
        let runs = cache.recent(&plan.file)?;
        Ok(Self { now: Ended { plan, states, sources }, cache, runs })
    }

    /// The causes of each of these calls. A changed input is named, and its own cause is that of its producer.
    pub(super) fn all(
        &self,
        calls: impl Iterator<Item = NodeIndex>,
    ) -> Result<BTreeMap<NodeIndex, Vec<Cause>>, CacheError> {
        let mut inquiry = Inquiry::new(self.now.plan, &self.now, self.cache, &self.runs, self.now.sources);
        inquiry.hindsight = true;
        calls.map(|call| Ok((call, inquiry.causes(call)?))).collect()
    }
}

struct Inquiry<'a> {
    plan: &'a Plan,
    now: &'a dyn Now,
    cache: &'a Cache,
    /// Runs of this graph file, latest first, with the calls of their addresses.
    runs: Vec<(&'a RunRecord, HashMap<&'a str, usize>)>,
    /// Calls of other graphs' runs by kind, read when first needed.
    others: Option<HashMap<String, Vec<Ingredients>>>,
    sources: &'a Sources,
    seen: BTreeSet<NodeIndex>,
    /// Whether the run is over: each call's own causes are enough.
    hindsight: bool,
}

/// What a call is compared with.
struct Before {
    ingredients: Option<Ingredients>,
    /// Key and output of that time, by which its record is found.
    output: Option<(Digest, Digest)>,
    /// The message of its failure.
    failed: Option<String>,
    /// When the run was, if it is one of this graph.
    when: Option<u64>,
}

impl<'a> Inquiry<'a> {
    fn new(plan: &'a Plan, now: &'a dyn Now, cache: &'a Cache, runs: &'a [RunRecord], sources: &'a Sources) -> Self {
        let runs = runs.iter().map(|run| (run, run.body.addresses())).collect();
        Self { plan, now, cache, runs, others: None, sources, seen: BTreeSet::new(), hindsight: false }
    }

    /// The latest run of this graph in which the call came to something, else the nearest call of its kind.
    fn before(&mut self, call: NodeIndex) -> Result<Option<Before>, CacheError> {
        let mut failed = None;
        for (run, index) in &self.runs {
            let addresses = &self.plan.dag[call].addresses;
            let Some(at) = addresses.iter().find_map(|address| index.get(address.as_str()).copied()) else {
                continue;
            };
            let (then, when) = (&run.body.calls[at], run.summary.when);
            if then.outcome == RunOutcome::Failed {
                failed.get_or_insert((then.message.clone().unwrap_or_default(), when));
            }
            let Some(output) = then.key.zip(then.digest) else { continue };
            let failed = failed.map(|(message, _)| message);
            let ingredients = Some(run.body.ingredients(at));
            return Ok(Some(Before { ingredients, output: Some(output), failed, when: Some(when) }));
        }
        let nearest = if self.hindsight || failed.is_some() { None } else { self.nearest(call)? };
        let (failed, when) = failed.map_or((None, None), |(message, when)| (Some(message), Some(when)));
        let found = nearest.is_some() || failed.is_some();
        Ok(found.then_some(Before { ingredients: nearest, output: None, failed, when }))
    }

    /// The call of the same kind, in any recent run, that differs in the fewest things.
    fn nearest(&mut self, call: NodeIndex) -> Result<Option<Ingredients>, CacheError> {
        let Some(now) = self.now.ingredients(call) else { return Ok(None) };
        if self.others.is_none() {
            self.others = Some(self.cache.computed()?);
        }
        let of_kind = self.others.as_ref().and_then(|others| others.get(&now.kind));
        let nearest = of_kind.into_iter().flatten().min_by_key(|then| distance(then, &now));
        Ok(nearest.cloned())
    }

    fn causes(&mut self, call: NodeIndex) -> Result<Vec<Cause>, CacheError> {
        self.seen.insert(call);
        match self.now.verdict(call) {
            Some(Verdict::Unreadable { message }) => {
                return Ok(vec![Cause::Unreadable { message: message.clone() }]);
            }
            Some(Verdict::Evicted { needed_by }) => {
                return Ok(vec![Cause::Evicted { needed_by: needed_by.clone() }]);
            }
            _ => {}
        }
        let Some(before) = self.before(call)? else { return Ok(vec![Cause::NeverComputed]) };
        let mut causes = Vec::new();
        causes.extend(before.failed.map(|message| Cause::FailedBefore { message }));
        if let (Some(then), Some(now)) = (&before.ingredients, self.now.ingredients(call)) {
            causes.extend(own_changes(then, &now));
            if then.kind == now.kind {
                self.input_changes(call, then, &mut causes)?;
            }
        }
        if let Some((key, digest)) = before.output {
            // A key that is not changed leaves the files that the node discovers.
            let found = self.cache.records(&key)?.0;
            let then = found.iter().find(|record| record.digest == digest);
            if let Some(Ok(Some(read))) = then.map(|then| then.changed_read(&self.plan.dag[call], self.sources)) {
                let (param, beside) = (read.param.clone(), read.beside.clone());
                causes.push(Cause::Read { param, beside });
            }
        }
        if causes.is_empty() {
            causes.push(Cause::RecordGone);
        }
        Ok(causes)
    }

    fn input_changes(
        &mut self,
        call: NodeIndex,
        then: &Ingredients,
        causes: &mut Vec<Cause>,
    ) -> Result<(), CacheError> {
        let mut ports: BTreeMap<&str, Vec<(String, NodeIndex)>> = BTreeMap::new();
        for (wire, from) in wires(self.plan, call) {
            ports.entry(wire.port).or_default().push((wire.label.clone(), from));
        }
        let names: BTreeSet<&str> = ports.keys().copied().chain(then.inputs.iter().map(|i| i.port.as_str())).collect();
        let mut changed = Vec::new();
        for port in names {
            let now = ports.get(port).map_or(&[][..], Vec::as_slice);
            let before: Vec<_> = then.inputs.iter().filter(|i| i.port == port).collect();
            let same_labels = before.iter().map(|i| &i.label).eq(now.iter().map(|(l, _)| l));
            if !same_labels {
                causes.push(Cause::Rewired {
                    port: port.to_owned(),
                    before: before.iter().map(|i| i.from.clone()).collect(),
                    now: now.iter().map(|(_, from)| self.plan.name(*from).to_owned()).collect(),
                });
                continue;
            }
            for (input, (label, from)) in before.iter().zip(now) {
                if self.now.digest(*from) != Some(input.digest) {
                    changed.push((port.to_owned(), label.clone(), *from));
                }
            }
        }
        let more = changed.len().saturating_sub(MAX_INPUTS);
        for (port, label, from) in changed.into_iter().take(MAX_INPUTS) {
            let said = self.hindsight || self.seen.contains(&from);
            let because = if said { Vec::new() } else { self.causes(from)? };
            let from = self.plan.name(from).to_owned();
            causes.push(Cause::Input { port, label, from, because });
        }
        if more > 0 {
            causes.push(Cause::MoreInputs { count: more });
        }
        Ok(())
    }
}

impl Cache {
    /// What outputs of recent runs of any graph were made from, by kind, the latest first.
    fn computed(&self) -> Result<HashMap<String, Vec<Ingredients>>, CacheError> {
        let (mut all, mut seen): (HashMap<String, Vec<Ingredients>>, BTreeSet<Digest>) = Default::default();
        for run in self.readable()? {
            for (at, call) in run.body.calls.iter().enumerate() {
                let of_kind = all.entry(run.body.kind(at).name.clone()).or_default();
                if of_kind.len() < MAX_NEAREST && call.key.is_some_and(|key| seen.insert(key)) {
                    of_kind.push(run.body.ingredients(at));
                }
            }
        }
        Ok(all)
    }
}

/// What changed of the call itself: node, params and files.
pub(crate) fn own_changes(then: &Ingredients, now: &Ingredients) -> Vec<Cause> {
    let mut causes = Vec::new();
    if then.kind != now.kind {
        // Params and ports of another kind have nothing to do with each other.
        return vec![Cause::Kind { before: then.kind.clone(), now: now.kind.clone() }];
    }
    if then.version != now.version {
        causes.push(Cause::Version { before: then.version, now: now.version });
    }
    if (&then.output, then.format) != (&now.output, now.format) {
        causes.push(Cause::Format { before: then.format, now: now.format });
    }
    let names = |params: &Value| -> BTreeSet<String> {
        params.as_object().into_iter().flatten().map(|(name, _)| name.clone()).collect()
    };
    for name in names(&then.params).union(&names(&now.params)) {
        let (before, now) = (then.params.get(name).cloned(), now.params.get(name).cloned());
        if before != now {
            causes.push(Cause::Param { name: name.clone(), before, now });
        }
    }
    for (param, file) in &now.files {
        if let Some(before) = then.files.get(param).filter(|b| b.digest != file.digest) {
            let (before, now) = (before.path.clone(), file.path.clone());
            causes.push(Cause::File { param: param.clone(), before, now });
        }
    }
    causes
}

fn distance(then: &Ingredients, now: &Ingredients) -> usize {
    let digests = |of: &Ingredients| -> BTreeSet<_> {
        of.inputs.iter().map(|i| (i.port.clone(), i.label.clone(), i.digest)).collect()
    };
    let inputs = digests(then).symmetric_difference(&digests(now)).count();
    own_changes(then, now).len() + inputs
}
