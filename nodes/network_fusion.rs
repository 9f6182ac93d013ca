//! `network_fusion`: several similarities made one by letting each learn from the others.
//!
//! Similarity network fusion (Wang, Mezlini, Demir, Fiume, Tu, Brudno, Haibe-Kains & Goldenberg 2014). Each measure m is a network of weights
//! W(i, j) = exp(-d(i, j)² / s_i s_j), s_i the mean distance to the nearest ones of i. P_m is W with half of each row's weight on the diagonal, S_m has the
//! nearest ones alone, rows summing to 1. In each round P_m becomes S_m Q S_m', with Q the mean of the other measures' P: two shapes are alike by m if
//! their nearest ones by m are alike by the others. So what several measures agree on grows, and what only one claims fades; no weights
//! are to be chosen. The result is the mean of all P. It uses no label, but ranks come to depend on what else is in the database.

use salient_sdk::{Context, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fuse::{In, Shared};
use crate::similarity::Similarity;

/// Params of [`NetworkFusion`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Nearest neighbours of each shape by each measure: about half as many as a class has, or fewer. At least 1, default 10.
    #[schemars(range(min = 1))]
    pub neighbours: u32,
    /// How many times the networks learn from each other. 0 to 100, default 5; 0 is the mean of the networks.
    #[schemars(range(min = 0, max = 100))]
    pub rounds: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { neighbours: 10, rounds: 5 }
    }
}

/// The node.
pub struct NetworkFusion;

impl Node for NetworkFusion {
    const KIND: &'static str = "network_fusion";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Several similarities of a database made one, each learning from the others along its nearest neighbours (similarity network \
        fusion, Wang et al. 2014). It takes time and memory by the square of the number of shapes.";
    const EXAMPLE: &'static str = r#"
        "a":     synthesize(pose: 0),
        "b":     synthesize(pose: 1),
        "va":    volume_signature(mesh: "a"),
        "vb":    volume_signature(mesh: "b"),
        "wa":    panorama_signature(mesh: "a"),
        "wb":    panorama_signature(mesh: "b"),
        "volume": signature_similarity(signatures: ["va", "vb"]),
        "view":   signature_similarity(signatures: ["wa", "wb"]),
        "alike": network_fusion(similarities: ["volume", "view"]),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Similarity;

    fn run(params: &Params, In { similarities }: In, cx: Context) -> Result<Similarity, NodeError> {
        if similarities.len() < 2 {
            return Err(NodeError::new("there is nothing to fuse: at least two similarities are needed"));
        }
        let shared = Shared::of(&similarities)?;
        if shared.queries != shared.targets {
            return Err(NodeError::new("the queries are not the targets: only a database against itself is a network")
                .help("gather the same shapes as queries and targets"));
        }
        if shared.compared.is_some() {
            return Err(NodeError::new("not all pairs were compared: a network needs all")
                .help("fuse similarities of a shortlist with `fuse`, `scale: Neighbours`"));
        }
        let n = shared.queries.len();
        let neighbours = params.neighbours as usize;
        let networks = cx.map(&similarities, |_, s| {
            cx.check()?;
            Ok(Network::new(&shared.self_tuned(&shared.distances(s), neighbours), n, neighbours))
        })?;
        let (near, mut all): (Vec<Near>, Vec<Vec<f64>>) = networks.into_iter().map(|n| (n.near, n.all)).unzip();
        for _ in 0..params.rounds {
            let total = summed(&all);
            let mut next = Vec::with_capacity(all.len());
            for (near, own) in near.iter().zip(&all) {
                let others = (all.len() - 1) as f64;
                let rest: Vec<f64> = total.iter().zip(own).map(|(t, o)| (t - o) / others).collect();
                next.push(learned(near, &rest, cx)?);
            }
            all = next;
        }
        let count = all.len() as f64;
        let values = summed(&all).into_iter().map(|x| x / count).collect();
        let names: Vec<&str> = similarities.iter().map(|s| s.measure.as_str()).collect();
        Ok(shared.similarity(format!("{}, fused as networks", names.join(" + ")), values))
    }
}

/// The nearest ones of each shape and their weights, which sum to 1.
type Near = Vec<Vec<(usize, f64)>>;

struct Network {
    near: Near,
    all: Vec<f64>,
}

impl Network {
    fn new(weights: &[f64], n: usize, neighbours: usize) -> Self {
        let mut w: Vec<f64> = (0..n * n).map(|i| 0.5 * (weights[i] + weights[i % n * n + i / n])).collect();
        (0..n).for_each(|i| w[i * n + i] = 0.0);
        let near = w.chunks_exact(n.max(1)).enumerate().map(|(i, row)| {
            let mut others: Vec<usize> = (0..n).filter(|j| *j != i).collect();
            others.sort_by(|a, b| row[*b].total_cmp(&row[*a]).then(a.cmp(b)));
            others.truncate(neighbours);
            let sum: f64 = others.iter().map(|j| row[*j]).sum::<f64>().max(f64::MIN_POSITIVE);
            others.into_iter().map(|j| (j, row[j] / sum)).collect()
        });
        let near = near.collect();
        w.chunks_exact_mut(n.max(1)).enumerate().for_each(|(i, row)| halved(row, i));
        Self { near, all: w }
    }
}

/// A row with half of its weight on the diagonal, and 1 in all.
fn halved(row: &mut [f64], diagonal: usize) {
    let sum = row.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    for x in row.iter_mut() {
        *x /= 2.0 * sum;
    }
    row[diagonal] += 0.5;
}

fn summed(all: &[Vec<f64>]) -> Vec<f64> {
    let mut sum = vec![0.0; all.first().map_or(0, Vec::len)];
    for one in all {
        sum.iter_mut().zip(one).for_each(|(s, x)| *s += x);
    }
    sum
}

/// S Q S', rows halved, symmetric.
fn learned(near: &Near, rest: &[f64], cx: Context) -> Result<Vec<f64>, NodeError> {
    let n = near.len();
    let rows = cx.map(near, |i, own| {
        cx.check()?;
        let mut mixed = vec![0.0; n];
        for (k, w) in own {
            mixed.iter_mut().zip(&rest[k * n..(k + 1) * n]).for_each(|(m, x)| *m += w * x);
        }
        let mut row: Vec<f64> = near.iter().map(|other| other.iter().map(|(l, w)| w * mixed[*l]).sum()).collect();
        halved(&mut row, i);
        Ok(row)
    })?;
    Ok((0..n * n).map(|i| 0.5 * (rows[i / n][i % n] + rows[i % n][i / n])).collect())
}
