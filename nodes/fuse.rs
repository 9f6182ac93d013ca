//! `fuse`: several similarities made one.
//!
//! Each is turned into distances from its greatest value, over their mean, so that units do not matter; the fused value is the negative
//! weighted mean. Shapes that one of them lacks are left out, and listed.

use std::collections::BTreeMap;
use std::sync::Arc;

use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::similarity::{Similarity, united};

/// Params of [`Fuse`].
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Weight of each similarity, in the order of the wires; each at least 0. Default: 1 for all.
    pub weights: Vec<f64>,
}

/// Similarities of the same shapes.
pub struct In {
    similarities: Vec<Arc<Similarity>>,
}

impl Inputs for In {
    const PORTS: &'static [Port] =
        &[Port::many::<Similarity>("similarities", "how alike the same shapes are, by several measures")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { similarities: from.many("similarities")?.into_iter().map(|(_, s)| s).collect() })
    }
}

/// The node.
pub struct Fuse;

impl Node for Fuse {
    const KIND: &'static str = "fuse";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Several similarities made one: the weighted mean of their distances, each over its own mean. Shapes that one of them lacks are \
        left out and listed.";
    const EXAMPLE: &'static str = r#"
        "a":     synthesize(pose: 0),
        "b":     synthesize(pose: 1),
        "volume": signature_similarity(signatures: ["va", "vb"]),
        "view":   signature_similarity(signatures: ["wa", "wb"]),
        "va":    volume_signature(mesh: "a"),
        "vb":    volume_signature(mesh: "b"),
        "wa":    view_signature(mesh: "a"),
        "wb":    view_signature(mesh: "b"),
        "alike": fuse(similarities: ["volume", "view"], weights: [1, 0.5]),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Similarity;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        let bad = params.weights.iter().find(|w| **w < 0.0).map(|w| format!("a weight is {w}; it must be at least 0"));
        bad.map(|message| ("weights", message)).into_iter().collect()
    }

    fn run(params: &Params, In { similarities }: In, cx: Context) -> Result<Similarity, NodeError> {
        cx.check()?;
        let count = similarities.len();
        let weights = if params.weights.is_empty() { vec![1.0; count] } else { params.weights.clone() };
        let total: f64 = weights.iter().sum();
        if weights.len() != count || total <= 0.0 {
            let message = format!("{} weights, summing to {total}, for {count} similarities", weights.len());
            return Err(NodeError::new(message).help("give one weight for each, not all 0"));
        }
        let queries = common(&similarities, |s| &s.queries);
        let targets = common(&similarities, |s| &s.targets);
        if queries.is_empty() || targets.is_empty() {
            return Err(NodeError::new("no shape is in all of the similarities"));
        }
        let mut fused: Option<Similarity> = None;
        let mut missing = Vec::new();
        for (s, weight) in similarities.iter().zip(&weights) {
            let lost =
                |all: &[String], kept: &[String]| all.iter().filter(|n| !kept.contains(n)).cloned().collect::<Vec<_>>();
            missing = united(&missing, &s.missing);
            missing = united(&missing, &united(&lost(&s.queries, &queries), &lost(&s.targets, &targets)));
            let (unit, most) = (mean_distance(s), greatest(s));
            let one = s.of_shapes(&queries, &targets);
            let sum = fused.get_or_insert_with(|| Similarity { values: vec![0.0; one.values.len()], ..one.clone() });
            if sum.compared != one.compared {
                return Err(NodeError::new(format!("{} and {} are not of the same pairs", sum.measure, one.measure))
                    .help("wire the same `shortlist` to all of them, or to none"));
            }
            sum.values.iter_mut().zip(&one.values).for_each(|(v, x)| *v -= weight / total * (most - x) / unit);
        }
        let names: Vec<&str> =
            similarities.iter().zip(&weights).filter(|(_, w)| **w > 0.0).map(|(s, _)| s.measure.as_str()).collect();
        let fused = fused.ok_or_else(|| NodeError::new("nothing is wired to `similarities`"))?;
        Ok(Similarity { measure: names.join(" + "), missing, ..fused })
    }
}

/// The greatest value: of a shape with itself, where there is one.
pub(crate) fn greatest(s: &Similarity) -> f64 {
    s.values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// The mean distance from the greatest value, over pairs of different names that were compared; 1 if that is zero.
fn mean_distance(s: &Similarity) -> f64 {
    let most = greatest(s);
    let (mut sum, mut count) = (0.0, 0.0);
    for (q, query) in s.queries.iter().enumerate() {
        for (_, value) in s.entries(q).filter(|(t, _)| s.targets[*t] != *query) {
            sum += most - value;
            count += 1.0;
        }
    }
    if sum > 0.0 { sum / count } else { 1.0 }
}

/// Names in all of the lists, in the order of the first.
fn common(all: &[Arc<Similarity>], names: fn(&Similarity) -> &Vec<String>) -> Vec<String> {
    let mut count: BTreeMap<&str, usize> = BTreeMap::new();
    for name in all.iter().flat_map(|s| names(s)) {
        *count.entry(name).or_default() += 1;
    }
    let first = all.first().map(|s| names(s).as_slice()).unwrap_or_default();
    first.iter().filter(|name| count.get(name.as_str()) == Some(&all.len())).cloned().collect()
}
