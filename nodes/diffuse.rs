//! `diffuse`: similarities spread over a database, so that what is like many that are like the query moves forward.
//!
//! Manifold ranking (Zhou, Weston, Gretton, Bousquet & Schölkopf 2003): the nearest neighbours of each shape make a graph with weights
//! w(i, j) = exp(-d(i, j)² / s_i s_j), s_i the mean distance to the neighbours of i; with D its degrees, and P = D^-1/2 W D^-1/2, the result is
//! (1 - alpha) (I - alpha P)^-1. It looks at no label, but at the whole database: a shape's rank depends on what else there is. What is much the same
//! to the whole neighbourhood of a query need not be so to the query itself, so diffused values may be multiplied with a similarity of
//! each two by themselves (`local`): without it, the nearest of all is lost now and then.

use std::sync::Arc;

use salient_kernels::retrieval::ranked;
use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fuse::greatest;
use crate::similarity::Similarity;

/// What the weights of links are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Links {
    /// exp(-d(i, j)² / s_i s_j).
    Distances,
    /// The similarity itself, of which no value is negative.
    Given,
}

/// Params of [`Diffuse`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Nearest neighbours of each shape that it is linked with. At least 1, default 10.
    #[schemars(range(min = 1))]
    pub neighbours: u32,
    /// How far similarity spreads: 0 is not at all. 0 to 0.99, default 0.8.
    #[schemars(range(min = 0.0, max = 0.99))]
    pub alpha: f64,
    /// Weights of links: by `Distances` (default) from the greatest similarity, over those of the nearest ones; or the similarity as it is `Given`.
    pub links: Links,
}

impl Default for Params {
    fn default() -> Self {
        Self { neighbours: 10, alpha: 0.8, links: Links::Distances }
    }
}

/// A database against itself.
pub struct In {
    similarity: Arc<Similarity>,
    local: Option<Arc<Similarity>>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Similarity>("similarity", "how alike the shapes of a database are"),
        Port::optional::<Similarity>(
            "local",
            "how alike each two are by themselves, at least 0: a factor of the diffused similarity",
        ),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { similarity: from.one("similarity")?, local: from.optional("local")? })
    }
}

/// Least diffused similarity that `local` is multiplied with, so that it orders what nothing links with the query.
const UNLINKED: f64 = 1e-9;

/// The node.
pub struct Diffuse;

impl Node for Diffuse {
    const KIND: &'static str = "diffuse";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Similarities spread along the nearest neighbours of each shape (manifold ranking, Zhou et al. 2003). No label is used, but ranks come \
        to depend on what else is in the database.";
    const EXAMPLE: &'static str = r#"
        "a":      synthesize(pose: 0),
        "b":      synthesize(pose: 1),
        "va":     volume_signature(mesh: "a"),
        "vb":     volume_signature(mesh: "b"),
        "alike":  signature_similarity(signatures: ["va", "vb"]),
        "spread": diffuse(similarity: "alike"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Similarity;

    fn run(params: &Params, In { similarity, local }: In, cx: Context) -> Result<Similarity, NodeError> {
        if !similarity.is_square() {
            return Err(NodeError::new(
                "the queries are not the targets: only a database against itself can be diffused",
            )
            .help("gather the same shapes as queries and targets"));
        }
        let negative = |s: &Similarity| s.values.iter().any(|v| *v < 0.0);
        if params.links == Links::Given && negative(&similarity) {
            return Err(NodeError::new(format!("{} has negative values, which are no weights", similarity.measure))
                .help("use `links: Distances`"));
        }
        if let Some(local) = &local {
            similarity.must_fit(local)?;
            if negative(local) {
                return Err(NodeError::new(format!("`local` ({}) has negative values", local.measure))
                    .help("fuse it with `scale: Neighbours`"));
            }
        }
        let graph = Graph::new(&similarity, params.neighbours as usize, params.links);
        let columns: Vec<usize> = (0..similarity.queries.len()).collect();
        let rows = cx.map(&columns, |_, &i| {
            cx.check()?;
            let spread = graph.spread(i, params.alpha);
            let mut row: Vec<f64> = similarity.order().row(i).map(|j| spread[j]).collect();
            if let Some(local) = &local {
                row.iter_mut().zip(local.row(i)).for_each(|(x, near)| *x = x.max(UNLINKED) * near);
            }
            Ok(row)
        })?;
        Ok(Similarity {
            measure: format!("{}, diffused", similarity.measure),
            queries: similarity.queries.clone(),
            targets: similarity.targets.clone(),
            values: rows.concat(),
            compared: similarity.compared.clone(),
            missing: similarity.missing.clone(),
        })
    }
}

/// P, row by row: (column, weight).
struct Graph(Vec<Vec<(usize, f64)>>);

impl Graph {
    fn new(of: &Similarity, neighbours: usize, links: Links) -> Self {
        let n = of.queries.len();
        let most = greatest(of);
        // The mean of both ways, as a shortlist or a search may have found different ones.
        let both = |i: usize, j: usize, x: f64| most - 0.5 * (x + of.value(j, i).unwrap_or(x));
        let nearest: Vec<Vec<(usize, f64)>> = (0..n)
            .map(|i| {
                let (others, near): (Vec<usize>, Vec<f64>) =
                    of.entries(i).filter(|(j, _)| *j != i).map(|(j, x)| (j, 0.0 - both(i, j, x))).unzip();
                let best = ranked(&near, |k| &of.targets[others[k]], neighbours);
                best.into_iter().map(|k| (others[k as usize], 0.0 - near[k as usize])).collect()
            })
            .collect();
        let reach = |i: usize| {
            let sum: f64 = nearest[i].iter().map(|(_, d)| d).sum();
            (sum / nearest[i].len().max(1) as f64).max(f64::MIN_POSITIVE)
        };
        let reaches: Vec<f64> = (0..n).map(reach).collect();
        let weight = |i: usize, j: usize, d: f64| match links {
            Links::Distances => (-(d / reaches[i]) * (d / reaches[j])).exp(),
            Links::Given => most - d,
        };
        let mut rows: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
        for (i, near) in nearest.iter().enumerate() {
            for &(j, d) in near {
                rows[i].push((j, weight(i, j, d)));
                rows[j].push((i, weight(j, i, d)));
            }
        }
        for row in &mut rows {
            row.sort_by_key(|(j, _)| *j);
            row.dedup_by_key(|(j, _)| *j);
        }
        let degree: Vec<f64> =
            rows.iter().map(|row| row.iter().map(|(_, w)| w).sum::<f64>().max(f64::MIN_POSITIVE)).collect();
        for (i, row) in rows.iter_mut().enumerate() {
            for (j, w) in row.iter_mut() {
                *w /= degree[i].sqrt() * degree[*j].sqrt();
            }
        }
        Self(rows)
    }

    /// (1 - alpha) (I - alpha P)^-1 e_i, by conjugate gradients: the matrix is symmetric, its eigenvalues are within 1 - alpha and 1 + alpha.
    fn spread(&self, i: usize, alpha: f64) -> Vec<f64> {
        let n = self.0.len();
        let apply = |x: &[f64]| -> Vec<f64> {
            let row =
                |(k, row): (usize, &Vec<(usize, f64)>)| x[k] - alpha * row.iter().map(|(j, w)| w * x[*j]).sum::<f64>();
            self.0.iter().enumerate().map(row).collect()
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let (mut x, mut residual) = (vec![0.0; n], vec![0.0; n]);
        residual[i] = 1.0 - alpha;
        let mut direction = residual.clone();
        let mut square = dot(&residual, &residual);
        let enough = square * 1e-24;
        for _ in 0..1000 {
            if square <= enough {
                break;
            }
            let image = apply(&direction);
            let step = square / dot(&direction, &image);
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
            residual.iter_mut().zip(&image).for_each(|(r, a)| *r -= step * a);
            let next = dot(&residual, &residual);
            direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + next / square * *d);
            square = next;
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use salient_sdk::testing::TestHost;

    use super::*;

    #[test]
    fn the_inverse_is_one() {
        let names: Vec<String> = ["a", "b", "c", "d", "e"].map(str::to_owned).to_vec();
        let at = [0.0, 0.1, 0.25, 2.0, 2.3_f64];
        let values = at.iter().flat_map(|x| at.iter().map(move |y| 0.0 - (x - y).abs())).collect();
        let line = Similarity {
            measure: "place".into(),
            queries: names.clone(),
            targets: names,
            values,
            compared: None,
            missing: vec!["z".into()],
        };
        let graph = Graph::new(&line, 2, Links::Distances);
        let alpha = 0.9;
        let similarity = Arc::new(line);
        let spread = TestHost::default()
            .run::<Diffuse>(&Params { neighbours: 2, alpha, ..Params::default() }, In { similarity, local: None })
            .unwrap();
        assert_eq!(spread.missing, ["z"]);
        for i in 0..5 {
            for k in 0..5 {
                // Row k of (I - alpha P) times column i of the result is the unit matrix times 1 - alpha.
                let product =
                    spread.row(i)[k] - alpha * graph.0[k].iter().map(|(j, w)| w * spread.row(i)[*j]).sum::<f64>();
                let unit = if i == k { 1.0 - alpha } else { 0.0 };
                assert!((product - unit).abs() < 1e-10, "{i} {k}: {product}");
                assert!((spread.row(i)[k] - spread.row(k)[i]).abs() < 1e-10);
            }
        }
    }
}
