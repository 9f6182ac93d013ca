//! A graph file as written: its fields, calls and names with their places.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::syntax::{self, Call, Field, Name, Value};
use crate::diagnostics::{Diagnostics, Span, suggest};

const FIELDS: [&str; 9] = ["format", "inputs", "params", "over", "nodes", "output", "show", "base", "variants"];
/// Bytes that a graph file may have; a larger one is surely not a graph.
const LARGEST: u64 = 16 << 20;

/// A call in `nodes`.
#[derive(Clone, Debug)]
pub struct Node {
    pub name: Name,
    pub kind: Name,
    pub fields: Vec<Field>,
}

/// What a variant does to its base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum How {
    /// One variant.
    Set,
    /// One variant for each combination of the listed values.
    Sweep,
    /// One variant for each position in the lists.
    Zip,
}

/// A variant: params by pattern of node, and named values of the graph.
#[derive(Clone, Debug)]
pub struct Variant {
    pub name: Name,
    pub how: How,
    pub changes: Vec<(Name, Vec<Field>)>,
    /// Named values of the graph.
    pub params: Vec<Field>,
}

/// A graph file, with its base merged in.
#[derive(Clone, Debug)]
pub struct GraphFile {
    pub path: PathBuf,
    pub dir: Rc<Path>,
    /// Its opening bracket: the place of what is missing.
    pub span: Span,
    pub inputs: Vec<(Name, Name)>,
    pub params: Vec<Field>,
    pub over: Vec<Field>,
    pub nodes: Vec<Node>,
    pub output: Option<Name>,
    pub show: Option<Vec<Name>>,
    pub variants: Vec<Variant>,
    /// Nodes with an error in their syntax.
    pub broken: Vec<Name>,
    /// Whether `show` has an error in its syntax.
    pub broken_show: bool,
}

/// Reads graph files, each once.
#[derive(Default)]
pub struct Files {
    read: BTreeMap<PathBuf, Option<Rc<GraphFile>>>,
    pub planned_from: Vec<PathBuf>,
    /// What each file held, `None` if it could not be read.
    pub texts: BTreeMap<PathBuf, Option<Vec<u8>>>,
}

impl Files {
    /// Reads a file and its bases. `from` is where it is named; `chain` the files being read, whose
    /// naming again would never end.
    pub fn load(
        &mut self,
        report: &mut Diagnostics,
        path: &Path,
        from: Option<Span>,
        chain: &[PathBuf],
    ) -> Option<Rc<GraphFile>> {
        let path = tidy(path);
        if let Some(from) = from
            && chain.contains(&path)
        {
            let names: Vec<_> = chain.iter().chain([&path]).map(|p| p.display().to_string()).collect();
            report
                .error(from, "recursion", format!("this file uses itself: {}", names.join(" -> ")))
                .hint("a graph cannot contain itself");
            return None;
        }
        if let Some(known) = self.read.get(&path) {
            if known.is_none()
                && let Some(from) = from
            {
                report.error(from, "bad-subgraph", format!("{} cannot be used: it has an error", path.display()));
            }
            return known.clone();
        }
        let file = self.read(report, &path, from, chain);
        self.read.insert(path, file.clone());
        file
    }

    fn read(
        &mut self,
        report: &mut Diagnostics,
        path: &Path,
        from: Option<Span>,
        chain: &[PathBuf],
    ) -> Option<Rc<GraphFile>> {
        self.planned_from.push(path.to_owned());
        let name = path.display().to_string();
        let bytes = bytes(path);
        self.texts.insert(path.to_owned(), bytes.as_ref().ok().cloned());
        let text = match bytes.and_then(text) {
            Ok(text) => text,
            Err(why) => {
                let span = from.unwrap_or_else(|| report.sources.add(name.clone(), ""));
                report.error(span, "unreadable", format!("cannot read the graph {name}: {why}"));
                return None;
            }
        };
        let whole = report.sources.add(name, &text);
        let span = syntax::check(report, whole)?;
        let dir: Rc<Path> = path.parent().unwrap_or(Path::new("")).into();
        let (mut file, base) = parse(report, path, &Value { span, dir: dir.clone() })?;
        if let Some(base) = base {
            let mut chain = chain.to_vec();
            chain.push(path.to_owned());
            let below = self.load(report, &dir.join(&base.text), Some(base.span), &chain)?;
            file.merge(report, &below);
        }
        Some(Rc::new(file))
    }
}

/// The content of a graph file.
pub fn bytes(path: &Path) -> Result<Vec<u8>, String> {
    let size = std::fs::metadata(path).map_err(|e| e.to_string())?.len();
    if size > LARGEST {
        return Err(format!("it has {size} bytes; a graph has at most {LARGEST}"));
    }
    std::fs::read(path).map_err(|e| e.to_string())
}

fn text(bytes: Vec<u8>) -> Result<String, String> {
    String::from_utf8(bytes).map_err(|e| format!("byte {} is not UTF-8", e.utf8_error().valid_up_to()))
}

/// The path without `.` components.
pub fn tidy(path: &Path) -> PathBuf {
    path.components().filter(|c| !matches!(c, std::path::Component::CurDir)).collect()
}

fn parse(report: &mut Diagnostics, path: &Path, value: &Value) -> Option<(GraphFile, Option<Name>)> {
    let fields = match value.call(report) {
        Some(Call::Named(name, fields)) if name.text.is_empty() => fields,
        _ => {
            report
                .error(value.span, "syntax", "a graph file is a record in round brackets")
                .hint("begin with `(format: 1, nodes: {`");
            return None;
        }
    };
    let span = value.span.part(&(0..1));
    let mut file = GraphFile {
        path: path.to_owned(),
        dir: value.dir.clone(),
        span,
        inputs: Vec::new(),
        params: Vec::new(),
        over: Vec::new(),
        nodes: Vec::new(),
        output: None,
        show: None,
        variants: Vec::new(),
        broken: Vec::new(),
        broken_show: false,
    };
    let mut base = None;
    let mut format = false;
    for field in unique(report, fields, "field") {
        match field.name.text.as_str() {
            "format" => {
                format = true;
                check_format(report, &field.value);
            }
            "inputs" => file.inputs = inputs(report, &field.value),
            "params" => file.params = names(report, &field.value, "param"),
            "over" => file.over = names(report, &field.value, "axis"),
            "nodes" => (file.nodes, file.broken) = nodes(report, &field.value),
            "output" => file.output = text_of(report, &field.value, "the name of a node"),
            "show" => {
                file.show = show(report, &field.value);
                file.broken_show = file.show.is_none();
            }
            "base" => base = text_of(report, &field.value, "the path of a graph file"),
            "variants" => file.variants = variants(report, &field.value),
            other => {
                let hint = suggest(other, "fields of a graph", &FIELDS);
                report.error(field.name.span, "unknown-field", format!("a graph has no field `{other}`")).hint(hint);
            }
        }
    }
    if !format {
        report.error(span, "format", "the graph does not say which format it is in").hint("begin with `(format: 1,`");
    }
    Some((file, base))
}

fn check_format(report: &mut Diagnostics, value: &Value) {
    let text = report.sources.text(value.span).to_owned();
    if text != "1" {
        report
            .error(value.span, "format", format!("format {text} is not known to this version"))
            .hint("the format of graphs is 1");
    }
}

impl GraphFile {
    /// Adds what the base says: its nodes and axes, and its params, show and output where this file
    /// is silent.
    fn merge(&mut self, report: &mut Diagnostics, base: &Self) {
        for (name, artefact) in &base.inputs {
            self.inputs.push((name.clone(), artefact.clone()));
        }
        let mut params = base.params.clone();
        for field in std::mem::take(&mut self.params) {
            match params.iter_mut().find(|p| p.name.text == field.name.text) {
                Some(old) => *old = field,
                None => params.push(field),
            }
        }
        self.params = params;
        let mut over = base.over.clone();
        for field in std::mem::take(&mut self.over) {
            match over.iter_mut().find(|p| p.name.text == field.name.text) {
                Some(old) => *old = field,
                None => over.push(field),
            }
        }
        self.over = over;
        let own = std::mem::replace(&mut self.nodes, base.nodes.clone());
        for node in own {
            if base.nodes.iter().any(|n| n.name.text == node.name.text) {
                let name = &node.name.text;
                report
                    .error(node.name.span, "duplicate", format!("the base has a node `{name}` already"))
                    .hint("a variant's `set` changes params of the base's nodes");
            } else {
                self.nodes.push(node);
            }
        }
        let own = std::mem::replace(&mut self.variants, base.variants.clone());
        for variant in own {
            if base.variants.iter().any(|v| v.name.text == variant.name.text) {
                let name = &variant.name.text;
                report.error(variant.name.span, "duplicate", format!("the base has a variant `{name}` already"));
            } else {
                self.variants.push(variant);
            }
        }
        self.broken.extend(base.broken.iter().cloned());
        self.broken_show |= base.broken_show;
        self.show = self.show.take().or_else(|| base.show.clone());
        self.output = self.output.take().or_else(|| base.output.clone());
    }
}

/// Reports fields of equal name and keeps the first of each.
pub fn unique(report: &mut Diagnostics, fields: Vec<Field>, what: &str) -> Vec<Field> {
    let mut seen = std::collections::BTreeSet::new();
    let mut kept = Vec::with_capacity(fields.len());
    for field in fields {
        if seen.insert(field.name.text.clone()) {
            kept.push(field);
        } else {
            let name = &field.name.text;
            report
                .error(field.name.span, "duplicate", format!("there are two {what}s `{name}`"))
                .hint("remove or rename one of them");
        }
    }
    kept
}

fn text_of(report: &mut Diagnostics, value: &Value, what: &str) -> Option<Name> {
    let text = value.string(report);
    if text.is_none() {
        report.error(value.span, "syntax", format!("{what} in quotation marks is expected here"));
    }
    text
}

/// Entries of a map whose keys are names of our own: unique and of plain characters.
fn names(report: &mut Diagnostics, value: &Value, what: &str) -> Vec<Field> {
    let Some(fields) = value.map(report) else {
        report
            .error(value.span, "syntax", format!("the {what}s are written {{\"name\": ..}}"))
            .hint("a map in curly brackets, its keys in quotation marks");
        return Vec::new();
    };
    let fields = unique(report, fields, what);
    let plain = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    for Field { name, .. } in &fields {
        if name.text.is_empty() || !name.text.chars().all(plain) {
            report
                .error(name.span, "bad-name", format!("`{}` cannot be the name of a {what}", name.text))
                .hint("names are made of letters, digits, `_` and `-`");
        }
    }
    fields
}

fn inputs(report: &mut Diagnostics, value: &Value) -> Vec<(Name, Name)> {
    let fields = names(report, value, "input");
    let of = |f: Field| Some((f.name, text_of(report, &f.value, "the name of an artefact type")?));
    fields.into_iter().filter_map(of).collect()
}

/// The calls, and the names of those that are none.
fn nodes(report: &mut Diagnostics, value: &Value) -> (Vec<Node>, Vec<Name>) {
    let fields = names(report, value, "node");
    let (mut nodes, mut broken) = (Vec::with_capacity(fields.len()), Vec::new());
    for Field { name, value } in fields {
        match value.call(report) {
            Some(Call::Named(kind, fields)) if !kind.text.is_empty() => {
                let fields = unique(report, fields, "field");
                nodes.push(Node { name, kind, fields });
            }
            _ => {
                broken.push(name);
                report
                    .error(value.span, "syntax", "a node is written as a call of its kind")
                    .hint("for example `load(path: \"cat.off\")`; each field has a name");
            }
        }
    }
    (nodes, broken)
}

fn show(report: &mut Diagnostics, value: &Value) -> Option<Vec<Name>> {
    let Some(items) = value.list(report) else {
        report.error(value.span, "syntax", "what is shown is a list of names").hint("for example `show: [\"match\"]`");
        return None;
    };
    items.iter().map(|item| text_of(report, item, "the name of a node")).collect()
}

fn variants(report: &mut Diagnostics, value: &Value) -> Vec<Variant> {
    let fields = names(report, value, "variant");
    fields.into_iter().filter_map(|f| variant(report, f)).collect()
}

fn variant(report: &mut Diagnostics, field: Field) -> Option<Variant> {
    const HINT: &str = "for example `set({\"*/patches\": (radius: 2.0)})`, or `sweep` or `zip` with \
                        lists of values";
    let call = match field.value.call(report) {
        Some(Call::Positional(name, args)) if args.len() == 1 => Some((name, args)),
        _ => None,
    };
    let how = call.as_ref().and_then(|(name, _)| match name.text.as_str() {
        "set" => Some(How::Set),
        "sweep" => Some(How::Sweep),
        "zip" => Some(How::Zip),
        _ => None,
    });
    let (Some(how), Some((_, args))) = (how, call) else {
        report.error(field.value.span, "syntax", "a variant is `set({..})`, `sweep({..})` or `zip({..})`").hint(HINT);
        return None;
    };
    let Some(entries) = args[0].map(report) else {
        report.error(args[0].span, "syntax", "a map of nodes to params is expected here").hint(HINT);
        return None;
    };
    let (mut changes, mut params) = (Vec::new(), Vec::new());
    for entry in unique(report, entries, "change") {
        match entry.value.call(report) {
            Some(Call::Named(name, fields)) if name.text.is_empty() => {
                changes.push((entry.name, unique(report, fields, "param")));
            }
            // No pattern of nodes, and no record of params: a named value of the graph.
            _ if !entry.name.text.contains(['*', '/', '[', ':']) => params.push(entry),
            _ => {
                report.error(entry.value.span, "syntax", "params are written `(name: value, ..)`").hint(HINT);
            }
        }
    }
    Some(Variant { name: field.name, how, changes, params })
}
