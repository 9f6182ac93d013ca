//! A comparison for people.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::compare::Found;
use super::text::{bytes, count, seconds, table, working};
use crate::compare::pair::Divergence;
use crate::compare::{Comparison, NodeDifference};

/// How many of the nodes that part alike are named.
const NAMED: usize = 3;
/// How many nodes at which two sides part are listed, each for those that part alike.
const ROOTS: usize = 8;
/// How many characters a cell has in a line.
const CELL: usize = 26;
/// How many addresses that one side alone has are listed.
const ALONE: usize = 8;

/// The table, the doubts, and the pairs.
pub fn text(found: &Found) -> String {
    let mut text = columns(found);
    text.push_str(&doubts(found));
    for pair in &found.pairs {
        text.push('\n');
        text.push_str(&pair_text(pair));
    }
    text
}

/// Figures and costs, a column for each side.
fn columns(found: &Found) -> String {
    let indented = |text: &str| format!("  {text}");
    let mut rows = vec![[vec![String::new()], found.sides.iter().map(|side| side.name.clone()).collect()].concat()];
    let mut node = "";
    for it in &found.figures {
        if it.node != node {
            node = &it.node;
            rows.push(vec![format!("{} ({})", it.node, it.kind)]);
        }
        rows.push([vec![indented(&it.figure)], it.values.iter().map(crate::compare::Cell::text).collect()].concat());
    }
    let mut part = |title: &str, of: &dyn Fn(&crate::compare::table::Cost) -> String| {
        rows.push(vec![title.to_owned()]);
        for it in &found.stages {
            let costs = it.costs.iter().map(|cost| cost.as_ref().map_or_else(|| "-".to_owned(), of));
            rows.push([vec![indented(&it.kind)], costs.collect()].concat());
        }
    };
    part("seconds", &|cost| seconds(cost.seconds));
    part("memory: inputs and output of the largest call", &|cost| bytes(cost.held_bytes));
    part("memory: at work, besides the inputs", &|cost| working(cost.working_bytes));
    titled(&rows)
}

/// A table in which a row of one cell is a title that makes no column wide.
fn titled(rows: &[Vec<String>]) -> String {
    let full: Vec<Vec<String>> = rows.iter().filter(|row| row.len() > 1).flat_map(|row| wrapped(row)).collect();
    let laid = table(&full, 0, &[]);
    let mut lines = laid.lines();
    let mut text = String::new();
    for row in rows {
        if let [title] = row.as_slice() {
            let _ = writeln!(text, "{title}");
            continue;
        }
        for line in lines.by_ref().take(row_height(row)) {
            let _ = writeln!(text, "{}", line.trim_end());
        }
    }
    text
}

/// A row as several, so that no cell but the first is wider than [`CELL`] unless it is one word.
fn wrapped(row: &[String]) -> Vec<Vec<String>> {
    let cells: Vec<Vec<String>> =
        row.iter().enumerate().map(|(i, cell)| if i == 0 { vec![cell.clone()] } else { folded(cell) }).collect();
    let line = |i: usize| cells.iter().map(|cell| cell.get(i).cloned().unwrap_or_default()).collect();
    (0..row_height(row)).map(line).collect()
}

fn row_height(row: &[String]) -> usize {
    row.iter().skip(1).map(|cell| folded(cell).len()).max().unwrap_or(1).max(1)
}

fn folded(cell: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in cell.split(' ') {
        let last = lines.last().map_or(0, |line| line.chars().count());
        match lines.last_mut() {
            Some(line) if last == 0 => line.push_str(word),
            Some(line) if last + 1 + word.chars().count() <= CELL => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// What is doubtful about the results of each side.
fn doubts(found: &Found) -> String {
    let mut by_text: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for side in found.sides {
        let mut own = std::collections::BTreeSet::new();
        for (_, call) in &side.shown {
            own.extend(side.defects(*call).into_iter().map(|(node, defect)| format!("! {node}: {defect}")));
        }
        for line in own {
            by_text.entry(line).or_default().push(&side.name);
        }
    }
    let all = found.sides.len();
    let mut text = String::new();
    for (line, names) in by_text {
        let of = if names.len() == all { String::new() } else { format!(" ({})", names.join(", ")) };
        let _ = writeln!(text, "{line}{of}");
    }
    text
}

fn pair_text(pair: &Comparison) -> String {
    let mut text = format!("{} -> {}\n", pair.left, pair.right);
    text.push_str(&roots(pair));
    for (names, side) in [(&pair.only_left, &pair.left), (&pair.only_right, &pair.right)] {
        if !names.is_empty() {
            let more = if names.len() > ALONE { format!(" and {} more", names.len() - ALONE) } else { String::new() };
            let some = names.iter().take(ALONE).cloned().collect::<Vec<_>>().join(", ");
            let _ = writeln!(text, "  only in {side}: {some}{more}");
        }
    }
    let absent = if pair.absent > 0 { format!(", {} failed on both sides", pair.absent) } else { String::new() };
    if pair.nodes.is_empty() {
        let _ = writeln!(text, "  no difference: {} the same{absent}", count(pair.equal, "output"));
        return text;
    }
    let _ = writeln!(text, "  {} differ, {} are the same{absent}", count(pair.nodes.len(), "output"), pair.equal);
    let mut silent: BTreeMap<&str, usize> = BTreeMap::new();
    for node in &pair.nodes {
        if node.differences.is_none() && node.note.is_none() {
            *silent.entry(&node.kind).or_default() += 1;
        } else {
            node_text(node, &mut text);
        }
    }
    for (kind, more) in silent {
        let _ = writeln!(text, "  and {more} more of {kind}; `--json` lists all");
    }
    text
}

/// The nodes at which two sides part; those of one kind at which it is for the same causes, on an axis for example, together.
fn roots(pair: &Comparison) -> String {
    let mut alike: Vec<(&Divergence, Vec<&str>)> = Vec::new();
    let mut known: BTreeMap<(&str, bool, String), usize> = BTreeMap::new();
    for it in &pair.diverging {
        let causes: Vec<String> = it.causes.iter().map(ToString::to_string).collect();
        let at = *known.entry((&it.kind, it.effect, causes.join("\n"))).or_insert(alike.len());
        match alike.get_mut(at) {
            Some((_, names)) => names.push(&it.node),
            None => alike.push((it, vec![&it.node])),
        }
    }
    let mut text = String::new();
    for (i, (it, names)) in alike.iter().take(ROOTS).enumerate() {
        let word = if i == 0 { "first diverge at" } else { "and at" };
        let effect = if it.effect { "" } else { ", without effect" };
        let more = if names.len() > NAMED { format!(" and {} more", names.len() - NAMED) } else { String::new() };
        let named = names.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "  {word} {named}{more} ({}){effect}", it.kind);
        for cause in &it.causes {
            let _ = writeln!(text, "    {cause}");
        }
        if it.causes.is_empty() {
            let _ = writeln!(text, "    equal params and inputs gave other outputs");
        }
    }
    let rest: usize = alike.iter().skip(ROOTS).map(|(_, names)| names.len()).sum();
    if rest > 0 {
        let _ = writeln!(text, "  and at {}", count(rest, "more node"));
    }
    text
}

fn node_text(node: &NodeDifference, text: &mut String) {
    let _ = writeln!(text, "  {} ({})", node.node, node.kind);
    let rows: Vec<_> = node.differences.iter().flatten().map(|it| vec![it.figure.clone(), it.text.clone()]).collect();
    text.push_str(&table(&rows, 4, &[]));
    if let Some(note) = &node.note {
        let _ = writeln!(text, "    {note}");
    }
}
