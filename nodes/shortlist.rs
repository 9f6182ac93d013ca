//! `shortlist`: for each shape of a database those that are worth a full comparison, by cheap signatures.
//!
//! With d_k(i, j) the sum of absolute differences between the signatures of kind k of two shapes, and m_k its mean, the distance is the weighted
//! mean of d_k / m_k. All pairs are looked at, block by block, but only what is on the lists is kept: for 10,000 shapes a
//! full matrix would take 800 MB, lists of 100 take some 20.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use salient_kernels::retrieval::{manhattan, ranked};
use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::lists::Lists;
use crate::signature::Signature;
use crate::similarity::{Similarity, united};
use crate::weights;

/// Rows that are compared with all shapes at once, so that every signature is fetched once for all of them.
const BLOCK: usize = 32;

/// Rows, evenly spaced, that the mean distance is measured on. Up to so many shapes it is exact.
const SAMPLE: usize = 512;

/// Params of [`Shortlist`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many others are on the list of each shape, the most alike. At least 1, default 100.
    #[schemars(range(min = 1))]
    pub count: u32,
    /// Weight of each kind of signature, in the order of the wires; each at least 0. Default: 1 for all.
    pub weights: Vec<f64>,
}

impl Default for Params {
    fn default() -> Self {
        Self { count: 100, weights: Vec::new() }
    }
}

/// Signatures of one or several kinds, by the names of shapes.
pub struct In {
    signatures: Vec<(String, Arc<Signature>)>,
    missing: Vec<String>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::surviving::<Signature>(
        "signatures",
        "signatures of all shapes; of several kinds as in `[all(\"wave\"), all(\"view\")]`",
    )];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { missing: from.missing("signatures"), signatures: from.many("signatures")? })
    }
}

/// The node.
pub struct Shortlist;

impl Node for Shortlist {
    const KIND: &'static str = "shortlist";
    const VERSION: u32 = 2;
    const DOC: &'static str = "The most alike others of each shape by cheap signatures, for `match_all` and `signature_similarity` to compare in full. A pair is on the \
        list if either is on the other's. All pairs are looked at, but only those on lists are kept.";
    const EXAMPLE: &'static str = r#"
        "a":     synthesize(pose: 0),
        "b":     synthesize(pose: 1),
        "va":    volume_signature(mesh: "a"),
        "vb":    volume_signature(mesh: "b"),
        "list":  shortlist(signatures: ["va", "vb"], count: 1),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Similarity;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        weights::check(&params.weights)
    }

    fn run(params: &Params, In { signatures, missing }: In, cx: Context) -> Result<Similarity, NodeError> {
        let index = Index::new(&signatures, &missing, &params.weights, cx)?;
        let n = index.names.len();
        let blocks: Vec<Vec<usize>> = (0..n).collect::<Vec<_>>().chunks(BLOCK).map(<[usize]>::to_vec).collect();
        let nearest = cx.map(&blocks, |_, block| {
            let distances = index.distances(block, cx)?;
            let best = |(i, row): (&usize, &[f64])| {
                let alike: Vec<f64> = row.iter().map(|d| 0.0 - d).collect();
                // One more, as the shape itself is among them, or another one that is equal to it.
                let order = ranked(&alike, |j| &index.names[j], (params.count as usize).saturating_add(1));
                let others = order.into_iter().filter(|j| *j as usize != *i).take(params.count as usize);
                others.chain([*i as u32]).map(|j| (j, alike[j as usize])).collect::<Vec<(u32, f64)>>()
            };
            Ok(block.iter().zip(distances.chunks(n)).map(best).collect::<Vec<_>>())
        })?;
        let mut rows: Vec<BTreeMap<u32, f64>> = nearest.into_iter().flatten().map(BTreeMap::from_iter).collect();
        for i in 0..n {
            for (j, alike) in rows[i].clone() {
                rows[j as usize].insert(i as u32, alike);
            }
        }
        Ok(Similarity {
            measure: index.kinds.join(" + "),
            values: rows.iter().flat_map(|row| row.values().copied()).collect(),
            compared: Some(Lists::new(rows.iter().map(|row| row.keys().copied().collect()))),
            queries: index.names.clone(),
            targets: index.names,
            missing: index.missing,
        })
    }
}

/// Signatures of one kind, shape by shape, and what their distances are multiplied with.
struct Kind<'a> {
    values: Vec<&'a [f64]>,
    factor: f64,
}

struct Index<'a> {
    /// Shapes that have signatures of all kinds.
    names: Vec<String>,
    kinds: Vec<&'a str>,
    of: Vec<Kind<'a>>,
    missing: Vec<String>,
}

impl<'a> Index<'a> {
    fn new(
        signatures: &'a [(String, Arc<Signature>)],
        missing: &[String],
        weights: &[f64],
        cx: Context,
    ) -> Result<Self, NodeError> {
        let mut kinds: Vec<&str> = Vec::new();
        let mut by_kind: BTreeMap<&str, BTreeMap<&str, &'a [f64]>> = BTreeMap::new();
        for (name, signature) in signatures {
            let kind = signature.kind.as_str();
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
            if by_kind.entry(kind).or_default().insert(name, &signature.values).is_some() {
                return Err(NodeError::new(format!("`{name}` has two signatures of the kind {kind}")));
            }
        }
        let has_all = |name: &str| by_kind.values().all(|of| of.contains_key(name));
        let mut seen = BTreeSet::new();
        let all: Vec<&String> = signatures.iter().map(|(name, _)| name).filter(|name| seen.insert(*name)).collect();
        let (names, lost): (Vec<&String>, Vec<&String>) = all.into_iter().partition(|name| has_all(name));
        let lost: Vec<String> = lost.into_iter().cloned().collect();
        let missing = united(missing, &lost);
        if names.is_empty() {
            let message =
                format!("no shape has a signature of each kind ({}); {} failed", kinds.join(", "), missing.len());
            return Err(NodeError::new(message).help("wire several kinds as `[all(\"wave\"), all(\"view\")]`"));
        }
        let shares = weights::shares(weights, kinds.len(), "kinds of signatures")?;
        let mut of = Vec::with_capacity(kinds.len());
        for (kind, share) in kinds.iter().zip(&shares) {
            let values: Vec<&[f64]> = names.iter().map(|name| by_kind[kind][name.as_str()]).collect();
            if let Some(at) = values.iter().position(|v| v.len() != values[0].len()) {
                let (name, got, expected) = (names[at], values[at].len(), values[0].len());
                return Err(NodeError::new(format!("{kind} of `{name}` has {got} values, of others {expected}")));
            }
            let mut one = Kind { values, factor: 1.0 };
            one.factor = share / one.mean(cx)?;
            of.push(one);
        }
        Ok(Self { names: names.into_iter().cloned().collect(), kinds, of, missing })
    }

    /// From each shape of a block to all, row by row.
    fn distances(&self, block: &[usize], cx: Context) -> Result<Vec<f64>, NodeError> {
        let n = self.names.len();
        let mut rows = vec![0.0; block.len() * n];
        for kind in &self.of {
            for (j, b) in kind.values.iter().enumerate() {
                if j % 256 == 0 {
                    cx.check()?;
                }
                for (row, i) in block.iter().enumerate() {
                    rows[row * n + j] += kind.factor * manhattan(kind.values[*i], b);
                }
            }
        }
        Ok(rows)
    }
}

impl Kind<'_> {
    /// The mean distance of different shapes; 1 if it is 0.
    fn mean(&self, cx: Context) -> Result<f64, NodeError> {
        let n = self.values.len();
        let rows: Vec<usize> = (0..n).step_by(n.div_ceil(SAMPLE)).collect();
        let sums = cx.map(&rows, |_, &i| Ok(self.values.iter().map(|b| manhattan(self.values[i], b)).sum::<f64>()))?;
        let mean = sums.iter().sum::<f64>() / (rows.len() * (n - 1)).max(1) as f64;
        Ok(if mean > 0.0 { mean } else { 1.0 })
    }
}
