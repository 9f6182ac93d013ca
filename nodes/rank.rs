//! `rank`: for each query the targets, the most alike first.

use salient_kernels::retrieval::ranked;
use salient_sdk::{Artefact, Context, Decoder, Encoder, FormatError, Node, NodeError, Table};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::similarity::{Single, missing_line};

/// Params of [`Rank`].
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many targets of each query are kept, the best ones. At least 1; default all.
    #[schemars(range(min = 1))]
    pub top: Option<u32>,
    /// Whether a target of the query's own name is ranked too: the query itself, or the whole of which it is a part. Default false.
    pub own: bool,
}

/// Ranked lists.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranking {
    /// What the order is by.
    pub measure: String,
    /// Names of the queries.
    pub queries: Vec<String>,
    /// Names of all targets.
    pub targets: Vec<String>,
    /// For each query the indices of its targets, best first.
    pub order: Vec<Vec<u32>>,
    /// Their scores, the greater the more alike.
    pub scores: Vec<Vec<f64>>,
    /// Whether a target of the query's own name is in its list.
    pub own: bool,
    /// Shapes that failed and are in no list.
    pub missing: Vec<String>,
}

impl Ranking {
    /// The names of a query's targets with their scores, best first.
    pub fn list(&self, query: usize) -> impl Iterator<Item = (&str, f64)> {
        let name = |t: &u32| self.targets[*t as usize].as_str();
        self.order[query].iter().map(name).zip(self.scores[query].iter().copied())
    }
}

impl Artefact for Ranking {
    const TYPE: &'static str = "ranking";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Ranked lists, one after the other: `order` (indices of targets, best first) and `scores`, `lengths` [queries] of each; \
        the header has the names and the shapes that failed.";

    fn encode(&self, out: &mut Encoder) {
        let lengths: Vec<u32> = self.order.iter().map(|o| o.len() as u32).collect();
        let order = self.order.concat();
        out.u32("lengths", &lengths, &[lengths.len()]);
        out.u32("order", &order, &[order.len()]);
        out.f64("scores", &self.scores.concat(), &[order.len()]);
        out.header("measure", &self.measure);
        out.header("queries", &self.queries);
        out.header("targets", &self.targets);
        out.header("own", &self.own);
        out.header("missing", &self.missing);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let (lengths, _) = from.u32("lengths")?;
        let (all, _) = from.u32("order")?;
        let (all_scores, _) = from.f64("scores")?;
        let (queries, targets): (Vec<String>, Vec<String>) = (from.header("queries")?, from.header("targets")?);
        let total: u64 = lengths.iter().map(|l| u64::from(*l)).sum();
        let valid = all.iter().all(|t| (*t as usize) < targets.len());
        if lengths.len() != queries.len() || total != all.len() as u64 || all_scores.len() != all.len() || !valid {
            return Err(FormatError("the ranked lists do not fit their names".into()));
        }
        let (mut order, mut scores, mut start) = (Vec::new(), Vec::new(), 0);
        for length in lengths {
            let end = start + length as usize;
            order.push(all[start..end].to_vec());
            scores.push(all_scores[start..end].to_vec());
            start = end;
        }
        let (measure, own, missing) = (from.header("measure")?, from.header("own")?, from.header("missing")?);
        Ok(Self { measure, queries, targets, order, scores, own, missing })
    }

    fn json(&self) -> Value {
        let entry = |(target, score): (&str, f64)| json!({ "target": target, "score": score });
        let list =
            |q: usize| json!({ "query": self.queries[q], "ranked": self.list(q).map(entry).collect::<Vec<_>>() });
        json!({
            "measure": self.measure,
            "lists": (0..self.queries.len()).map(list).collect::<Vec<_>>(),
            "failed": self.missing,
        })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let mut lines = vec![
            ("by", self.measure.clone()),
            ("queries", self.queries.len().to_string()),
            ("targets", self.targets.len().to_string()),
        ];
        let best = |q: usize| self.list(q).take(3).map(|(t, _)| t).collect::<Vec<_>>().join(", ");
        lines.extend((0..self.queries.len().min(3)).map(|q| ("best", format!("{}: {}", self.queries[q], best(q)))));
        lines.extend(missing_line(&self.missing));
        lines
    }

    fn table(&self) -> Option<Table> {
        let row = |q: usize, (rank, (target, score)): (usize, (&str, f64))| {
            vec![self.queries[q].clone(), (rank + 1).to_string(), target.to_owned(), score.to_string()]
        };
        let rows = (0..self.queries.len()).flat_map(|q| self.list(q).enumerate().map(move |entry| row(q, entry)));
        Some(Table::new(&["query", "rank", "target", "score"], rows.collect()))
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::rankings(self, other)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::ranking(self)
    }
}

/// The node.
pub struct Rank;

impl Node for Rank {
    const KIND: &'static str = "rank";
    const VERSION: u32 = 1;
    const DOC: &'static str =
        "For each query all targets, the most alike first; equal ones by name. The query itself is left out.";
    const EXAMPLE: &'static str = r#"
        "a":          synthesize(pose: 0),
        "b":          synthesize(species: Horse),
        "sa":         volume_signature(mesh: "a"),
        "sb":         volume_signature(mesh: "b"),
        "similarity": signature_similarity(signatures: ["sa", "sb"]),
        "ranking":    rank(similarity: "similarity"),
    "#;
    type Params = Params;
    type Inputs = Single;
    type Output = Ranking;

    fn run(params: &Params, Single { similarity }: Single, cx: Context) -> Result<Ranking, NodeError> {
        let top = params.top.map_or(usize::MAX, |top| top as usize);
        let rows: Vec<usize> = (0..similarity.queries.len()).collect();
        let lists = cx.map(&rows, |_, &q| {
            let (targets, row): (Vec<usize>, Vec<f64>) = similarity
                .entries(q)
                .filter(|(t, _)| params.own || similarity.targets[*t] != similarity.queries[q])
                .unzip();
            let best = ranked(&row, |i| &similarity.targets[targets[i]], top);
            Ok(best.into_iter().map(|i| (targets[i as usize] as u32, row[i as usize])).unzip())
        })?;
        let (order, scores) = lists.into_iter().unzip();
        let s = &*similarity;
        Ok(Ranking {
            measure: s.measure.clone(),
            queries: s.queries.clone(),
            targets: s.targets.clone(),
            order,
            scores,
            own: params.own,
            missing: s.missing.clone(),
        })
    }
}
