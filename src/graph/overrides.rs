//! Changes to a graph from outside its file: `--set` and the `set`, `sweep` and `zip` of variants.

use std::path::Path;
use std::rc::Rc;

use super::file::{How, Variant};
use super::syntax::{self, Field, Name, Value};
use crate::diagnostics::{Diagnostics, Span, did_you_mean, suggest};

/// What the command line changes.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// `node.param=RON` or `param=RON`; the node may be a pattern with `*`.
    pub sets: Vec<String>,
    /// The variants or groups of variants to plan; all if `None`.
    pub variants: Option<Vec<String>>,
}

/// One param set on the nodes that a pattern matches.
#[derive(Clone, Debug)]
pub struct Override {
    /// Only in variants whose name or group this matches.
    pub variant: Option<String>,
    /// Pattern of addresses.
    pub node: Name,
    pub param: Name,
    pub value: Value,
    /// Whether the pattern speaks of instances on an axis.
    pub instances: bool,
    /// Whether it came from `--set`.
    pub outside: bool,
}

/// `--set` taken apart.
#[derive(Default)]
pub struct Sets {
    pub nodes: Vec<Override>,
    pub params: Vec<Field>,
}

/// Takes `--set` texts apart.
pub fn parse(report: &mut Diagnostics, sets: &[String]) -> Sets {
    let mut all = Sets::default();
    let dir: Rc<Path> = Path::new("").into();
    for text in sets {
        let whole = report.sources.add("--set".into(), text);
        let Some(equals) = outside_brackets(text, '=') else {
            report
                .error(whole, "bad-set", "this is not of the form NODE.PARAM=VALUE or PARAM=VALUE")
                .hint("for example --set 'fa/patches.radius=2.0'");
            continue;
        };
        let before = report.list.len();
        let span = syntax::check(report, whole.part(&(equals + 1..text.len())));
        for error in report.list.iter_mut().skip(before) {
            error.hint("the value is RON: text needs quotation marks, as in --set 'a.path=\"cat.off\"'");
        }
        let Some(span) = span else { continue };
        let value = Value { span, dir: dir.clone() };
        let left = trimmed(whole, text, 0..equals);
        let name = |range| {
            let span: Span = trimmed(whole, text, range);
            Name { text: report.sources.text(span).to_owned(), span }
        };
        match last_dot(report.sources.text(left)) {
            None => all.params.push(Field { name: name(0..equals), value }),
            Some(dot) => {
                let dot = left.start + dot;
                let (node, param) = (name(0..dot), name(dot + 1..equals));
                all.nodes.push(Override { outside: true, ..change(&node, &param, &value) });
            }
        }
    }
    all
}

fn trimmed(whole: Span, text: &str, range: std::ops::Range<usize>) -> Span {
    let piece = &text[range.clone()];
    let start = range.start + piece.len() - piece.trim_start().len();
    whole.part(&(start..start + piece.trim().len()))
}

/// The first `wanted` outside square brackets, which hold names of instances.
fn outside_brackets(text: &str, wanted: char) -> Option<usize> {
    let mut depth = 0_i32;
    for (at, c) in text.char_indices() {
        match c {
            '[' => depth += 1,
            ']' => depth -= 1,
            c if c == wanted && depth <= 0 => return Some(at),
            _ => {}
        }
    }
    None
}

/// The last dot outside square brackets.
fn last_dot(text: &str) -> Option<usize> {
    let after = text.rfind(']').map_or(0, |i| i + 1);
    text[after..].rfind('.').map(|i| after + i)
}

fn change(node: &Name, param: &Name, value: &Value) -> Override {
    let (variant, pattern) = match outside_brackets(&node.text, ':') {
        Some(colon) => (Some(node.text[..colon].to_owned()), &node.text[colon + 1..]),
        None => (None, node.text.as_str()),
    };
    Override {
        variant,
        instances: pattern.contains('['),
        node: Name { text: pattern.to_owned(), span: node.span },
        param: param.clone(),
        value: value.clone(),
        outside: false,
    }
}

/// One variant to plan.
#[derive(Clone, Debug, Default)]
pub struct Point {
    /// `paper`, or `radius[radius=1.0]` in a group; empty for a graph without variants.
    pub name: String,
    /// `paper`, or `radius`.
    pub group: String,
    pub changes: Vec<Override>,
    /// Named values of the graph.
    pub params: Vec<Field>,
}

/// The variants to plan, in the order of the file.
pub fn points(report: &mut Diagnostics, variants: &[Variant], wanted: Option<&[String]>) -> Vec<Point> {
    let mut points: Vec<Point> = variants.iter().flat_map(|v| expand(report, v)).collect();
    if let Some(wanted) = wanted {
        for name in wanted {
            if !points.iter().any(|p| p.name == *name || p.group == *name) {
                let mut known: Vec<&str> = points.iter().map(|p| p.group.as_str()).collect();
                known.dedup();
                known.extend(points.iter().filter(|p| p.name != p.group).map(|p| p.name.as_str()));
                let hint = suggest(name, "variants", &known);
                let span = report.sources.add("--variant".into(), name);
                report.error(span, "unknown-variant", format!("the graph has no variant `{name}`")).hint(hint);
            }
        }
        points.retain(|p| wanted.iter().any(|name| p.name == *name || p.group == *name));
    } else if variants.is_empty() {
        points.push(Point::default());
    }
    points
}

fn expand(report: &mut Diagnostics, variant: &Variant) -> Vec<Point> {
    let name = variant.name.text.clone();
    let of_nodes = variant.changes.iter().flat_map(|(n, fs)| fs.iter().map(move |f| (Some(n), f)));
    let all: Vec<(Option<&Name>, &Field)> = of_nodes.chain(variant.params.iter().map(|f| (None, f))).collect();
    let fields = || all.iter().copied();
    if variant.how == How::Set {
        let changes = fields().filter_map(|(node, f)| Some(change(node?, &f.name, &f.value))).collect();
        return vec![Point { group: name.clone(), name, changes, params: variant.params.clone() }];
    }
    let mut lists = Vec::new();
    for (node, field) in fields() {
        match field.value.list(report) {
            Some(values) if !values.is_empty() => lists.push((node, field, values)),
            _ => {
                report
                    .error(field.value.span, "bad-sweep", "a list of values is expected here")
                    .hint(format!("for example `{}: [1.0, 2.0]`", field.name.text));
                return Vec::new();
            }
        }
    }
    let Some(rows) = rows(report, variant, &lists) else { return Vec::new() };
    let label = |node: Option<&Name>, field: &Field| {
        let twice = fields().filter(|(_, f)| f.name.text == field.name.text).count() > 1;
        let prefix = node.filter(|_| twice).map(|node| format!("{}.", node.text)).unwrap_or_default();
        prefix + &field.name.text
    };
    let point = |row: Vec<usize>| {
        let picked = || row.iter().zip(&lists).map(|(i, (node, f, values))| (*node, *f, &values[*i]));
        let say = |(node, field, value): (Option<&Name>, &Field, &Value)| {
            let text = report.sources.text(value.span).split_whitespace().collect::<Vec<_>>();
            format!("{}={}", label(node, field), text.join(" "))
        };
        let labels: Vec<String> = picked().map(say).collect();
        Point {
            name: format!("{name}[{}]", labels.join(",")),
            group: name.clone(),
            changes: picked().filter_map(|(node, f, value)| Some(change(node?, &f.name, value))).collect(),
            params: picked()
                .filter(|(node, _, _)| node.is_none())
                .map(|(_, f, value)| Field { name: f.name.clone(), value: value.clone() })
                .collect(),
        }
    };
    rows.into_iter().map(point).collect()
}

type List<'a> = (Option<&'a Name>, &'a Field, Vec<Value>);

/// Which value of each list a variant takes: the first list turns slowest.
fn rows(report: &mut Diagnostics, variant: &Variant, lists: &[List]) -> Option<Vec<Vec<usize>>> {
    const MOST: usize = 10_000;
    if lists.is_empty() {
        report.error(variant.name.span, "bad-sweep", "nothing is swept here");
        return None;
    }
    if variant.how == How::Zip {
        let count = lists[0].2.len();
        if let Some((_, field, values)) = lists.iter().find(|(_, _, values)| values.len() != count) {
            let message = format!("{} values here, {count} in the first list", values.len());
            report
                .error(field.value.span, "bad-sweep", message)
                .hint("`zip` takes lists of equal length; `sweep` takes all combinations");
            return None;
        }
        return Some((0..count).map(|i| vec![i; lists.len()]).collect());
    }
    let count = lists.iter().try_fold(1_usize, |n, (_, _, values)| n.checked_mul(values.len()));
    if count.is_none_or(|count| count > MOST) {
        report.error(variant.name.span, "too-large", format!("more than {MOST} combinations"));
        return None;
    }
    let mut rows = vec![Vec::new()];
    for (_, _, values) in lists {
        let longer = |row: &Vec<usize>, i: usize| row.iter().copied().chain([i]).collect();
        rows = rows.iter().flat_map(|row| (0..values.len()).map(move |i| longer(row, i))).collect();
    }
    Some(rows)
}

/// Whether a pattern, in which `*` stands for any characters, matches all of a text.
pub fn matches(pattern: &str, text: &str) -> bool {
    let Some((head, rest)) = pattern.split_once('*') else { return pattern == text };
    let Some(mut text) = text.strip_prefix(head) else { return false };
    let (middle, tail) = rest.rsplit_once('*').unwrap_or(("", rest));
    let Some(end) = text.len().checked_sub(tail.len()) else { return false };
    if !text.ends_with(tail) {
        return false;
    }
    text = &text[..end];
    for part in middle.split('*') {
        let Some(at) = text.find(part) else { return false };
        text = &text[at + part.len()..];
    }
    true
}

/// What became of an override while the graph was walked.
#[derive(Clone, Debug, Default)]
pub struct Fate {
    pub matched: bool,
    /// It matched nodes on which the name is a wire.
    pub wire: bool,
    /// A node that it matched but that has no such param, with that node's params.
    pub lacks: Option<(String, Vec<String>)>,
}

/// Reports an override that changed nothing.
pub fn unmatched(report: &mut Diagnostics, change: &Override, fate: &Fate, addresses: &[&str]) {
    let (node, param) = (&change.node.text, &change.param.text);
    if fate.wire {
        report
            .error(
                change.param.span,
                "override-wire",
                format!("`{param}` of `{node}` is a wire, which cannot be overridden"),
            )
            .hint("only params can be set; change the wire in the graph file");
    } else if let Some((kind, params)) = &fate.lacks {
        let names: Vec<&str> = params.iter().map(String::as_str).collect();
        let hint = suggest(param, "params", &names);
        report
            .error(
                change.param.span,
                "unknown-param",
                format!("no node that matches `{node}` has a param `{param}`: `{kind}` does not"),
            )
            .hint(hint);
    } else {
        let hint = did_you_mean(node, addresses.iter().copied()).unwrap_or_else(|| suggest(node, "nodes", addresses));
        report.error(change.node.span, "override-unmatched", format!("no node matches `{node}`")).hint(hint);
    }
}

/// Whether an override speaks of a variant.
pub fn applies(change: &Override, point: &Point) -> bool {
    let named = |v: &String| matches(v, &point.name) || matches(v, &point.group);
    change.variant.as_ref().is_none_or(named)
}

/// Reports an override that speaks of no variant that is planned.
pub fn no_variant(report: &mut Diagnostics, change: &Override, groups: &[&str]) {
    let name = change.variant.as_deref().unwrap_or_default();
    let hint = suggest(name, "variants planned", groups);
    let message = format!("no variant that is planned matches `{name}`");
    report.error(change.node.span, "unknown-variant", message).hint(hint);
}
