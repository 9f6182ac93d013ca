//! `explain_match`: why two shapes score as they do in a ranking: which features are matched, what each match earns, and the descriptors.

use std::sync::Arc;

use salient_sdk::{Artefact, Context, Decoder, Encoder, FormatError, Inputs, Node, NodeError, Port, PortValues, Table};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::feature::Feature;
use crate::iqp_match;
use crate::match_all::{MatchAll, Params};
use crate::patch_spectrum::Features;

/// Two shapes' features.
pub struct In {
    left: Arc<Features>,
    right: Arc<Features>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Features>("left", "features of the query"),
        Port::one::<Features>("right", "features of the target"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { left: from.one("left")?, right: from.one("right")? })
    }
}

/// One end of a match.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct End {
    /// Index of the feature.
    pub feature: usize,
    /// Its vertex.
    pub vertex: u32,
    /// Its scale over sqrt(area).
    pub scale: f64,
    /// Area of its patch over the shape's.
    pub patch: f64,
    /// Its descriptor.
    pub descriptor: Vec<f64>,
}

/// One match and what it earns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Term {
    /// On the query.
    pub left: End,
    /// On the target.
    pub right: End,
    /// Distance of the descriptors.
    pub descriptor_distance: f64,
    /// beta C: what the descriptors (and absolute scales) earn.
    pub alone: f64,
    /// What the match earns with the others: half of its pairs' terms, so that all sum to the objective.
    pub together: f64,
}

/// Why two shapes score as they do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Sum over the square root of the self-similarities, as `score` has it by default.
    pub score: f64,
    /// Objective: the sum of all terms.
    pub objective: f64,
    /// Self-similarities of query and target.
    pub own: [f64; 2],
    /// Matches, the one that earns most first.
    pub terms: Vec<Term>,
}

impl Artefact for Explanation {
    const TYPE: &'static str = "explanation";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Why two shapes score as they do: each match of two features with what it earns alone and together with the others, and both \
        patches' descriptors.";

    fn encode(&self, out: &mut Encoder) {
        out.header("explanation", self);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        from.header("explanation")
    }

    fn json(&self) -> Value {
        json!(self)
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let mut lines = vec![
            (
                "score",
                format!("{:.4} = {:.2} / sqrt({:.2} * {:.2})", self.score, self.objective, self.own[0], self.own[1]),
            ),
            ("matches", self.terms.len().to_string()),
        ];
        lines.extend(self.terms.iter().take(10).map(|t| {
            let text = format!(
                "vertex {} with {}: {:.2} = {:.2} alone + {:.2} together; descriptors {:.3} apart, scales {:.3} and {:.3}",
                t.left.vertex, t.right.vertex, t.alone + t.together, t.alone, t.together, t.descriptor_distance, t.left.scale, t.right.scale
            );
            ("match", text)
        }));
        lines
    }

    fn table(&self) -> Option<Table> {
        let values = self.terms.first().map_or(0, |t| t.left.descriptor.len());
        let mut columns: Vec<String> =
            ["left_vertex", "right_vertex", "alone", "together", "descriptor_distance", "left_scale", "right_scale"]
                .map(str::to_owned)
                .to_vec();
        for side in ["left", "right"] {
            columns.extend((1..=values).map(|k| format!("{side}_d{k}")));
        }
        let row = |t: &Term| {
            let numbers = [t.alone, t.together, t.descriptor_distance, t.left.scale, t.right.scale];
            let all = numbers.iter().chain(&t.left.descriptor).chain(&t.right.descriptor);
            let vertices = [t.left.vertex.to_string(), t.right.vertex.to_string()];
            vertices.into_iter().chain(all.map(f64::to_string)).collect()
        };
        Some(Table { columns, rows: self.terms.iter().map(row).collect() })
    }
}

/// The node.
pub struct ExplainMatch;

impl Node for ExplainMatch {
    const KIND: &'static str = "explain_match";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Why two shapes score as they do in a ranking by `match_all`, whose params it has: the matched features, what each match earns, and the \
        descriptors of both patches.";
    const EXAMPLE: &'static str = r#"
        "a":   synthesize(pose: 0),
        "b":   synthesize(pose: 1),
        "fa":  graph(file: "salient_features.ron", mesh: "a"),
        "fb":  graph(file: "salient_features.ron", mesh: "b"),
        "why": explain_match(left: "fa", right: "fb"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Explanation;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        MatchAll::check(params)
    }

    fn run(params: &Params, In { left, right }: In, cx: Context) -> Result<Explanation, NodeError> {
        let [left, right] = [left, right].map(|f| f.first(params.features as usize));
        if left.values != right.values {
            return Err(NodeError::new(format!("descriptors have {} and {} values", left.values, right.values)));
        }
        let matching = params.matching();
        let (score, found) = iqp_match::explained(&left, &right, &matching, params.passes as usize, cx)?;
        let own = [&left, &right].map(|f| iqp_match::own(f, &matching));
        let mut terms: Vec<Term> = found
            .into_iter()
            .map(|t| Term {
                left: end(&left, t.left),
                right: end(&right, t.right),
                descriptor_distance: t.distance,
                alone: t.alone,
                together: t.together,
            })
            .collect();
        let earned = |t: &Term| t.alone + t.together;
        terms.sort_by(|a, b| earned(b).total_cmp(&earned(a)).then(a.left.feature.cmp(&b.left.feature)));
        let reachable = (own[0] * own[1]).sqrt();
        let score = if reachable > 0.0 { score.objective / reachable } else { 0.0 };
        Ok(Explanation { score, objective: terms.iter().map(earned).sum(), own, terms })
    }
}

fn end(of: &Features, i: usize) -> End {
    let Feature { vertex, scale, .. } = of.features[i];
    End {
        feature: i,
        vertex,
        scale: scale / of.area.sqrt(),
        patch: of.patches[i].area / of.area,
        descriptor: of.descriptors[i].clone().unwrap_or_default(),
    }
}
