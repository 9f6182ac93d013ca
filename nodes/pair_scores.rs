//! What matching each query with each target came to, before it is made one number. Not a node: made by `match_all`, taken by `score`.

use salient_sdk::{Artefact, Decoder, Encoder, FormatError, Table};
use serde_json::{Value, json};

use crate::lists::{self, Lists, Order};
use crate::similarity::missing_line;

/// One shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Its name.
    pub name: String,
    /// Number of its features with descriptors.
    pub features: u32,
    /// Objective of the shape matched with itself, each feature with itself.
    pub own: f64,
}

/// One pair.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PairScore {
    /// Value of the objective x'Hx + beta C x.
    pub objective: f64,
    /// The part of it that descriptors give: beta C x.
    pub descriptors: f64,
    /// Number of matched pairs of features.
    pub matched: u32,
}

/// The scores of all pairs.
#[derive(Clone, Debug, PartialEq)]
pub struct PairScores {
    /// One row each.
    pub queries: Vec<Shape>,
    /// One column each.
    pub targets: Vec<Shape>,
    /// Row by row.
    pub pairs: Vec<PairScore>,
    /// The pairs that were compared, which `pairs` is of; `None` for all.
    pub compared: Option<Lists>,
    /// Shapes that failed on the way here.
    pub missing: Vec<String>,
}

impl PairScores {
    /// How `pairs` are ordered.
    #[must_use]
    pub fn order(&self) -> Order<'_> {
        Order { targets: self.targets.len(), lists: self.compared.as_ref() }
    }

    /// Query, target and what became of them, in order.
    pub fn entries(&self) -> impl Iterator<Item = (&Shape, &Shape, &PairScore)> {
        let row = move |(q, query)| self.order().row(q).map(move |t| (query, &self.targets[t]));
        self.queries
            .iter()
            .enumerate()
            .flat_map(row)
            .zip(&self.pairs)
            .map(|((query, target), pair)| (query, target, pair))
    }
}

impl Artefact for PairScores {
    const TYPE: &'static str = "pair_scores";
    const FORMAT: u32 = 2;
    const DOC: &'static str = "Matching each query with each target: `objective`, its part `descriptors`, and `matched` (number of pairs of features), each \
        [queries, targets]; of a shortlist each [pairs] of those on it: `listed` [pairs] (indices of targets), `lengths` [queries] of each query's list; \
        `query_features`, `query_own`, `target_features`, `target_own`: numbers of features and self-similarities.";

    fn encode(&self, out: &mut Encoder) {
        let shape = self.order().shape(self.queries.len());
        let of = |get: fn(&PairScore) -> f64| self.pairs.iter().map(get).collect::<Vec<_>>();
        out.f64("objective", &of(|p| p.objective), &shape);
        out.f64("descriptors", &of(|p| p.descriptors), &shape);
        let matched: Vec<u32> = self.pairs.iter().map(|p| p.matched).collect();
        out.u32("matched", &matched, &shape);
        lists::encode(self.compared.as_ref(), out);
        for (side, shapes) in [("query", &self.queries), ("target", &self.targets)] {
            let features: Vec<u32> = shapes.iter().map(|s| s.features).collect();
            let own: Vec<f64> = shapes.iter().map(|s| s.own).collect();
            out.u32(&format!("{side}_features"), &features, &[shapes.len()]);
            out.f64(&format!("{side}_own"), &own, &[shapes.len()]);
            out.header(side, &shapes.iter().map(|s| &s.name).collect::<Vec<_>>());
        }
        out.header("missing", &self.missing);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let side = |side: &str| -> Result<Vec<Shape>, FormatError> {
            let names: Vec<String> = from.header(side)?;
            let (features, _) = from.u32(&format!("{side}_features"))?;
            let (own, _) = from.f64(&format!("{side}_own"))?;
            if features.len() != names.len() || own.len() != names.len() {
                return Err(FormatError("the columns of the shapes differ in length".into()));
            }
            let shapes = names.into_iter().zip(features).zip(own);
            Ok(shapes.map(|((name, features), own)| Shape { name, features, own }).collect())
        };
        let (queries, targets) = (side("query")?, side("target")?);
        let (objective, shape) = from.f64("objective")?;
        let (descriptors, _) = from.f64("descriptors")?;
        let (matched, _) = from.u32("matched")?;
        let compared = lists::decode(from, queries.len(), targets.len())?;
        let expected = Order { targets: targets.len(), lists: compared.as_ref() }.shape(queries.len());
        let n = objective.len();
        if shape != expected || [descriptors.len(), matched.len()] != [n; 2] {
            return Err(FormatError("the scores do not fit their names".into()));
        }
        let pair = |i: usize| PairScore { objective: objective[i], descriptors: descriptors[i], matched: matched[i] };
        Ok(Self { queries, targets, pairs: (0..n).map(pair).collect(), compared, missing: from.header("missing")? })
    }

    fn json(&self) -> Value {
        let shapes = |all: &[Shape]| -> Value {
            all.iter().map(|s| json!({ "name": s.name, "features": s.features, "own": s.own })).collect()
        };
        let pair =
            |p: &PairScore| json!({ "objective": p.objective, "descriptors": p.descriptors, "matched": p.matched });
        let row = |q: usize| self.pairs[self.order().span(q)].iter().map(pair).collect::<Value>();
        let mut json = json!({
            "queries": shapes(&self.queries),
            "targets": shapes(&self.targets),
            "pairs": (0..self.queries.len()).map(row).collect::<Value>(),
            "failed": self.missing,
        });
        if let Some(lists) = &self.compared {
            json["listed"] = (0..self.queries.len()).map(|q| lists.of(q)).collect();
        }
        json
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let mean = self.pairs.iter().map(|p| f64::from(p.matched)).sum::<f64>() / self.pairs.len().max(1) as f64;
        let mut lines = vec![
            ("queries", self.queries.len().to_string()),
            ("targets", self.targets.len().to_string()),
            self.order().line(self.queries.len()),
            ("matched", format!("{mean:.1} features a pair")),
        ];
        lines.extend(missing_line(&self.missing));
        lines
    }

    fn table(&self) -> Option<Table> {
        let columns = ["query", "target", "objective", "descriptors", "matched"];
        let row = |(query, target, p): (&Shape, &Shape, &PairScore)| {
            let numbers = [p.objective.to_string(), p.descriptors.to_string(), p.matched.to_string()];
            [vec![query.name.clone(), target.name.clone()], numbers.to_vec()].concat()
        };
        Some(Table::new(&columns, self.entries().map(row).collect()))
    }
}
