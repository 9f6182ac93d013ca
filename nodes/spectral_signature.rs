//! `heat_signature` and `wave_signature`: how a point signature of the Laplacian is distributed over the shape.
//!
//! The heat kernel signature (Sun, Ovsjanikov & Guibas 2009) is h(x, t) = sum of exp(-lambda_k t) phi_k(x)², the wave kernel signature (Aubry,
//! Schlickewei & Cremers 2011) the mean of phi_k(x)² under a Gaussian of ln lambda_k about an energy. Times and energies are in units of the area, so
//! that size does not matter. Over a shape, each is described by its quantiles by area, or by its mean; the logarithm is taken first.
//! The mean of either depends on the eigenvalues alone.

use salient_sdk::{Context, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::eigensolve::Eigenpairs;
use crate::signature::{Signature, Spectral};

/// How values over a shape become a few.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Pool {
    /// Quantiles by area, at 0.1, 0.3, 0.5, 0.7 and 0.9.
    Quantiles,
    /// The mean by area.
    Average,
}

/// Params of [`HeatSignature`] and [`WaveSignature`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of times or energies. 2 to 1000, default 16.
    #[schemars(range(min = 2, max = 1000))]
    pub steps: u32,
    /// How values over the shape become a few: `Quantiles` (default) or `Average`.
    pub pool: Pool,
}

impl Default for Params {
    fn default() -> Self {
        Self { steps: 16, pool: Pool::Quantiles }
    }
}

const QUANTILES: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
/// Times over the area: from what 100 eigenpairs resolve to where little but the constant is left.
const TIMES: [f64; 2] = [0.006, 0.6];
/// Energies, ln(lambda area): from about the first eigenvalue to the hundredth of most shapes.
const ENERGIES: [f64; 2] = [2.0, 6.9];
/// Width of the Gaussian in steps of energy (Aubry et al., section 5).
const WIDTH: f64 = 7.0 / 6.0;

/// The node of the heat kernel.
pub struct HeatSignature;

impl Node for HeatSignature {
    const KIND: &'static str = "heat_signature";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How the heat kernel signature (Sun, Ovsjanikov & Guibas 2009) is distributed over a shape, at times from fine to coarse.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "signature": heat_signature(basis: "basis"),
    "#;
    type Params = Params;
    type Inputs = Spectral;
    type Output = Signature;

    fn run(params: &Params, Spectral { basis }: Spectral, cx: Context) -> Result<Signature, NodeError> {
        pooled(&basis, params, Kernel::Heat, cx)
    }
}

/// The node of the wave kernel.
pub struct WaveSignature;

impl Node for WaveSignature {
    const KIND: &'static str = "wave_signature";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How the wave kernel signature (Aubry, Schlickewei & Cremers 2011) is distributed over a shape, at energies from low to high.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "signature": wave_signature(basis: "basis"),
    "#;
    type Params = Params;
    type Inputs = Spectral;
    type Output = Signature;

    fn run(params: &Params, Spectral { basis }: Spectral, cx: Context) -> Result<Signature, NodeError> {
        pooled(&basis, params, Kernel::Wave, cx)
    }
}

/// A point signature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Kernel {
    /// The heat kernel signature.
    Heat,
    /// The wave kernel signature.
    Wave,
}

impl Kernel {
    /// As the kind of what is made of it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Heat => "heat kernel",
            Self::Wave => "wave kernel",
        }
    }

    /// The weight of an eigenvalue times the area in step `at` of `steps`.
    fn weight(self, lambda: f64, at: u32, steps: u32) -> f64 {
        let share = f64::from(at) / f64::from(steps - 1);
        match self {
            Self::Heat => {
                let [from, to] = TIMES.map(f64::ln);
                (-lambda * (from + share * (to - from)).exp()).exp()
            }
            Self::Wave => {
                let [from, to] = ENERGIES;
                let sigma = WIDTH * (to - from) / f64::from(steps - 1);
                let off = (lambda.ln() - from - share * (to - from)) / sigma;
                // Without the normalisation by their sum, so that the density of eigenvalues counts too.
                (-0.5 * off * off).exp()
            }
        }
    }

    /// The sum of weight(lambda_k area) phi_k² area at every vertex, for each step. The constant eigenfunction is left out: it is the same for all.
    pub(crate) fn fields(self, basis: &Eigenpairs, steps: u32, cx: Context) -> Result<Vec<Vec<f64>>, NodeError> {
        let area: f64 = basis.mass.iter().sum();
        let above_zero: Vec<usize> = (0..basis.values.len()).filter(|k| basis.values[*k] > 0.0).collect();
        if above_zero.is_empty() {
            return Err(
                NodeError::new("the basis has no eigenvalue above zero").help("ask `eigensolve` for more `pairs`")
            );
        }
        let all: Vec<u32> = (0..steps).collect();
        cx.map(&all, |_, at| {
            cx.check()?;
            let mut field = vec![0.0; basis.mass.len()];
            for k in &above_zero {
                let w = area * self.weight(basis.values[*k] * area, *at, steps);
                field.iter_mut().zip(basis.vector(*k)).for_each(|(f, phi)| *f += w * phi * phi);
            }
            Ok(field)
        })
    }
}

/// The logarithm of a value of a point signature, which nothing near zero should decide.
pub(crate) fn log(x: f64) -> f64 {
    x.max(FLOOR).ln()
}

/// The logarithms of a point signature, pooled, step by step.
fn pooled(basis: &Eigenpairs, params: &Params, kernel: Kernel, cx: Context) -> Result<Signature, NodeError> {
    let area: f64 = basis.mass.iter().sum();
    let pool = |field: &Vec<f64>| match params.pool {
        Pool::Average => vec![log(field.iter().zip(&basis.mass).map(|(f, m)| f * m).sum::<f64>() / area)],
        Pool::Quantiles => quantiles(field, &basis.mass).into_iter().map(log).collect(),
    };
    let values = kernel.fields(basis, params.steps, cx)?.iter().flat_map(pool).collect();
    Ok(Signature { kind: kernel.name().into(), values })
}

/// Values below this are as good as zero, and their logarithm should not decide anything.
const FLOOR: f64 = 1e-2;

/// The quantiles of values by weight.
fn quantiles(values: &[f64], weights: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]).then(a.cmp(b)));
    let total: f64 = weights.iter().sum();
    let (mut sum, mut at) = (0.0, 0);
    let mut found = Vec::with_capacity(QUANTILES.len());
    for q in QUANTILES {
        while at + 1 < order.len() && sum + weights[order[at]] < q * total {
            sum += weights[order[at]];
            at += 1;
        }
        found.push(order.get(at).map_or(0.0, |i| values[*i]));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_go_by_weight() {
        assert_eq!(quantiles(&[3.0, 1.0, 2.0], &[1.0, 1.0, 1.0]), [1.0, 1.0, 2.0, 3.0, 3.0]);
        assert_eq!(quantiles(&[3.0, 1.0], &[0.05, 0.95]), [1.0; 5]);
        assert_eq!(quantiles(&[3.0, 1.0], &[0.8, 0.2]), [1.0, 3.0, 3.0, 3.0, 3.0]);
    }
}
