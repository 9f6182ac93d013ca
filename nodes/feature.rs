//! A salient feature: a vertex where the reconstruction energy peaks at one frequency.

use salient_sdk::{Decoder, Encoder, FormatError};
use serde_json::{Value, json};

/// A point on a shape and the frequency at which it stands out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Vertex index.
    pub vertex: u32,
    /// Index of the eigenpair (the first of its cluster), from 1.
    pub k: u32,
    /// Its eigenvalue, 1 / length².
    pub lambda: f64,
    /// Scale sf = 1 / sqrt(lambda), a length. The radical is printed in the paper with its index
    /// shown; section 2.3 and the units of eq. 22 make it a square root.
    pub scale: f64,
    /// Reconstruction energy there, a length.
    pub energy: f64,
}

impl Feature {
    /// A feature at the scale that its eigenvalue implies.
    #[must_use]
    pub fn new(vertex: u32, k: u32, lambda: f64, energy: f64) -> Self {
        Self { vertex, k, lambda, scale: 1.0 / lambda.sqrt(), energy }
    }

    /// The keys of the features' JSON that belong to the feature alone.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({
            "vertex": self.vertex,
            "k": self.k,
            "lambda": self.lambda,
            "scale": self.scale,
            "energy": self.energy,
        })
    }
}

/// Writes features as columns: `vertex`, `k`, `lambda`, `energy`, each of shape `[f]`.
pub fn encode(features: &[Feature], out: &mut Encoder) {
    let shape = [features.len()];
    let u32s = |of: fn(&Feature) -> u32| features.iter().map(of).collect::<Vec<_>>();
    let f64s = |of: fn(&Feature) -> f64| features.iter().map(of).collect::<Vec<_>>();
    out.u32("vertex", &u32s(|f| f.vertex), &shape);
    out.u32("k", &u32s(|f| f.k), &shape);
    out.f64("lambda", &f64s(|f| f.lambda), &shape);
    out.f64("energy", &f64s(|f| f.energy), &shape);
}

/// Reads what [`encode`] wrote.
pub fn decode(from: &Decoder) -> Result<Vec<Feature>, FormatError> {
    let (vertex, _) = from.u32("vertex")?;
    let (k, _) = from.u32("k")?;
    let (lambda, _) = from.f64("lambda")?;
    let (energy, _) = from.f64("energy")?;
    let n = vertex.len();
    if k.len() != n || lambda.len() != n || energy.len() != n {
        return Err(FormatError("the columns of the features differ in length".into()));
    }
    Ok((0..n).map(|i| Feature::new(vertex[i], k[i], lambda[i], energy[i])).collect())
}

/// Column names of a table of features.
pub const COLUMNS: [&str; 5] = ["vertex", "k", "lambda", "scale", "energy"];

/// A row of a table of features.
#[must_use]
pub fn row(f: &Feature) -> Vec<String> {
    vec![f.vertex.to_string(), f.k.to_string(), f.lambda.to_string(), f.scale.to_string(), f.energy.to_string()]
}
