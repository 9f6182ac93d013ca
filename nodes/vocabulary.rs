//! `vocabulary`: words that stand for points of many shapes, for `bag_of_features` (Bronstein, Bronstein, Guibas & Ovsjanikov 2011).
//!
//! k-means of points of some shapes, seeded. Which shapes, their content decides: those of the smallest hashes. So the vocabulary does not
//! depend on the order or the names of shapes, and a shape that is added to a large database hardly ever changes it.

use std::sync::Arc;

use salient_kernels::signature::by_area;
use salient_kernels::signature::vocabulary::{Words, words};
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, ItemHasher, ItemKey, Node, NodeError, Port, PortValues,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::point_signature::Points;

/// Words that stand for points.
#[derive(Clone, Debug, PartialEq)]
pub struct Vocabulary {
    /// What the points are.
    pub kind: String,
    /// Number of values of a point.
    pub width: usize,
    /// The words, and the median squared distance of a point from its word.
    pub words: Words,
}

impl Artefact for Vocabulary {
    const TYPE: &'static str = "vocabulary";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Words that stand for points of shapes: `words` [words, steps], and the median squared distance `spread` [1] of a point from its \
        word; the header's `kind` says what the points are.";

    fn encode(&self, out: &mut Encoder) {
        let count = self.words.centres.len() / self.width.max(1);
        out.f64("words", &self.words.centres, &[count, self.width]);
        out.f64("spread", &[self.words.spread], &[1]);
        out.header("kind", &self.kind);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let ((centres, shape), (spread, _)) = (from.f64("words")?, from.f64("spread")?);
        match (shape[..].as_ref(), &spread[..]) {
            ([_, width], [spread]) if *width > 0 => {
                Ok(Self { kind: from.header("kind")?, width: *width, words: Words { centres, spread: *spread } })
            }
            _ => Err(FormatError(format!("words of shape {shape:?} and {} spreads", spread.len()))),
        }
    }

    fn json(&self) -> Value {
        let rows: Vec<&[f64]> = self.words.centres.chunks_exact(self.width.max(1)).collect();
        json!({ "kind": self.kind, "words": rows, "spread": self.words.spread })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let count = self.words.centres.len() / self.width.max(1);
        vec![("kind", self.kind.clone()), ("words", count.to_string()), ("values", self.width.to_string())]
    }
}

/// Params of [`MakeVocabulary`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of words. 1 to 10,000, default 128.
    #[schemars(range(min = 1, max = 10_000))]
    pub words: u32,
    /// How many shapes the words are made of, at most: those of the smallest hash. At least 1, default 64.
    #[schemars(range(min = 1))]
    pub shapes: u32,
    /// How many points of each shape, at most. At least 1, default 100.
    #[schemars(range(min = 1))]
    pub per_shape: u32,
    /// Start of the random numbers. Default 0.
    pub seed: u64,
    /// Rounds of k-means, at most. 1 to 10,000, default 50.
    #[schemars(range(min = 1, max = 10_000))]
    pub rounds: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { words: 128, shapes: 64, per_shape: 100, seed: 0, rounds: 50 }
    }
}

/// Points of all shapes.
pub struct In {
    points: Vec<Arc<Points>>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::surviving::<Points>("points", "points of all shapes, of one kind")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { points: from.many("points")?.into_iter().map(|(_, points)| points).collect() })
    }
}

/// The node.
pub struct MakeVocabulary;

impl Node for MakeVocabulary {
    const KIND: &'static str = "vocabulary";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Words that stand for points of shapes: k-means of points of some of them, seeded. Their content decides which, so that a new shape \
        hardly ever changes the words of a large database.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "points":    point_signature(basis: "basis"),
        "words":     vocabulary(points: ["points"]),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Vocabulary;

    fn run(params: &Params, In { points }: In, cx: Context) -> Result<Vocabulary, NodeError> {
        let Some(first) = points.first() else {
            return Err(NodeError::new("there are no points: all shapes failed"));
        };
        let (kind, width) = (first.kind.clone(), first.width());
        if let Some(other) = points.iter().find(|p| p.kind != kind || p.width() != width) {
            let message = format!("points are {kind} of {width} values and {} of {}", other.kind, other.width());
            return Err(NodeError::new(message));
        }
        let mut chosen: Vec<(ItemKey, &Points)> = points.iter().map(|p| (content(p), &**p)).collect();
        chosen.sort_by_key(|(key, _)| *key);
        chosen.dedup_by_key(|(key, _)| *key);
        chosen.truncate(params.shapes as usize);
        let mut all = Vec::new();
        for (_, shape) in chosen {
            for (i, _) in by_area(&shape.shares, params.per_shape as usize) {
                all.extend_from_slice(&shape.values[i * width..(i + 1) * width]);
            }
        }
        let found = words(&all, width, params.words as usize, params.seed, params.rounds as usize, &|| cx.cancelled());
        cx.check()?;
        let words = found.ok_or_else(|| NodeError::new("the shapes have no points"))?;
        Ok(Vocabulary { kind, width, words })
    }
}

fn content(points: &Points) -> ItemKey {
    let mut hash = ItemHasher::default();
    hash.f64s(&points.values);
    hash.f64s(&points.shares);
    hash.finish()
}
