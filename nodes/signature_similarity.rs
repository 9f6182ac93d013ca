//! `signature_similarity`: how near the vectors of shapes are.

use std::sync::Arc;

use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::signature::Signature;
use crate::similarity::Similarity;

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
}

impl Inputs for In {
    const PORTS: &'static [Port] =
        &[Port::surviving::<Signature>("signatures", "signatures of all shapes, of one kind")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { missing: from.missing("signatures"), signatures: from.many("signatures")? })
    }
}

/// The node.
pub struct SignatureSimilarity;

impl Node for SignatureSimilarity {
    const KIND: &'static str = "signature_similarity";
    const VERSION: u32 = 1;
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

    fn run(params: &Params, In { signatures, missing }: In, cx: Context) -> Result<Similarity, NodeError> {
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
        let rows = cx.map(&signatures, |_, (_, a)| {
            // Not -0.0 for equal ones.
            Ok(signatures
                .iter()
                .map(|(_, b)| 0.0 - distance(&a.values, &b.values, params.distance))
                .collect::<Vec<f64>>())
        })?;
        let names: Vec<String> = signatures.iter().map(|(name, _)| name.clone()).collect();
        Ok(Similarity {
            measure: first.kind.clone(),
            queries: names.clone(),
            targets: names,
            values: rows.concat(),
            compared: None,
            missing,
        })
    }
}

fn distance(a: &[f64], b: &[f64], kind: Distance) -> f64 {
    let both = || a.iter().zip(b);
    match kind {
        Distance::Manhattan => both().map(|(x, y)| (x - y).abs()).sum(),
        Distance::Euclidean => both().map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt(),
        Distance::Cosine => {
            let dot = |u: &[f64], v: &[f64]| u.iter().zip(v).map(|(x, y)| x * y).sum::<f64>();
            let lengths = (dot(a, a) * dot(b, b)).sqrt();
            if lengths > 0.0 { 1.0 - dot(a, b) / lengths } else { 1.0 }
        }
    }
}
