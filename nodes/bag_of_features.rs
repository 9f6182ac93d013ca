//! `bag_of_features`: how often a shape uses each word of a vocabulary (Bronstein, Bronstein, Guibas & Ovsjanikov 2011, soft assignment).

use std::sync::Arc;

use salient_kernels::signature::vocabulary::frequencies;
use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::point_signature::Points;
use crate::signature::Signature;
use crate::vocabulary::Vocabulary;

/// Params of [`BagOfFeatures`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How far a point is shared: by exp(-d² / (softness m)), with m the vocabulary's median squared distance. Above 0, default 1.
    #[schemars(range(min = 1e-6))]
    pub softness: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self { softness: 1.0 }
    }
}

/// A shape's points and the words.
pub struct In {
    points: Arc<Points>,
    vocabulary: Arc<Vocabulary>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Points>("points", "points of the shape"),
        Port::one::<Vocabulary>("vocabulary", "words that stand for such points"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { points: from.one("points")?, vocabulary: from.one("vocabulary")? })
    }
}

/// The node.
pub struct BagOfFeatures;

impl Node for BagOfFeatures {
    const KIND: &'static str = "bag_of_features";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How often a shape uses each word of a vocabulary, points shared by the words near to them: the roots of the frequencies (Shape \
        Google, Bronstein et al. 2011).";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "points":    point_signature(basis: "basis"),
        "words":     vocabulary(points: ["points"]),
        "bag":       bag_of_features(points: "points", vocabulary: "words"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Signature;

    fn run(params: &Params, In { points, vocabulary }: In, cx: Context) -> Result<Signature, NodeError> {
        cx.check()?;
        if points.kind != vocabulary.kind || points.width() != vocabulary.width {
            return Err(NodeError::new(format!(
                "the points are {} of {} values, the words of {} of {}",
                points.kind,
                points.width(),
                vocabulary.kind,
                vocabulary.width
            ))
            .help("make the vocabulary of points of the same kind"));
        }
        let found = frequencies(&vocabulary.words, &points.values, &points.shares, vocabulary.width, params.softness);
        // Roots, so that rare words count too: sums of differences of these measure as Hellinger's distance does.
        let values = found.into_iter().map(f64::sqrt).collect();
        Ok(Signature { kind: format!("bag of {}", vocabulary.kind), values })
    }
}
