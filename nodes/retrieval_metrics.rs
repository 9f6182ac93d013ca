//! `retrieval_metrics`: how good ranked lists are, given the class of each shape.
//!
//! The figures are those of the Princeton benchmark, mean average precision and the eleven-point precision/recall curve; the equations are in
//! [`salient_kernels::retrieval`]. Overall figures are means over queries, those of a class over its queries. A query without another
//! shape of its class to be found has no figures, and is listed.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use salient_kernels::retrieval::{LEVELS, Merit};
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FileParam, FormatError, Inputs, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::rank::Ranking;
use crate::similarity::missing_line;

mod labels;
use labels::Labels;

/// Params of [`RetrievalMetrics`].
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// A CSV file of lines `id,class`, or a Princeton `.cla` file; an id is a file's name, with or without its extension. Default: none.
    pub labels: Option<FileParam>,
    /// Without a file, how a shape's name holds its class: `{class}` is the class, `*` any text, `#` digits, as in `{class}_*` or
    /// `{class}#`. Default: none.
    pub pattern: Option<String>,
    /// Without either, the class of each shape as (name, class): `folders("shape")` gives the folders of the files on an axis.
    pub folders: Vec<(String, String)>,
}

/// Ranked lists.
pub struct In {
    ranking: Arc<Ranking>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Ranking>("ranking", "ranked lists")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { ranking: from.one("ranking")? })
    }
}

/// Means over queries, each 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Number of queries.
    pub queries: usize,
    /// Nearest neighbour.
    pub nn: f64,
    /// First tier.
    pub first_tier: f64,
    /// Second tier.
    pub second_tier: f64,
    /// E-measure of the first 32.
    pub e: f64,
    /// Discounted cumulative gain over its greatest value.
    pub dcg: f64,
    /// Mean average precision.
    pub map: f64,
    /// Share of the class that is in the list at all: 1 but for lists cut short by `rank(top: ..)`, such as a shortlist.
    pub recall: f64,
    /// Interpolated precision, as [recall, precision], at recall 0, 0.1, ... 1.
    pub precision_recall: Vec<[f64; 2]>,
}

impl Figures {
    fn mean<'a>(of: impl IntoIterator<Item = &'a Merit>) -> Option<Self> {
        let all: Vec<&Merit> = of.into_iter().collect();
        let m = Merit::mean(all.iter().copied())?;
        let level = |i: usize| i as f64 / (LEVELS - 1) as f64;
        Some(Self {
            queries: all.len(),
            nn: m.nn,
            first_tier: m.first_tier,
            second_tier: m.second_tier,
            e: m.e,
            dcg: m.dcg,
            map: m.map,
            recall: m.recall,
            precision_recall: m.precision.iter().enumerate().map(|(i, p)| [level(i), *p]).collect(),
        })
    }
}

/// One query.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Query {
    /// Its name.
    pub query: String,
    /// Its class.
    pub class: String,
    /// Its nearest target.
    pub nearest: String,
    /// The class of that.
    pub nearest_class: String,
    /// Its average precision.
    pub average_precision: f64,
    /// Its first tier.
    pub first_tier: f64,
}

/// How good ranked lists are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// What the order was by.
    pub measure: String,
    /// Over all queries.
    pub overall: Figures,
    /// Over the queries of each class.
    pub per_class: BTreeMap<String, Figures>,
    /// Of each query, in the order of the lists.
    pub per_query: Vec<Query>,
    /// Classes, as the rows and columns of `confusion`.
    pub classes: Vec<String>,
    /// For each query's class, of which class its nearest target is: counts of queries.
    pub confusion: Vec<Vec<u32>>,
    /// Shapes that failed before they could be ranked.
    pub failed: Vec<String>,
    /// Ranked shapes without a class: neither queries nor targets here.
    pub unlabelled: Vec<String>,
    /// Queries with no other shape of their class to find.
    pub alone: Vec<String>,
}

impl Artefact for Metrics {
    const TYPE: &'static str = "retrieval_metrics";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Nearest neighbour, first and second tier, E (32), DCG, mean average precision and the eleven-point precision/recall curve, \
        overall, by class and by query; the confusion of classes; and what was left out, by name.";

    fn encode(&self, out: &mut Encoder) {
        out.header("metrics", self);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        from.header("metrics")
    }

    fn json(&self) -> Value {
        let mut json = json!(self.overall);
        json["measure"] = json!(self.measure);
        json["per_class"] = json!(self.per_class);
        json["per_query"] = json!(self.per_query);
        json["confusion"] = json!({ "classes": self.classes, "counts": self.confusion });
        json["failed"] = json!(self.failed);
        json["unlabelled"] = json!(self.unlabelled);
        json["alone"] = json!(self.alone);
        json
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let f = &self.overall;
        let number = |x: f64| format!("{x:.3}");
        let mut lines = vec![
            ("by", self.measure.clone()),
            ("queries", format!("{} of {} classes", f.queries, self.per_class.len())),
            ("NN", number(f.nn)),
            ("first tier", number(f.first_tier)),
            ("second tier", number(f.second_tier)),
            ("E", number(f.e)),
            ("DCG", number(f.dcg)),
            ("mAP", number(f.map)),
        ];
        if f.recall < 1.0 {
            lines.push(("recall", number(f.recall)));
        }
        lines.extend(missing_line(&self.failed));
        let others = [("unlabelled", &self.unlabelled), ("alone in its class", &self.alone)];
        let line = |(label, names): (&'static str, &Vec<String>)| missing_line(names).map(|(_, text)| (label, text));
        lines.extend(others.into_iter().filter_map(line));
        lines
    }

    fn table(&self) -> Option<Table> {
        let columns = ["class", "queries", "nn", "first_tier", "second_tier", "e", "dcg", "map"];
        let row = |(name, f): (&str, &Figures)| {
            let figures = [f.nn, f.first_tier, f.second_tier, f.e, f.dcg, f.map].map(|x| x.to_string());
            [vec![name.to_owned(), f.queries.to_string()], figures.to_vec()].concat()
        };
        let classes = self.per_class.iter().map(|(name, f)| (name.as_str(), f));
        Some(Table::new(&columns, std::iter::once(("", &self.overall)).chain(classes).map(row).collect()))
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::metrics(self, other)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::metrics(self)
    }
}

/// The node.
pub struct RetrievalMetrics;

impl Node for RetrievalMetrics {
    const KIND: &'static str = "retrieval_metrics";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How good ranked lists are: nearest neighbour, first and second tier, E (32), DCG, mean average precision and precision at \
        eleven levels of recall, overall and by class. Classes come from a file, from names or from folders.";
    const EXAMPLE: &'static str = r#"
        "a":          synthesize(pose: 0),
        "b":          synthesize(pose: 1),
        "c":          synthesize(species: Horse),
        "sa":         volume_signature(mesh: "a"),
        "sb":         volume_signature(mesh: "b"),
        "sc":         volume_signature(mesh: "c"),
        "similarity": signature_similarity(signatures: ["sa", "sb", "sc"]),
        "ranking":    rank(similarity: "similarity"),
        "metrics":    retrieval_metrics(ranking: "ranking", folders: [("0", "cat"), ("1", "cat"), ("2", "horse")]),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Metrics;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        let wrong = params.pattern.as_ref().and_then(|pattern| labels::parse(pattern).err());
        wrong.map(|message| ("pattern", message)).into_iter().collect()
    }

    fn run(params: &Params, In { ranking }: In, cx: Context) -> Result<Metrics, NodeError> {
        cx.check()?;
        let bytes = params.labels.as_ref().map(|_| cx.read("labels")).transpose()?;
        let text = bytes.as_deref().map(String::from_utf8_lossy);
        let extension = params.labels.as_ref().map(FileParam::extension).unwrap_or_default();
        let labels = Labels::new(text.as_deref().map(|text| (text, extension.as_str())), params)?;
        evaluate(&ranking, |name| labels.class(name))
    }
}

fn evaluate(ranking: &Ranking, class: impl Fn(&str) -> Option<String>) -> Result<Metrics, NodeError> {
    let of = |names: &[String]| names.iter().map(|name| class(name)).collect::<Vec<_>>();
    let (of_query, of_target) = (of(&ranking.queries), of(&ranking.targets));
    let mut unlabelled = Vec::new();
    for (names, classes) in [(&ranking.queries, &of_query), (&ranking.targets, &of_target)] {
        unlabelled.extend(names.iter().zip(classes).filter(|(_, c)| c.is_none()).map(|(name, _)| name.clone()));
    }
    unlabelled.sort();
    unlabelled.dedup();
    let mut sizes: BTreeMap<&str, usize> = BTreeMap::new();
    for c in of_target.iter().flatten() {
        *sizes.entry(c).or_default() += 1;
    }
    let targets: BTreeSet<&str> = ranking.targets.iter().map(String::as_str).collect();
    let classes: Vec<String> = sizes.keys().map(|c| (*c).to_owned()).collect();
    let mut confusion = vec![vec![0; classes.len()]; classes.len()];
    let (mut alone, mut per_query, mut merits) = (Vec::new(), Vec::new(), Vec::new());
    for (q, name) in ranking.queries.iter().enumerate() {
        let Some(own) = &of_query[q] else { continue };
        // A list of best ones may be short, so what there is to find is counted among all targets.
        let left_out = !ranking.own && targets.contains(name.as_str());
        let wanted = sizes.get(own.as_str()).map_or(0, |n| n - usize::from(left_out));
        let listed: Vec<(u32, &String)> =
            ranking.order[q].iter().filter_map(|t| Some((*t, of_target[*t as usize].as_ref()?))).collect();
        let relevant: Vec<bool> = listed.iter().map(|(_, c)| *c == own).collect();
        let (Some(merit), Some((first, nearest))) = (Merit::of(&relevant, wanted), listed.first()) else {
            alone.push(name.clone());
            continue;
        };
        if let (Ok(row), Ok(column)) = (classes.binary_search(own), classes.binary_search(nearest)) {
            confusion[row][column] += 1;
        }
        per_query.push(Query {
            query: name.clone(),
            class: own.clone(),
            nearest: ranking.targets[*first as usize].clone(),
            nearest_class: (*nearest).clone(),
            average_precision: merit.map,
            first_tier: merit.first_tier,
        });
        merits.push(merit);
    }
    let Some(overall) = Figures::mean(&merits) else {
        let message = format!(
            "no query has another shape of its class to find: {} queries, of which {} have no class; shapes are named as in `{}`",
            ranking.queries.len(),
            of_query.iter().filter(|c| c.is_none()).count(),
            ranking.queries.first().map_or("", String::as_str)
        );
        return Err(NodeError::new(message)
            .help("are the ids of the labels the names of the files, without folder and extension?"));
    };
    if classes.len() == 1 {
        return Err(NodeError::new(format!("all shapes are of one class, `{}`: any order is right", classes[0]))
            .help("give `labels: \"FILE.csv\"`, a `pattern` of names, or put each class into a folder of its own"));
    }
    let mut by_class: BTreeMap<&str, Vec<&Merit>> = BTreeMap::new();
    for (query, merit) in per_query.iter().zip(&merits) {
        by_class.entry(&query.class).or_default().push(merit);
    }
    let figures = |(name, of): (&str, Vec<&Merit>)| Some((name.to_owned(), Figures::mean(of)?));
    Ok(Metrics {
        measure: ranking.measure.clone(),
        overall,
        per_class: by_class.into_iter().filter_map(figures).collect(),
        per_query,
        classes,
        confusion,
        failed: ranking.missing.clone(),
        unlabelled,
        alone,
    })
}
