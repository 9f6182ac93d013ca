//! `fuse`: several similarities made one.
//!
//! Each is turned into distances from its greatest value. By `Mean`, these are divided by their mean, so that units do not matter, and the fused value is
//! the negative weighted mean. By `Neighbours`, each becomes a weight exp(-d(q, t)² / s_q s_t), s the mean distance to the nearest ones (self-tuning:
//! Zelnik-Manor & Perona 2004), and the fused value is their weighted mean: a measure counts where it finds something near, and is silent
//! elsewhere, so each query has those decide that know something about it. Shapes that one of them lacks are left out, and listed.

use std::collections::BTreeMap;
use std::sync::Arc;

use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::lists::{Lists, Order};
use crate::similarity::{Similarity, united};
use crate::weights;

/// What the distances of a measure are compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Scale {
    /// Their mean over all pairs.
    Mean,
    /// Those of the nearest ones of query and target.
    Neighbours,
}

/// Params of [`Fuse`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Weight of each similarity, in the order of the wires; each at least 0. Default: 1 for all.
    pub weights: Vec<f64>,
    /// What distances are compared with: `Mean` (default) of all pairs; or those of the nearest `Neighbours`, and what is far counts no more.
    pub scale: Scale,
    /// How many nearest ones, for `Neighbours`. At least 1, default 10.
    #[schemars(range(min = 1))]
    pub neighbours: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { weights: Vec::new(), scale: Scale::Mean, neighbours: 10 }
    }
}

/// Similarities of the same shapes.
pub struct In {
    pub(crate) similarities: Vec<Arc<Similarity>>,
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
    const DOC: &'static str = "Several similarities made one: the weighted mean of their distances, each over its own mean, or of weights by their nearest ones. Shapes that one of them lacks are \
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
        weights::check(&params.weights)
    }

    fn run(params: &Params, In { similarities }: In, cx: Context) -> Result<Similarity, NodeError> {
        cx.check()?;
        let shares = weights::shares(&params.weights, similarities.len(), "similarities")?;
        let shared = Shared::of(&similarities)?;
        let mut values = vec![0.0; shared.order().pairs(shared.queries.len())];
        for (s, share) in similarities.iter().zip(&shares) {
            let distances = shared.distances(s);
            match params.scale {
                Scale::Mean => {
                    let unit = mean_distance(s);
                    values.iter_mut().zip(&distances).for_each(|(v, d)| *v -= share * d / unit);
                }
                Scale::Neighbours => {
                    let near = shared.self_tuned(&distances, params.neighbours as usize);
                    values.iter_mut().zip(&near).for_each(|(v, w)| *v += share * w);
                }
            }
        }
        let used = similarities.iter().zip(&shares).filter(|(_, w)| **w > 0.0);
        let names: Vec<&str> = used.map(|(s, _)| s.measure.as_str()).collect();
        Ok(shared.similarity(names.join(" + "), values))
    }
}

/// What several similarities have in common.
pub(crate) struct Shared {
    /// Queries that all have, in the order of the first.
    pub queries: Vec<String>,
    /// Targets that all have, in the order of the first.
    pub targets: Vec<String>,
    /// The pairs of them that were compared, which are the same by all measures; `None` for all.
    pub compared: Option<Lists>,
    missing: Vec<String>,
}

impl Shared {
    pub fn of(all: &[Arc<Similarity>]) -> Result<Self, NodeError> {
        let queries = common(all, |s| &s.queries);
        let targets = common(all, |s| &s.targets);
        if queries.is_empty() || targets.is_empty() {
            return Err(NodeError::new("no shape is in all of the similarities"));
        }
        let mut missing = Vec::new();
        let mut compared: Option<Option<Lists>> = None;
        for s in all {
            let lost =
                |all: &[String], kept: &[String]| all.iter().filter(|n| !kept.contains(n)).cloned().collect::<Vec<_>>();
            let lost = united(&lost(&s.queries, &queries), &lost(&s.targets, &targets));
            missing = united(&missing, &united(&s.missing, &lost));
            let own = s.compared.as_ref().and_then(|_| s.of_shapes(&queries, &targets).compared);
            if *compared.get_or_insert_with(|| own.clone()) != own {
                return Err(NodeError::new(format!("{} and {} are not of the same pairs", all[0].measure, s.measure))
                    .help("wire the same `shortlist` to all of them, or to none"));
            }
        }
        Ok(Self { queries, targets, compared: compared.flatten(), missing })
    }

    /// How values of the common pairs are ordered.
    fn order(&self) -> Order<'_> {
        Order { targets: self.targets.len(), lists: self.compared.as_ref() }
    }

    /// Distances of the common pairs from the greatest value of all.
    pub fn distances(&self, s: &Similarity) -> Vec<f64> {
        let most = greatest(s);
        s.of_shapes(&self.queries, &self.targets).values.into_iter().map(|x| most - x).collect()
    }

    /// exp(-d(q, t)² / s_q s_t), with s the mean distance to the nearest ones of another name.
    pub fn self_tuned(&self, distances: &[f64], neighbours: usize) -> Vec<f64> {
        let reach = |mut others: Vec<f64>| {
            others.sort_unstable_by(f64::total_cmp);
            others.truncate(neighbours);
            (others.iter().sum::<f64>() / others.len().max(1) as f64).max(f64::MIN_POSITIVE)
        };
        let (mut of_query, mut of_target) =
            (vec![Vec::new(); self.queries.len()], vec![Vec::new(); self.targets.len()]);
        let order = self.order();
        let pairs = || (0..self.queries.len()).flat_map(|q| order.row(q).map(move |t| (q, t)));
        for ((q, t), d) in pairs().zip(distances) {
            if self.queries[q] != self.targets[t] {
                of_query[q].push(*d);
                of_target[t].push(*d);
            }
        }
        let (rows, columns): (Vec<f64>, Vec<f64>) =
            (of_query.into_iter().map(reach).collect(), of_target.into_iter().map(reach).collect());
        pairs().zip(distances).map(|((q, t), d)| (-(d / rows[q]) * (d / columns[t])).exp()).collect()
    }

    /// The fused similarity of these values.
    pub fn similarity(self, measure: String, values: Vec<f64>) -> Similarity {
        let Self { queries, targets, compared, missing } = self;
        Similarity { measure, queries, targets, values, compared, missing }
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
