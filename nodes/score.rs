//! `score`: what a match came to, made one number that ranks shapes.
//!
//! The objective grows about with the square of the number of matched features, so shapes with more described features would be
//! like everything. It is therefore divided by what the two shapes could reach.

use std::sync::Arc;

use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pair_scores::{PairScore, PairScores, Shape};
use crate::similarity::Similarity;

/// What of a match counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Of {
    /// The objective: the sum of all terms.
    Sum,
    /// The objective over the number of matched pairs: the mean support of a match.
    Mean,
    /// The number of matched pairs.
    Matched,
    /// The terms of the descriptors alone.
    Descriptors,
}

/// What it is divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Over {
    /// Nothing.
    Nothing,
    /// sqrt(Sim(A, A) Sim(B, B)): the same of each shape with itself.
    Themselves,
    /// Sim(A, A) of the query alone: for a part, of which the whole has more.
    Query,
    /// The greater one of the two.
    Larger,
}

/// Params of [`Score`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// What of a match counts: `Sum` (default), `Mean`, `Matched` or `Descriptors`.
    pub of: Of,
    /// What it is divided by, so that shapes with many features are not like everything: `Themselves` (default), `Query` (for parts),
    /// `Larger` or `Nothing`.
    pub over: Over,
}

impl Default for Params {
    fn default() -> Self {
        Self { of: Of::Sum, over: Over::Themselves }
    }
}

/// Scores of pairs.
pub struct In {
    scores: Arc<PairScores>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<PairScores>("scores", "what matching came to")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { scores: from.one("scores")? })
    }
}

/// The node.
pub struct Score;

impl Node for Score {
    const KIND: &'static str = "score";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How alike shapes are by their matches: sum or mean of the terms, or the number of matches, over what each shape reaches with \
        itself.";
    const EXAMPLE: &'static str = r#"
        "a":       synthesize(pose: 0),
        "b":       synthesize(pose: 1),
        "fa":      graph(file: "salient_features.ron", mesh: "a"),
        "fb":      graph(file: "salient_features.ron", mesh: "b"),
        "matches": match_all(queries: ["fa", "fb"], targets: ["fa", "fb"]),
        "alike":   score(scores: "matches"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Similarity;

    fn run(params: &Params, In { scores }: In, cx: Context) -> Result<Similarity, NodeError> {
        cx.check()?;
        let names = |shapes: &[Shape]| shapes.iter().map(|s| s.name.clone()).collect::<Vec<_>>();
        Ok(Similarity {
            measure: "salient features".into(),
            queries: names(&scores.queries),
            targets: names(&scores.targets),
            values: scores.entries().map(|(query, target, pair)| score(pair, query, target, params)).collect(),
            compared: scores.compared.clone(),
            missing: scores.missing.clone(),
        })
    }
}

fn score(pair: &PairScore, query: &Shape, target: &Shape, params: &Params) -> f64 {
    let matched = f64::from(pair.matched);
    let features = |s: &Shape| f64::from(s.features);
    // Of a shape with itself every feature is matched, and every descriptor term is 1 (times beta, which the objective has too).
    let (value, own): (f64, [f64; 2]) = match params.of {
        Of::Sum => (pair.objective, [query.own, target.own]),
        Of::Mean => (pair.objective / matched.max(1.0), [query, target].map(|s| s.own / features(s).max(1.0))),
        Of::Matched => (matched, [query, target].map(features)),
        Of::Descriptors => (pair.descriptors, [query, target].map(features)),
    };
    let reachable = match params.over {
        Over::Nothing => 1.0,
        Over::Themselves => (own[0] * own[1]).sqrt(),
        Over::Query => own[0],
        Over::Larger => own[0].max(own[1]),
    };
    if reachable > 0.0 { value / reachable } else { 0.0 }
}
