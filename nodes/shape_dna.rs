//! `shape_dna`: the first eigenvalues of a shape (Reuter, Wolter & Peinecke 2006), as logarithms free of its size.

use salient_sdk::{Context, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::eigensolve::Eigenpairs;
use crate::signature::{Signature, Spectral};

/// Params of [`ShapeDna`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many eigenvalues, without those that are zero. At least 1, default 15.
    #[schemars(range(min = 1))]
    pub values: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { values: 15 }
    }
}

/// The first eigenvalues above zero times the area, which have no unit.
fn free_of_size(basis: &Eigenpairs, count: usize) -> Result<Vec<f64>, NodeError> {
    let area: f64 = basis.mass.iter().sum();
    let values: Vec<f64> = basis.values.iter().filter(|x| **x > 0.0).take(count).map(|x| x * area).collect();
    if values.len() == count {
        return Ok(values);
    }
    let message = format!("{count} eigenvalues above zero are wanted, but the basis has {}", values.len());
    Err(NodeError::new(message).help("ask `eigensolve` for more `pairs`, or for fewer values here"))
}

/// The node.
pub struct ShapeDna;

impl Node for ShapeDna {
    const KIND: &'static str = "shape_dna";
    const VERSION: u32 = 1;
    const DOC: &'static str =
        "ShapeDNA: the logarithms of the first eigenvalues above zero times the area (Reuter, Wolter & Peinecke 2006).";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "dna":       shape_dna(basis: "basis"),
    "#;
    type Params = Params;
    type Inputs = Spectral;
    type Output = Signature;

    fn run(params: &Params, Spectral { basis }: Spectral, cx: Context) -> Result<Signature, NodeError> {
        cx.check()?;
        let values = free_of_size(&basis, params.values as usize)?;
        Ok(Signature { kind: "ShapeDNA".into(), values: values.into_iter().map(f64::ln).collect() })
    }
}
