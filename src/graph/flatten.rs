//! Subgraph calls opened up: from nested files to one flat list of node calls.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use salient_sdk::{AnyNode, ParamInfo, Registry};

use super::axes::{Axis, Globs};
use super::file::{Files, GraphFile, Node};
use super::overrides::{Fate, Override, matches};
use super::syntax::{Call, Field, Name, Value};
use crate::diagnostics::{Diagnostics, Span, did_you_mean, suggest};

/// Nodes that a graph may have before axes are expanded.
const MOST_NODES: usize = 100_000;
/// Subgraph calls that may be inside one another.
const DEEPEST: usize = 64;

/// A kind of node with its documented params.
pub struct Kind {
    pub node: &'static dyn AnyNode,
    pub infos: Vec<ParamInfo>,
}

/// Kinds looked up once each.
pub struct Kinds<'a> {
    registry: &'a Registry,
    known: HashMap<&'static str, Rc<Kind>>,
}

impl<'a> Kinds<'a> {
    pub fn new(registry: &'a Registry) -> Self {
        Self { registry, known: HashMap::new() }
    }

    fn get(&mut self, kind: &str) -> Option<Rc<Kind>> {
        let node = self.registry.get(kind)?;
        let make = || Rc::new(Kind { node, infos: node.params() });
        Some(self.known.entry(node.kind()).or_insert_with(make).clone())
    }

    /// Names of the artefact types that nodes make.
    pub fn artefacts(&self) -> Vec<&'static str> {
        self.registry.artefacts().into_keys().collect()
    }

    /// Kinds of node that make an artefact type.
    pub fn makers(&self, artefact: &str) -> Vec<String> {
        let makes = |node: &&'static dyn AnyNode| node.output().name == artefact;
        self.registry.iter().filter(makes).map(|node| format!("`{}`", node.kind())).collect()
    }
}

/// The value of a param after `param(..)` is looked up.
#[derive(Clone)]
pub enum Arg {
    /// RON text.
    Text(Value),
    /// The item of an axis.
    Each(usize, Span),
    /// For each item of an axis of files its name and its folder's, at a place.
    Folders(usize, Span),
    /// Given, but wrong, which has been reported.
    Broken,
}

/// One node call, its address unique in the variant.
pub struct Flat {
    pub address: String,
    pub scope: usize,
    /// Where its kind is written.
    pub span: Span,
    pub kind: Rc<Kind>,
    /// Index of the port and what is written there.
    pub wires: Vec<(usize, Value)>,
    pub params: Vec<(String, Arg)>,
    /// The folder of the file that calls it.
    pub dir: Rc<Path>,
}

/// What a name means inside a graph file.
#[derive(Clone, Copy)]
pub enum Entry {
    /// A node, by its index in the flat list.
    Node(usize),
    /// A subgraph call, by its scope.
    Call(usize),
    /// An input of this subgraph.
    Input(usize),
    /// A node with an error of its own.
    Broken,
}

/// One use of a graph file: the root, or a subgraph call.
pub struct Scope {
    pub file: Rc<GraphFile>,
    /// `fa` for what is inside the call `fa`; empty at the root.
    pub address: String,
    pub parent: usize,
    pub names: BTreeMap<String, Entry>,
    /// What the caller wires to each input.
    pub inputs: Vec<Option<Value>>,
    /// Named values, each with the scope that it is to be read in.
    params: BTreeMap<String, (usize, Value)>,
    pub axes: BTreeMap<String, usize>,
}

impl Scope {
    fn inside(&self, name: &str) -> String {
        if self.address.is_empty() { name.to_owned() } else { format!("{}/{name}", self.address) }
    }
}

/// The graph of one variant, being flattened.
pub struct Walk<'a, 'r> {
    pub report: &'a mut Diagnostics,
    pub files: &'a mut Files,
    pub kinds: &'a mut Kinds<'r>,
    pub globs: &'a mut Globs,
    pub overrides: Vec<Override>,
    pub fates: Vec<Fate>,
    pub scopes: Vec<Scope>,
    pub flats: Vec<Flat>,
    pub axes: Vec<Axis>,
    /// Files of the subgraph calls that are open.
    chain: Vec<PathBuf>,
    /// Whether a part of the graph could not be read, so that names may be missing for that reason.
    pub holes: bool,
}

impl<'a, 'r> Walk<'a, 'r> {
    pub fn new(
        report: &'a mut Diagnostics,
        files: &'a mut Files,
        kinds: &'a mut Kinds<'r>,
        globs: &'a mut Globs,
        overrides: Vec<Override>,
    ) -> Self {
        let fates = vec![Fate::default(); overrides.len()];
        Self {
            report,
            files,
            kinds,
            globs,
            overrides,
            fates,
            scopes: Vec::new(),
            flats: Vec::new(),
            axes: Vec::new(),
            chain: Vec::new(),
            holes: false,
        }
    }

    /// Flattens the root graph; `sets` replace its named values.
    pub fn root(&mut self, file: &Rc<GraphFile>, sets: &[Field]) {
        let mut given = BTreeMap::new();
        for set in sets {
            if file.params.iter().any(|p| p.name.text == set.name.text) {
                given.insert(set.name.text.clone(), (0, set.value.clone()));
                continue;
            }
            let names: Vec<&str> = file.params.iter().map(|p| p.name.text.as_str()).collect();
            let hint = if file.nodes.iter().any(|n| n.name.text == set.name.text) {
                format!("`{0}` is a node; set a param of it with --set {0}.PARAM=VALUE", set.name.text)
            } else {
                suggest(&set.name.text, "params of the graph", &names)
            };
            self.report
                .error(set.name.span, "override-unmatched", format!("the graph has no param `{}`", set.name.text))
                .hint(hint);
        }
        self.open(file, String::new(), 0, Vec::new(), given);
    }

    /// Adds a scope and all that is in it, and returns its index.
    fn open(
        &mut self,
        file: &Rc<GraphFile>,
        address: String,
        parent: usize,
        inputs: Vec<Option<Value>>,
        given: BTreeMap<String, (usize, Value)>,
    ) -> usize {
        let at = self.scopes.len();
        let own = file.params.iter().map(|p| (p.name.text.clone(), (at, p.value.clone())));
        let params = own.chain(given).collect();
        let mut names = BTreeMap::new();
        for (i, (name, _)) in file.inputs.iter().enumerate() {
            names.insert(name.text.clone(), Entry::Input(i));
        }
        self.holes |= !file.broken.is_empty();
        names.extend(file.broken.iter().map(|name| (name.text.clone(), Entry::Broken)));
        self.scopes.push(Scope { file: file.clone(), address, parent, names, inputs, params, axes: BTreeMap::new() });
        self.chain.push(file.path.clone());
        self.open_axes(at);
        for node in &file.nodes {
            let entry = if node.kind.text == "graph" { self.subgraph(at, node) } else { self.node(at, node) };
            let name = node.name.text.clone();
            if let Some(Entry::Input(_)) = self.scopes[at].names.insert(name, entry) {
                let name = &node.name.text;
                let message = format!("the graph has an input `{name}` already");
                self.report.error(node.name.span, "duplicate", message).hint("rename the node or the input");
            }
        }
        self.chain.pop();
        at
    }

    fn node(&mut self, scope: usize, node: &Node) -> Entry {
        let Some(kind) = self.kinds.get(&node.kind.text) else {
            self.unknown_kind(&node.kind);
            self.holes = true;
            return Entry::Broken;
        };
        if self.flats.len() >= MOST_NODES {
            self.report.error(node.name.span, "too-large", format!("the graph has more than {MOST_NODES} nodes"));
            return Entry::Broken;
        }
        let ports: Vec<&str> = kind.node.ports().iter().map(|p| p.name).collect();
        let params: Vec<&str> = kind.infos.iter().map(|p| p.name.as_str()).collect();
        let address = self.scopes[scope].inside(&node.name.text);
        let mut wires = Vec::new();
        let mut args: Vec<(String, Arg)> = Vec::new();
        for field in &node.fields {
            let name = field.name.text.as_str();
            if let Some(port) = ports.iter().position(|p| *p == name) {
                wires.push((port, field.value.clone()));
            } else if params.contains(&name) {
                let arg = self.arg(scope, &field.value).unwrap_or(Arg::Broken);
                args.push((name.to_owned(), arg));
            } else {
                let both: Vec<&str> = ports.iter().chain(&params).copied().collect();
                let hint = suggest(name, "ports and params", &both);
                let message = format!("`{}` has no port or param `{name}`", kind.node.kind());
                self.report.error(field.name.span, "unknown-field", message).hint(hint);
            }
        }
        for (name, value) in self.overrides_at(&address, kind.node.kind(), &params, &ports) {
            let arg = self.arg(0, &value).unwrap_or(Arg::Broken);
            match args.iter_mut().find(|(n, _)| *n == name) {
                Some(old) => old.1 = arg,
                None => args.push((name, arg)),
            }
        }
        let dir = self.scopes[scope].file.dir.clone();
        let span = node.kind.span;
        self.flats.push(Flat { address, scope, span, kind, wires, params: args, dir });
        Entry::Node(self.flats.len() - 1)
    }

    fn unknown_kind(&mut self, kind: &Name) {
        let known = self.kinds.registry.iter().map(AnyNode::kind).chain(["graph"]);
        let hint = did_you_mean(&kind.text, known).unwrap_or_else(|| "`salient nodes` lists all kinds".into());
        self.report.error(kind.span, "unknown-kind", format!("there is no kind of node `{}`", kind.text)).hint(hint);
    }

    /// The overrides that change a node, in order; the last of a name wins.
    fn overrides_at(&mut self, address: &str, kind: &str, params: &[&str], wires: &[&str]) -> Vec<(String, Value)> {
        let mut found = Vec::new();
        for (change, fate) in self.overrides.iter().zip(&mut self.fates) {
            if change.instances || !matches(&change.node.text, address) {
                continue;
            }
            let param = change.param.text.as_str();
            if params.contains(&param) {
                fate.matched = true;
                found.push((param.to_owned(), change.value.clone()));
            } else if wires.contains(&param) {
                fate.wire = true;
            } else {
                let known = || params.iter().map(|p| (*p).to_owned()).collect();
                fate.lacks.get_or_insert_with(|| (kind.to_owned(), known()));
            }
        }
        found
    }

    fn subgraph(&mut self, scope: usize, node: &Node) -> Entry {
        let address = self.scopes[scope].inside(&node.name.text);
        if self.scopes.len() >= MOST_NODES || self.chain.len() >= DEEPEST {
            let message = format!("more than {MOST_NODES} subgraph calls, or more than {DEEPEST} in one another");
            self.report.error(node.name.span, "too-large", message);
            self.holes = true;
            return Entry::Broken;
        }
        let Some(file) = self.subgraph_file(scope, node, &address) else {
            self.holes = true;
            return Entry::Broken;
        };
        let inputs: Vec<&str> = file.inputs.iter().map(|(name, _)| name.text.as_str()).collect();
        let params: Vec<&str> = file.params.iter().map(|p| p.name.text.as_str()).collect();
        let mut wired = vec![None; inputs.len()];
        let mut given = BTreeMap::new();
        for field in node.fields.iter().filter(|f| f.name.text != "file") {
            let name = field.name.text.as_str();
            if let Some(i) = inputs.iter().position(|x| *x == name) {
                wired[i] = Some(field.value.clone());
            } else if params.contains(&name) {
                given.insert(name.to_owned(), (scope, field.value.clone()));
            } else {
                let both: Vec<&str> = inputs.iter().chain(&params).copied().collect();
                let hint = suggest(name, "inputs and params", &both);
                let message = format!("{} has no input or param `{name}`", file.path.display());
                self.report.error(field.name.span, "unknown-field", message).hint(hint);
            }
        }
        for (i, (name, artefact)) in file.inputs.iter().enumerate() {
            if wired[i].is_none() {
                let (name, artefact) = (&name.text, &artefact.text);
                self.report
                    .error(node.kind.span, "missing-input", format!("the input `{name}` is not wired"))
                    .hint(format!("add `{name}: \"..\"`, the name of a node that makes `{artefact}`"));
            }
        }
        let settable: Vec<&str> = params.iter().copied().chain(["file"]).collect();
        for (name, value) in self.overrides_at(&address, "graph", &settable, &inputs) {
            if name != "file" {
                given.insert(name, (0, value));
            }
        }
        Entry::Call(self.open(&file, address, scope, wired, given))
    }

    fn subgraph_file(&mut self, scope: usize, node: &Node, address: &str) -> Option<Rc<GraphFile>> {
        let replaced = self
            .overrides
            .iter()
            .rev()
            .find(|o| o.param.text == "file" && !o.instances && matches(&o.node.text, address));
        let written = node.fields.iter().find(|f| f.name.text == "file").map(|f| &f.value);
        let Some(value) = replaced.map(|o| &o.value).or(written).cloned() else {
            self.report
                .error(node.kind.span, "missing-param", "the subgraph call does not name its file")
                .hint("add `file: \"sub.ron\"`");
            return None;
        };
        let value = self.follow(scope, &value)?.1;
        let Some(name) = value.string(self.report) else {
            self.report.error(value.span, "bad-param", "the path of a graph file is expected here");
            return None;
        };
        let path = value.dir.join(&name.text);
        let chain = self.chain.clone();
        let file = self.files.load(self.report, &path, Some(name.span), &chain)?;
        if file.output.is_none() {
            self.report
                .error(name.span, "bad-subgraph", format!("{} has no output", file.path.display()))
                .hint("name its result there: `output: \"..\"`");
            return None;
        }
        if !file.variants.is_empty() {
            self.report.error(
                name.span,
                "bad-subgraph",
                format!("{} has variants, so it cannot be called", file.path.display()),
            );
            return None;
        }
        Some(file)
    }

    /// Follows `param("name")` to a value and the scope to read it in.
    pub fn follow(&mut self, scope: usize, value: &Value) -> Option<(usize, Value)> {
        let (mut scope, mut value) = (scope, value.clone());
        for _ in 0..64 {
            let name = match value.word(self.report, "param") {
                None => return Some((scope, value)),
                Some(Ok(name)) => name,
                Some(Err(span)) => {
                    self.report.error(span, "syntax", "`param` takes one name: `param(\"name\")`");
                    return None;
                }
            };
            let Some((next, found)) = self.scopes[scope].params.get(&name.text).cloned() else {
                let known: Vec<&str> = self.scopes[scope].params.keys().map(String::as_str).collect();
                let hint = suggest(&name.text, "params of the graph", &known);
                self.report
                    .error(name.span, "unknown-param", format!("the graph has no param `{}`", name.text))
                    .hint(hint);
                return None;
            };
            (scope, value) = (next, found);
        }
        self.report.error(value.span, "cycle", "this param is made of itself");
        None
    }

    /// The value of a param: text, or the item of an axis.
    fn arg(&mut self, scope: usize, value: &Value) -> Option<Arg> {
        let (scope, value) = self.follow(scope, value)?;
        for word in ["each", "folders"] {
            match value.word(self.report, word) {
                None => {}
                Some(Ok(name)) => {
                    let Some(axis) = self.scopes[scope].axes.get(&name.text) else {
                        let known: Vec<&str> = self.scopes[scope].axes.keys().map(String::as_str).collect();
                        let hint = suggest(&name.text, "axes", &known);
                        let message = format!("the graph has no axis `{}`", name.text);
                        // An axis with an error of its own has been reported.
                        if !self.scopes[scope].file.over.iter().any(|axis| axis.name.text == name.text) {
                            self.report.error(name.span, "unknown-axis", message).hint(hint);
                        }
                        return None;
                    };
                    let arg = if word == "each" { Arg::Each } else { Arg::Folders };
                    return Some(arg(*axis, value.span));
                }
                Some(Err(span)) => {
                    let message = format!("`{word}` takes one axis: `{word}(\"axis\")`");
                    self.report.error(span, "syntax", message);
                    return None;
                }
            }
        }
        if let Some(Call::Positional(name, _)) = value.call(self.report)
            && matches!(name.text.as_str(), "files" | "all")
        {
            let hint = if name.text == "files" {
                "name the files as an axis, `over: {\"shape\": files(..)}`, and take `each(\"shape\")`"
            } else {
                "`all` gathers the instances of a node into a port, not into a param"
            };
            self.report.error(value.span, "bad-param", format!("`{}(..)` is not a value", name.text)).hint(hint);
            return None;
        }
        Some(Arg::Text(value))
    }
}
