//! `signature_similarity`: how near the vectors of shapes are.

use std::sync::Arc;

use salient_kernels::retrieval::manhattan;
use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::lists::Order;
use crate::signature::Signature;
use crate::similarity::{Similarity, keep_known, united};

/// How two vectors are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Distance {
    /// Sum of absolute differences.
    Manhattan,
    /// Root of the sum of squared differences.
    Euclidean,
    /// 1 minus the cosine of their angle.
    Cosine,
}

/// Params of [`SignatureSimilarity`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// `Manhattan` (default), `Euclidean` or `Cosine`.
    pub distance: Distance,
}

impl Default for Params {
    fn default() -> Self {
        Self { distance: Distance::Manhattan }
    }
}

/// Signatures by name.
pub struct In {
    signatures: Vec<(String, Arc<Signature>)>,
    missing: Vec<String>,
    shortlist: Option<Arc<Similarity>>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::surviving::<Signature>("signatures", "signatures of all shapes, of one kind"),
        Port::optional::<Similarity>("shortlist", "which pairs are compared, from `shortlist`; without it, all are"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self {
            missing: from.missing("signatures"),
            signatures: from.many("signatures")?,
            shortlist: from.optional("shortlist")?,
        })
    }
}

/// The node.
pub struct SignatureSimilarity;

impl Node for SignatureSimilarity {
    const KIND: &'static str = "signature_similarity";
    const VERSION: u32 = 2;
    const DOC: &'static str =
        "How near the signatures of shapes are: the negative distance of each two. Shapes that failed are listed.";
    const EXAMPLE: &'static str = r#"
        "a":     synthesize(pose: 0),
        "b":     synthesize(pose: 1),
        "sa":    volume_signature(mesh: "a"),
        "sb":    volume_signature(mesh: "b"),
        "alike": signature_similarity(signatures: ["sa", "sb"]),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Similarity;

    fn run(params: &Params, inputs: In, cx: Context) -> Result<Similarity, NodeError> {
        let In { mut signatures, mut missing, shortlist } = inputs;
        if let Some(list) = &shortlist {
            let lost = keep_known(&mut signatures, &list.queries);
            missing = united(&united(&missing, &list.missing), &lost);
        }
        let Some((_, first)) = signatures.first() else {
            return Err(NodeError::new(format!("there are no signatures: all {} shapes failed", missing.len())));
        };
        let differs = |s: &&(String, Arc<Signature>)| s.1.kind != first.kind || s.1.values.len() != first.values.len();
        if let Some((name, other)) = signatures.iter().find(differs) {
            return Err(NodeError::new(format!(
                "the signature of `{name}` is {} of {} values, the first one {} of {}",
                other.kind,
                other.values.len(),
                first.kind,
                first.values.len()
            )));
        }
        let names: Vec<String> = signatures.iter().map(|(name, _)| name.clone()).collect();
        let compared = shortlist.map(|list| list.listed(&names, &names)).transpose()?;
        let order = Order { targets: names.len(), lists: compared.as_ref() };
        let rows = cx.map(&signatures, |q, (_, a)| {
            // Not -0.0 for equal ones.
            let near = |t: usize| 0.0 - distance(&a.values, &signatures[t].1.values, params.distance);
            Ok(order.row(q).map(near).collect::<Vec<f64>>())
        })?;
        let (measure, values, targets) = (first.kind.clone(), rows.concat(), names.clone());
        Ok(Similarity { measure, queries: names, targets, values, compared, missing })
    }
}

fn distance(a: &[f64], b: &[f64], kind: Distance) -> f64 {
    let both = || a.iter().zip(b);
    match kind {
        Distance::Manhattan => manhattan(a, b),
        Distance::Euclidean => both().map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt(),
        Distance::Cosine => {
            let dot = |u: &[f64], v: &[f64]| u.iter().zip(v).map(|(x, y)| x * y).sum::<f64>();
            let lengths = (dot(a, a) * dot(b, b)).sqrt();
            if lengths > 0.0 { 1.0 - dot(a, b) / lengths } else { 1.0 }
        }
    }
}
