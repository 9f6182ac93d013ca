//! How similarities, ranked lists and their figures differ. Shapes are told by name.

use std::collections::BTreeMap;

use salient_sdk::Difference;
use salient_sdk::difference::{relative, short};
use serde_json::{Value, json};

use super::NAMED;
use crate::rank::Ranking;
use crate::retrieval_metrics::{Figures, Metrics};
use crate::similarity::Similarity;

/// How many ranks count as the top of a list.
const TOP: usize = 10;
/// How many movements programs are told of.
const LISTED: usize = 100;

type Index<'a> = BTreeMap<&'a str, usize>;

fn index(names: &[String]) -> Index<'_> {
    names.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect()
}

/// The first few of a list, in brackets.
fn some_of(named: &[String]) -> String {
    if named.is_empty() {
        return String::new();
    }
    let more = if named.len() > NAMED { "; ..." } else { "" };
    format!(" ({}{more})", named.iter().take(NAMED).cloned().collect::<Vec<_>>().join("; "))
}

/// Names kept, lost and gained.
fn names(figure: &str, one: &[String], other: &[String]) -> Option<Difference> {
    let (a, b) = (index(one), index(other));
    let without = |these: &[String], those: &Index| -> Vec<String> {
        these.iter().filter(|name| !those.contains_key(name.as_str())).cloned().collect()
    };
    let (lost, gained) = (without(one, &b), without(other, &a));
    let text = format!(
        "{} kept, {} lost{}, {} gained{}",
        one.len() - lost.len(),
        lost.len(),
        some_of(&lost),
        gained.len(),
        some_of(&gained)
    );
    let size = (lost.len() + gained.len()) as f64;
    let values = Some([one.len() as f64, other.len() as f64]);
    let difference = Difference { values, ..Difference::new(figure, size, text) };
    (size > 0.0).then(|| difference.details(json!({ "lost": lost, "gained": gained })))
}

fn measure(one: &str, other: &str) -> Option<Difference> {
    (one != other).then(|| Difference::new("measure", 1.0, format!("{one} -> {other}")))
}

/// The shapes, the pairs that were compared, and the largest change over the largest value and where it is.
#[must_use]
pub fn similarities(one: &Similarity, other: &Similarity) -> Vec<Difference> {
    let (rows, columns) = (index(&other.queries), index(&other.targets));
    let mut largest: Option<(f64, &str, &str, [f64; 2])> = None;
    let (mut sum, mut common, mut changed, mut scale) = (0.0, 0_usize, 0_usize, 0.0_f64);
    for (q, query) in one.queries.iter().enumerate() {
        let Some(row) = rows.get(query.as_str()) else { continue };
        for (t, a) in one.entries(q) {
            let target = one.targets[t].as_str();
            let Some(b) = columns.get(target).and_then(|column| other.value(*row, *column)) else { continue };
            let change = (a - b).abs();
            scale = scale.max(a.abs()).max(b.abs());
            (sum, common, changed) = (sum + change, common + 1, changed + usize::from(change > 0.0));
            // The first of equal ones.
            if change > largest.map_or(0.0, |(most, ..)| most) {
                largest = Some((change, query, target, [a, b]));
            }
        }
    }
    let values = largest.map(|(change, query, target, [a, b])| {
        let size = change / scale;
        let text = format!(
            "largest change {} of the largest value, at {query} and {target}: {} -> {}; {} on average, {changed} of {common} pairs",
            short(size), short(a), short(b), short(sum / common as f64 / scale)
        );
        let details = json!({ "query": query, "target": target, "changed": changed, "common": common });
        Difference { values: Some([a, b]), ..Difference::new("similarity", size, text) }.details(details)
    });
    let [queries, targets] =
        [names("queries", &one.queries, &other.queries), names("targets", &one.targets, &other.targets)];
    let pairs = Difference::of_count("compared pairs", one.values.len(), other.values.len());
    [values, measure(&one.measure, &other.measure), queries, targets, pairs].into_iter().flatten().collect()
}

/// How the lists of the queries of both sides differ.
#[derive(Default)]
struct Lists {
    common: usize,
    /// Query, its nearest target, and that on the other side.
    nearest: Vec<[String; 3]>,
    /// Ranks at the top, and how many of their targets are at the top on the other side.
    top: usize,
    kept: usize,
    /// Targets that are at the top on a side at least: query, target, and both ranks from 1.
    movements: Vec<(String, String, [usize; 2])>,
    /// Queries whose lists are in another order, or of other targets.
    reordered: usize,
}

impl Lists {
    fn new(one: &Ranking, other: &Ranking) -> Self {
        let (queries, mut lists) = (index(&other.queries), Self::default());
        for (q, query) in one.queries.iter().enumerate() {
            if let Some(r) = queries.get(query.as_str()) {
                let [a, b] = [one.list(q), other.list(*r)].map(|list| list.map(|(name, _)| name).collect::<Vec<_>>());
                lists.add(query, &a, &b);
            }
        }
        lists.movements.sort_by(|a, b| b.2[0].abs_diff(b.2[1]).cmp(&a.2[0].abs_diff(a.2[1])));
        lists
    }

    fn add(&mut self, query: &str, a: &[&str], b: &[&str]) {
        self.common += 1;
        let top = TOP.min(a.len()).min(b.len());
        self.top += top;
        if a == b {
            self.kept += top;
            return;
        }
        self.reordered += 1;
        if let (Some(before), Some(now)) = (a.first(), b.first())
            && before != now
        {
            self.nearest.push([query, before, now].map(str::to_owned));
        }
        let rank: BTreeMap<&str, usize> = b.iter().enumerate().map(|(i, name)| (*name, i)).collect();
        for (i, name) in a.iter().enumerate() {
            let Some(j) = rank.get(name) else { continue };
            self.kept += usize::from(i.max(*j) < top);
            if i.min(*j) < top && i != *j {
                self.movements.push((query.to_owned(), (*name).to_owned(), [i + 1, j + 1]));
            }
        }
    }

    fn nearest(&self) -> Option<Difference> {
        let named: Vec<String> = self.nearest.iter().map(|[query, a, b]| format!("{query}: {a} -> {b}")).collect();
        let text = format!("another for {} of {} queries{}", named.len(), self.common, some_of(&named));
        let change = |[query, a, b]: &[String; 3]| json!({ "query": query, "before": a, "now": b });
        let changed: Vec<Value> = self.nearest.iter().map(change).collect();
        let details = json!({ "queries": self.common, "changed": changed });
        (!named.is_empty()).then(|| Difference::new("nearest", named.len() as f64, text).details(details))
    }

    fn top(&self) -> Option<Difference> {
        let share = self.kept as f64 / self.top.max(1) as f64;
        let text = format!("{} % of the first {TOP} kept", short(100.0 * share));
        let details = json!({ "first": TOP, "kept": self.kept, "of": self.top });
        (self.kept < self.top).then(|| Difference::new("top", 1.0 - share, text).details(details))
    }

    fn ranks(&self) -> Option<Difference> {
        let size = self.movements.first().map_or(0, |(_, _, [a, b])| a.abs_diff(*b));
        let say = |(query, target, [a, b]): &(String, String, [usize; 2])| format!("{target} for {query}: {a} -> {b}");
        let named: Vec<String> = self.movements.iter().take(NAMED + 1).map(say).collect();
        let text = format!(
            "{} of {} lists in another order; most moved at the top{}",
            self.reordered,
            self.common,
            some_of(&named)
        );
        let movement = |(query, target, [a, b]): &(String, String, [usize; 2])| json!({ "query": query, "target": target, "before": a, "now": b });
        let all: Vec<Value> = self.movements.iter().take(LISTED).map(movement).collect();
        let details = json!({ "reordered": self.reordered, "lists": self.common, "movements": all });
        (!all.is_empty()).then(|| Difference::new("ranks", size as f64, text).details(details))
    }

    /// If neither the top nor anything that is told of it differs.
    fn below(&self) -> Option<Difference> {
        let text = format!("{} of {} lists in another order, below the first {TOP} only", self.reordered, self.common);
        let below = self.reordered > 0 && self.movements.is_empty() && self.kept == self.top;
        below.then(|| Difference::new("ranks", self.reordered as f64, text))
    }
}

/// The largest relative change of the score of a query and a target.
fn scores(one: &Ranking, other: &Ranking) -> Option<Difference> {
    let queries = index(&other.queries);
    let mut largest: Option<(f64, &str, &str, [f64; 2])> = None;
    for (q, query) in one.queries.iter().enumerate() {
        let Some(r) = queries.get(query.as_str()) else { continue };
        let scores: BTreeMap<&str, f64> = other.list(*r).collect();
        for (target, a) in one.list(q) {
            let Some(b) = scores.get(target) else { continue };
            let change = relative(a, *b);
            if change > largest.map_or(0.0, |(most, ..)| most) {
                largest = Some((change, query, target, [a, *b]));
            }
        }
    }
    largest.map(|(size, query, target, [a, b])| {
        let text =
            format!("largest relative change {} at {query} and {target}: {} -> {}", short(size), short(a), short(b));
        let details = json!({ "query": query, "target": target });
        Difference { values: Some([a, b]), ..Difference::new("scores", size, text) }.details(details)
    })
}

/// How many queries have another nearest target, the share of the first ten that is kept, the largest movements at the
/// top, and scores.
#[must_use]
pub fn rankings(one: &Ranking, other: &Ranking) -> Vec<Difference> {
    let lists = Lists::new(one, other);
    let [queries, targets] =
        [names("queries", &one.queries, &other.queries), names("targets", &one.targets, &other.targets)];
    let lengths = |of: &Ranking| of.order.iter().map(Vec::len).max().unwrap_or(0);
    let length = Difference::of_count("longest list", lengths(one), lengths(other));
    let all = [lists.nearest(), lists.top(), lists.ranks(), lists.below()];
    let rest = [scores(one, other), measure(&one.measure, &other.measure), queries, targets, length];
    all.into_iter().chain(rest).flatten().collect()
}

/// Reads one figure.
type Reading = fn(&Figures) -> f64;

/// The figures in the order in which they are reported.
const FIGURES: [(&str, Reading); 7] = [
    ("NN", |f| f.nn),
    ("first tier", |f| f.first_tier),
    ("second tier", |f| f.second_tier),
    ("E", |f| f.e),
    ("DCG", |f| f.dcg),
    ("mAP", |f| f.map),
    ("recall", |f| f.recall),
];

/// Every figure, the classes that changed most, and the queries whose nearest is of the right class on one side only.
#[must_use]
pub fn metrics(one: &Metrics, other: &Metrics) -> Vec<Difference> {
    let figure = |(name, of): (&str, Reading)| {
        let (a, b) = (of(&one.overall), of(&other.overall));
        let text = format!("{} -> {} ({:+.4})", short(a), short(b), b - a);
        (a != b).then(|| Difference { values: Some([a, b]), ..Difference::new(name, (a - b).abs(), text) })
    };
    let mut all: Vec<_> = FIGURES.into_iter().filter_map(figure).collect();
    let failed = names("failed shapes", &one.failed, &other.failed);
    let queries = Difference::of_count("queries", one.overall.queries, other.overall.queries);
    let more = [verdicts(one, other), classes(one, other), measure(&one.measure, &other.measure), queries, failed];
    all.extend(more.into_iter().flatten());
    all
}

/// Queries whose nearest target is of their class on one side only.
fn verdicts(one: &Metrics, other: &Metrics) -> Option<Difference> {
    let now: BTreeMap<&str, _> = other.per_query.iter().map(|q| (q.query.as_str(), q)).collect();
    let (mut right, mut wrong) = (Vec::new(), Vec::new());
    for before in &one.per_query {
        let Some(now) = now.get(before.query.as_str()) else { continue };
        match (before.nearest_class == before.class, now.nearest_class == now.class) {
            (false, true) => right.push(before.query.clone()),
            (true, false) => wrong.push(format!("{}, near {}", before.query, now.nearest)),
            _ => {}
        }
    }
    let text = format!("{} more right{}, {} more wrong{}", right.len(), some_of(&right), wrong.len(), some_of(&wrong));
    let size = (right.len() + wrong.len()) as f64;
    let details = json!({ "right": right, "wrong": wrong });
    (size > 0.0).then(|| Difference::new("nearest by class", size, text).details(details))
}

/// The classes whose mean average precision changed most.
fn classes(one: &Metrics, other: &Metrics) -> Option<Difference> {
    let change = |(class, a): (&String, &Figures)| Some((class.clone(), [a.map, other.per_class.get(class)?.map]));
    let mut changed: Vec<(String, [f64; 2])> = one.per_class.iter().filter_map(change).collect();
    changed.retain(|(_, [a, b])| a != b);
    // Stable: equal ones stay in the order of the alphabet.
    changed.sort_by(|(_, [a, b]), (_, [c, d])| (c - d).abs().total_cmp(&(a - b).abs()));
    let named: Vec<String> =
        changed.iter().map(|(class, [a, b])| format!("{class} {} -> {}", short(*a), short(*b))).collect();
    let text = format!("mAP of {} changed{}", count(changed.len()), some_of(&named));
    let size = changed.first().map_or(0.0, |(_, [a, b])| (a - b).abs());
    let class = |(class, values): &(String, [f64; 2])| json!({ "class": class, "map": values });
    let details = json!({ "classes": changed.iter().map(class).collect::<Vec<_>>() });
    (size > 0.0).then(|| Difference::new("classes", size, text).details(details))
}

fn count(classes: usize) -> String {
    if classes == 1 { "1 class".into() } else { format!("{classes} classes") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranking(lists: &[(&str, &[&str])]) -> Ranking {
        let mut targets: Vec<String> =
            lists.iter().flat_map(|(_, list)| list.iter().map(|t| (*t).to_owned())).collect();
        targets.sort();
        targets.dedup();
        let at = |name: &&str| targets.iter().position(|t| t == name).unwrap() as u32;
        Ranking {
            measure: "test".into(),
            queries: lists.iter().map(|(query, _)| (*query).to_owned()).collect(),
            order: lists.iter().map(|(_, list)| list.iter().map(at).collect()).collect(),
            scores: lists.iter().map(|(_, list)| (0..list.len()).map(|i| 1.0 / (1.0 + i as f64)).collect()).collect(),
            own: false,
            missing: Vec::new(),
            targets,
        }
    }

    fn figure<'a>(all: &'a [Difference], name: &str) -> &'a Difference {
        all.iter().find(|d| d.figure == name).unwrap_or_else(|| panic!("no {name} in {all:?}"))
    }

    #[test]
    fn ranks_nearest_and_top_are_told_by_name() {
        let one = ranking(&[("a", &["b", "c", "d"]), ("b", &["a", "c", "d"]), ("gone", &["a", "b", "c"])]);
        let other = ranking(&[("b", &["a", "c", "d"]), ("a", &["d", "b", "c"])]);
        let all = rankings(&one, &other);
        let nearest = figure(&all, "nearest");
        assert_eq!((nearest.size, nearest.text.as_str()), (1.0, "another for 1 of 2 queries (a: b -> d)"));
        let ranks = figure(&all, "ranks");
        let text =
            "1 of 2 lists in another order; most moved at the top (d for a: 3 -> 1; b for a: 1 -> 2; c for a: 2 -> 3)";
        assert_eq!((ranks.size, ranks.text.as_str()), (2.0, text));
        assert_eq!(ranks.details["movements"][0], json!({"query": "a", "target": "d", "before": 3, "now": 1}));
        assert_eq!(figure(&all, "queries").text, "2 kept, 1 lost (gone), 0 gained");
        // The first three are the same three.
        assert!(all.iter().all(|d| d.figure != "top"));
        // By hand: d was third, is first.
        let scores = figure(&all, "scores");
        assert!((scores.size - 2.0 / 3.0).abs() < 1e-15 && scores.values == Some([1.0 / 3.0, 1.0]), "{scores:?}");
        assert_eq!(rankings(&one, &one), []);
    }

    #[test]
    fn the_top_is_ten_and_what_moves_below_it_is_not_named() {
        let names: Vec<String> = (0..14).map(|i| format!("s{i:02}")).collect();
        let list = |order: &[usize]| -> Vec<&str> { order.iter().map(|i| names[*i].as_str()).collect() };
        let order: Vec<usize> = (0..14).collect();
        let swapped = |i: usize, j: usize| {
            let mut order = order.clone();
            order.swap(i, j);
            order
        };
        let of = |order: &[usize]| ranking(&[("q", &list(order))]);
        let (plain, in_out, below) = (of(&order), of(&swapped(9, 13)), of(&swapped(11, 13)));
        let all = rankings(&plain, &in_out);
        assert_eq!((figure(&all, "top").text.as_str(), figure(&all, "ranks").size), ("90 % of the first 10 kept", 4.0));
        let all = rankings(&plain, &below);
        assert_eq!(figure(&all, "ranks").text, "1 of 1 lists in another order, below the first 10 only");
        assert!(all.iter().all(|d| !["top", "nearest"].contains(&d.figure.as_str())));
    }

    #[test]
    fn similarities_are_compared_by_name_where_both_have_a_value() {
        let of = |names: [&str; 2], values: &[f64], compared: Option<crate::lists::Lists>| {
            let names: Vec<String> = names.map(str::to_owned).to_vec();
            let (queries, targets) = (names.clone(), names);
            Similarity {
                measure: "test".into(),
                queries,
                targets,
                values: values.to_vec(),
                compared,
                missing: Vec::new(),
            }
        };
        let one = of(["a", "b"], &[4.0, 1.0, 2.0, 4.0], None);
        // The same table but for (b, a), listed the other way round.
        let other = of(["b", "a"], &[4.0, 3.0, 1.0, 4.0], None);
        let all = similarities(&one, &other);
        assert_eq!(all.len(), 1, "{all:?}");
        let text = "largest change 0.25 of the largest value, at b and a: 2 -> 3; 0.0625 on average, 1 of 4 pairs";
        assert_eq!((all[0].size, all[0].text.as_str()), (0.25, text));
        // A pair that was not compared has no value to compare.
        let listed = crate::lists::Lists::new([vec![0], vec![0, 1]]);
        let other = of(["b", "a"], &[4.0, 1.0, 4.0], Some(listed));
        let all = similarities(&one, &other);
        assert_eq!((all.len(), figure(&all, "compared pairs").text.as_str()), (1, "4 -> 3"));
    }
}
