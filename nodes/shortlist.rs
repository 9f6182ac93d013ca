//! `shortlist`: the pairs that are worth a full comparison, by a cheap one.

use salient_kernels::retrieval::ranked;
use salient_sdk::{Context, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::similarity::{Similarity, Single};

/// Params of [`Shortlist`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many targets of each query are compared in full, the most alike. At least 1, default 100.
    #[schemars(range(min = 1))]
    pub count: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { count: 100 }
    }
}

/// The node.
pub struct Shortlist;

impl Node for Shortlist {
    const KIND: &'static str = "shortlist";
    const VERSION: u32 = 1;
    const DOC: &'static str = "The most alike targets of each query by a cheap measure, for `match_all` to match. In a database against itself a pair is on the \
        list if either is on the other's.";
    const EXAMPLE: &'static str = r#"
        "a":     synthesize(pose: 0),
        "b":     synthesize(pose: 1),
        "va":    volume_signature(mesh: "a"),
        "vb":    volume_signature(mesh: "b"),
        "alike": signature_similarity(signatures: ["va", "vb"]),
        "list":  shortlist(similarity: "alike", count: 1),
    "#;
    type Params = Params;
    type Inputs = Single;
    type Output = Similarity;

    fn run(params: &Params, Single { similarity }: Single, cx: Context) -> Result<Similarity, NodeError> {
        cx.check()?;
        let (rows, columns) = (similarity.queries.len(), similarity.targets.len());
        let square = similarity.is_square();
        let mut compared = vec![0; rows * columns];
        for q in 0..rows {
            let order = ranked(similarity.row(q), &similarity.targets);
            let others = order.into_iter().filter(|t| !square || *t as usize != q);
            let mut chosen: Vec<usize> = others.take(params.count as usize).map(|t| t as usize).collect();
            if square {
                chosen.push(q);
            }
            for t in chosen {
                compared[q * columns + t] = 1;
                if square {
                    compared[t * columns + q] = 1;
                }
            }
        }
        Ok(Similarity { compared: Some(compared), ..(*similarity).clone() })
    }
}
