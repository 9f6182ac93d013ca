//! What matching each query with each target came to, before it is made one number. Not a node: made by `match_all` and
//! `gather_matches`, taken by `score`.

use salient_sdk::{Artefact, Decoder, Encoder, FormatError, Table};
use serde_json::{Value, json};

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
    /// Row-major; `None` for pairs that were not compared.
    pub pairs: Vec<Option<PairScore>>,
    /// Shapes that failed on the way here.
    pub missing: Vec<String>,
}

impl Artefact for PairScores {
    const TYPE: &'static str = "pair_scores";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Matching each query with each target: `objective`, its part `descriptors`, and `matched` (number of pairs of features), each \
        [queries, targets]; `compared` [queries, targets] is 0 for pairs left out; `query_features`, `query_own`, `target_features`, `target_own`: numbers \
        of features and self-similarities.";

    fn encode(&self, out: &mut Encoder) {
        let shape = [self.queries.len(), self.targets.len()];
        let of =
            |get: fn(&PairScore) -> f64| self.pairs.iter().map(|p| p.as_ref().map_or(0.0, get)).collect::<Vec<_>>();
        out.f64("objective", &of(|p| p.objective), &shape);
        out.f64("descriptors", &of(|p| p.descriptors), &shape);
        let matched: Vec<u32> = self.pairs.iter().map(|p| p.map_or(0, |p| p.matched)).collect();
        out.u32("matched", &matched, &shape);
        let compared: Vec<u32> = self.pairs.iter().map(|p| u32::from(p.is_some())).collect();
        out.u32("compared", &compared, &shape);
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
        let (compared, _) = from.u32("compared")?;
        let n = objective.len();
        if shape != [queries.len(), targets.len()] || [descriptors.len(), matched.len(), compared.len()] != [n; 3] {
            return Err(FormatError("the scores do not fit their names".into()));
        }
        let pair = |i: usize| {
            let score = PairScore { objective: objective[i], descriptors: descriptors[i], matched: matched[i] };
            (compared[i] == 1).then_some(score)
        };
        Ok(Self { queries, targets, pairs: (0..n).map(pair).collect(), missing: from.header("missing")? })
    }

    fn json(&self) -> Value {
        let shapes = |all: &[Shape]| -> Value {
            all.iter().map(|s| json!({ "name": s.name, "features": s.features, "own": s.own })).collect()
        };
        let pair = |p: &Option<PairScore>| {
            p.map(|p| json!({ "objective": p.objective, "descriptors": p.descriptors, "matched": p.matched }))
        };
        let rows = self.pairs.chunks(self.targets.len().max(1));
        json!({
            "queries": shapes(&self.queries),
            "targets": shapes(&self.targets),
            "pairs": rows.map(|row| row.iter().map(pair).collect::<Vec<_>>()).collect::<Vec<_>>(),
            "failed": self.missing,
        })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let compared: Vec<&PairScore> = self.pairs.iter().flatten().collect();
        let mean = compared.iter().map(|p| f64::from(p.matched)).sum::<f64>() / compared.len().max(1) as f64;
        let mut lines = vec![
            ("queries", self.queries.len().to_string()),
            ("targets", self.targets.len().to_string()),
            ("compared", format!("{} of {} pairs", compared.len(), self.pairs.len())),
            ("matched", format!("{mean:.1} features a pair")),
        ];
        lines.extend(missing_line(&self.missing));
        lines
    }

    fn table(&self) -> Option<Table> {
        let columns = ["query", "target", "objective", "descriptors", "matched"];
        let row = |(i, p): (usize, &Option<PairScore>)| {
            let p = (*p)?;
            let (q, t) = (&self.queries[i / self.targets.len()].name, &self.targets[i % self.targets.len()].name);
            let numbers = [p.objective.to_string(), p.descriptors.to_string(), p.matched.to_string()];
            Some([vec![q.clone(), t.clone()], numbers.to_vec()].concat())
        };
        Some(Table::new(&columns, self.pairs.iter().enumerate().filter_map(row).collect()))
    }
}
