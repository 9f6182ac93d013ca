//! `point_signature`: what single points of a shape are like, by a point signature of the Laplacian at some vertices. For `vocabulary` and
//! `bag_of_features`.

use salient_kernels::signature::by_area;
use salient_sdk::{Artefact, Context, Decoder, Encoder, FormatError, Node, NodeError, Table};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::signature::Spectral;
use crate::spectral_signature::{Kernel, log};

/// Vectors that stand for points of one shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    /// What they are; points of different kinds are not compared.
    pub kind: String,
    /// The vertices.
    pub vertices: Vec<u32>,
    /// Their shares of the area; they sum to 1.
    pub shares: Vec<f64>,
    /// One row for each point.
    pub values: Vec<f64>,
}

impl Points {
    /// Number of values of a point.
    #[must_use]
    pub fn width(&self) -> usize {
        self.values.len() / self.vertices.len().max(1)
    }
}

impl Artefact for Points {
    const TYPE: &'static str = "point_signatures";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "What points of a shape are like: `values` [points, steps], without unit, of the `vertices` [points] that stand for `shares` \
        [points] of its area; the header's `kind` says what they are.";

    fn encode(&self, out: &mut Encoder) {
        out.u32("vertices", &self.vertices, &[self.vertices.len()]);
        out.f64("shares", &self.shares, &[self.shares.len()]);
        out.f64("values", &self.values, &[self.vertices.len(), self.width()]);
        out.header("kind", &self.kind);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let (vertices, shares) = (from.u32("vertices")?.0, from.f64("shares")?.0);
        let (values, shape) = from.f64("values")?;
        if shape.len() != 2 || shape[0] != vertices.len() || shares.len() != vertices.len() {
            let message =
                format!("values of shape {shape:?} and {} shares for {} points", shares.len(), vertices.len());
            return Err(FormatError(message));
        }
        Ok(Self { kind: from.header("kind")?, vertices, shares, values })
    }

    fn json(&self) -> Value {
        let rows: Vec<&[f64]> = self.values.chunks_exact(self.width().max(1)).collect();
        json!({ "kind": self.kind, "vertices": self.vertices, "shares": self.shares, "values": rows })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let count = |n: usize| n.to_string();
        vec![("kind", self.kind.clone()), ("points", count(self.vertices.len())), ("values", count(self.width()))]
    }

    fn table(&self) -> Option<Table> {
        let columns =
            ["vertex", "share"].map(str::to_owned).into_iter().chain((0..self.width()).map(|i| format!("{i}")));
        let rows = self.vertices.iter().zip(&self.shares).zip(self.values.chunks_exact(self.width().max(1)));
        let row = |((v, share), values): ((&u32, &f64), &[f64])| {
            [v.to_string(), share.to_string()].into_iter().chain(values.iter().map(f64::to_string)).collect()
        };
        Some(Table { columns: columns.collect(), rows: rows.map(row).collect() })
    }
}

/// Params of [`PointSignature`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// The point signature: `Wave` (default) or `Heat`.
    pub kernel: Kernel,
    /// Number of energies or times. 2 to 1000, default 16.
    #[schemars(range(min = 2, max = 1000))]
    pub steps: u32,
    /// Number of points, at most: vertices at even steps of the area. 1 to 100,000, default 400.
    #[schemars(range(min = 1, max = 100_000))]
    pub points: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { kernel: Kernel::Wave, steps: 16, points: 400 }
    }
}

/// The node.
pub struct PointSignature;

impl Node for PointSignature {
    const KIND: &'static str = "point_signature";
    const VERSION: u32 = 1;
    const DOC: &'static str = "The logarithms of the wave or heat kernel signature at points spread over a shape, for a vocabulary of such points.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "points":    point_signature(basis: "basis", kernel: Wave),
    "#;
    type Params = Params;
    type Inputs = Spectral;
    type Output = Points;

    fn run(params: &Params, Spectral { basis }: Spectral, cx: Context) -> Result<Points, NodeError> {
        let fields = params.kernel.fields(&basis, params.steps, cx)?;
        let (vertices, shares): (Vec<u32>, Vec<f64>) =
            by_area(&basis.mass, params.points as usize).into_iter().map(|(v, share)| (v as u32, share)).unzip();
        let values = vertices.iter().flat_map(|v| fields.iter().map(|f| log(f[*v as usize]))).collect();
        Ok(Points { kind: params.kernel.name().into(), vertices, shares, values })
    }
}
