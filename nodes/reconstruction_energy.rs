//! `reconstruction_energy`: how much each frequency contributes to the position of each vertex.
//!
//! With positions P (n x 3), mass S and eigenvectors V, the spectral coefficients are C = P' S V
//! (eq. 15), and the energy is E(i, k) = ||V(i, k) C(:, k)||_2 (eq. 18). The zero eigenvalues are
//! excluded: they encode position, not shape.
//!
//! The basis of a multiple eigenvalue is free to rotate, and E(i, k) with it. So the energy is taken
//! over each cluster of (nearly) equal eigenvalues: the norm of the sum of V(i, k) C(:, k) over the
//! cluster, which is the projection of P on the eigenspace and does not depend on the basis.

use std::sync::Arc;

use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::eigensolve::Eigenpairs;

/// Params of [`ReconstructionEnergy`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Eigenvalues whose relative difference to the one before is at most this are one cluster.
    /// 0 takes every eigenfunction alone, as printed. Range 0 to 0.1, default 1e-3.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub cluster: f64,
    /// A cluster whose coefficients ||C|| are below this share of the largest one's has no energy:
    /// what is left there is rounding. Range 0 to 0.5, default 1e-6.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub floor: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self { cluster: 1e-3, floor: 1e-6 }
    }
}

/// A mesh and the eigenpairs of its Laplacian.
pub struct In {
    mesh: Arc<Mesh>,
    basis: Arc<Eigenpairs>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Mesh>("mesh", "the shape, for its positions"),
        Port::one::<Eigenpairs>("basis", "eigenpairs of its Laplacian"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")?, basis: from.one("basis")? })
    }
}

/// Energy per cluster of eigenvalues and vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct Energy {
    /// Index of the first eigenpair of each cluster, ascending, from 1 (zero eigenvalues are left out).
    pub first: Vec<u32>,
    /// Mean eigenvalue of each cluster, 1 / length².
    pub lambda: Vec<f64>,
    /// Energies, a length: cluster after cluster, `vertices` entries each.
    pub values: Vec<f64>,
    /// Number of vertices.
    pub vertices: usize,
}

impl Energy {
    /// The energies of all vertices at one cluster.
    #[must_use]
    pub fn cluster(&self, c: usize) -> &[f64] {
        &self.values[c * self.vertices..(c + 1) * self.vertices]
    }
}

impl Artefact for Energy {
    const TYPE: &'static str = "energy";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Reconstruction energy `values` [clusters, n] (length) of every vertex at every cluster of \
        eigenvalues, with each cluster's `first` eigenpair and mean `lambda` (1/length²).";

    fn encode(&self, out: &mut Encoder) {
        out.u32("first", &self.first, &[self.first.len()]);
        out.f64("lambda", &self.lambda, &[self.lambda.len()]);
        out.f64("values", &self.values, &[self.first.len(), self.vertices]);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let (first, _) = from.u32("first")?;
        let (lambda, _) = from.f64("lambda")?;
        let (values, shape) = from.f64("values")?;
        if shape.len() != 2 || shape[0] != first.len() || lambda.len() != first.len() {
            return Err(FormatError(format!("energy of shape {shape:?}, {} clusters", first.len())));
        }
        Ok(Self { first, lambda, values, vertices: shape[1] })
    }

    fn json(&self) -> Value {
        let rows: Vec<&[f64]> = (0..self.first.len()).map(|c| self.cluster(c)).collect();
        json!({ "first": self.first, "lambda": self.lambda, "values": rows })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        vec![("clusters", self.first.len().to_string()), ("vertices", self.vertices.to_string())]
    }

    fn table(&self) -> Option<Table> {
        let columns: Vec<String> = self.first.iter().map(|k| format!("k{k}")).collect();
        let row = |i: usize| (0..self.first.len()).map(|c| self.cluster(c)[i].to_string()).collect();
        Some(Table { columns, rows: (0..self.vertices).map(row).collect() })
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::energies(self, other)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::energy(self)
    }
}

/// The node.
pub struct ReconstructionEnergy;

impl Node for ReconstructionEnergy {
    const KIND: &'static str = "reconstruction_energy";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How much each frequency contributes to the position of each vertex (eq. 15-18). \
        Taken over clusters of nearly equal eigenvalues, so that no choice of basis shows; zero eigenvalues are left out.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "energy":    reconstruction_energy(mesh: "mesh", basis: "basis"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Energy;

    fn run(params: &Params, In { mesh, basis }: In, cx: Context) -> Result<Energy, NodeError> {
        basis.must_belong_to(&mesh)?;
        let coefficients = coefficients(&mesh.vertices, &basis);
        let clusters = clusters(&basis.values, params.cluster);
        let n = mesh.vertices.len();
        let strength: Vec<f64> =
            clusters.iter().map(|of| of.clone().map(|k| norm2(coefficients[k])).sum::<f64>().sqrt()).collect();
        let floor = params.floor * strength.iter().fold(0.0, |a: f64, b| a.max(*b));
        let mut values = Vec::with_capacity(clusters.len() * n);
        for (of, strength) in clusters.iter().zip(&strength) {
            cx.check()?;
            if *strength <= floor {
                values.resize(values.len() + n, 0.0);
                continue;
            }
            let mut sum = vec![[0.0; 3]; n];
            for k in of.clone() {
                let c = coefficients[k];
                for (s, v) in sum.iter_mut().zip(basis.vector(k)) {
                    *s = [s[0] + v * c[0], s[1] + v * c[1], s[2] + v * c[2]];
                }
            }
            values.extend(sum.into_iter().map(|s| norm2(s).sqrt()));
        }
        let mean = |of: &std::ops::Range<usize>| basis.values[of.clone()].iter().sum::<f64>() / of.len() as f64;
        Ok(Energy {
            first: clusters.iter().map(|of| of.start as u32).collect(),
            lambda: clusters.iter().map(mean).collect(),
            values,
            vertices: n,
        })
    }
}

/// C = P' S V (eq. 15): three coefficients per eigenpair. Positions are taken relative to the centre
/// of mass, which changes no coefficient beyond the zero eigenvalues but keeps the digits of a mesh
/// far from the origin.
pub(crate) fn coefficients(positions: &[[f64; 3]], basis: &Eigenpairs) -> Vec<[f64; 3]> {
    let centre = centre_of_mass(positions, &basis.mass);
    let coefficient = |k: usize| {
        let mut c = [0.0; 3];
        for ((p, s), v) in positions.iter().zip(&basis.mass).zip(basis.vector(k)) {
            for axis in 0..3 {
                c[axis] += (p[axis] - centre[axis]) * s * v;
            }
        }
        c
    };
    (0..basis.values.len()).map(coefficient).collect()
}

/// The mean position weighted by mass.
pub(crate) fn centre_of_mass(positions: &[[f64; 3]], mass: &[f64]) -> [f64; 3] {
    let total: f64 = mass.iter().sum();
    let mut centre = [0.0; 3];
    for (p, s) in positions.iter().zip(mass) {
        for axis in 0..3 {
            centre[axis] += p[axis] * s / total;
        }
    }
    centre
}

fn norm2(v: [f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// Ranges of non-zero eigenvalues that follow each other within the relative tolerance.
fn clusters(values: &[f64], tolerance: f64) -> Vec<std::ops::Range<usize>> {
    let first = values.iter().position(|x| *x > 0.0).unwrap_or(values.len());
    let mut clusters: Vec<std::ops::Range<usize>> = Vec::new();
    for k in first..values.len() {
        match clusters.last_mut() {
            Some(last) if values[k] - values[k - 1] <= tolerance * values[k] && tolerance > 0.0 => {
                last.end = k + 1;
            }
            _ => clusters.push(k..k + 1),
        }
    }
    clusters
}
