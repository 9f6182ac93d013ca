//! `eigensolve`: the smallest eigenpairs of M v = lambda S v (eq. 10), ascending, with V' S V = I.
//!
//! lambda_0 = 0 occurs once per connected component. The pairs are certified: residuals and
//! orthogonality are small, and the number of eigenvalues below a cut just above the last pair, counted
//! by Sylvester's law of inertia from a factorisation of M - theta S, equals what was found.

use std::fs::File;
use std::io;
use std::sync::Arc;

use salient_kernels::eigen::{self, EigenError, Hooks, Method, Options};
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::laplacian::Operator;

/// Params of [`Eigensolve`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of eigenpairs, counted with the zero ones; at most the number of vertices.
    /// At least 1, default 100 as in the paper.
    #[schemars(range(min = 1))]
    pub pairs: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { pairs: 100 }
    }
}

/// The matrices of the eigenproblem.
pub struct In {
    operator: Arc<Operator>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Operator>("operator", "stiffness and mass of the shape")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { operator: from.one("operator")? })
    }
}

/// The evidence that the pairs are the smallest, all of them, and accurate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// `dense` or `lanczos`.
    pub method: String,
    /// A cut in a gap of the spectrum above the last pair, 1 / length².
    pub cut: f64,
    /// Eigenvalues below the cut by Sylvester inertia.
    pub expected: usize,
    /// Eigenvalues found below the cut; equal to `expected`.
    pub found: usize,
    /// Largest residual in the S^-1 norm, relative to lambda.
    pub max_residual: f64,
    /// Largest entry of |V' S V - I|.
    pub max_orthogonality_error: f64,
}

/// Certified eigenpairs.
#[derive(Clone, Debug, PartialEq)]
pub struct Eigenpairs {
    /// Eigenvalues, ascending, 1 / length²; exactly 0 once per component.
    pub values: Vec<f64>,
    /// Eigenvectors, one after the other, `mass.len()` entries each, 1 / length.
    pub vectors: Vec<f64>,
    /// The diagonal of S, an area per vertex.
    pub mass: Vec<f64>,
    /// Why they may be trusted.
    pub certificate: Certificate,
}

impl Eigenpairs {
    /// Eigenvector `k`.
    #[must_use]
    pub fn vector(&self, k: usize) -> &[f64] {
        let n = self.mass.len();
        &self.vectors[k * n..(k + 1) * n]
    }

    /// Refuses a mesh of another size: wires to a basis and a mesh of different shapes.
    pub fn must_belong_to(&self, mesh: &Mesh) -> Result<(), NodeError> {
        let (n, m) = (self.mass.len(), mesh.vertices.len());
        if n == m {
            return Ok(());
        }
        Err(NodeError::new(format!("the basis has {n} vertices, but the mesh has {m}"))
            .help("wire `basis` to the eigenpairs of the same mesh"))
    }
}

impl Artefact for Eigenpairs {
    const TYPE: &'static str = "eigenpairs";
    const FORMAT: u32 = 1;
    const PLACE: salient_sdk::Place = salient_sdk::Place::OnSurface;
    const DOC: &'static str = "Eigenpairs of M v = lambda S v: `values` [k] (1/length²), `vectors` [k, n] (row j is eigenvector j; \
        V' S V = I), the diagonal `mass` [n] of S (area), and the certificate.";

    fn encode(&self, out: &mut Encoder) {
        out.f64("values", &self.values, &[self.values.len()]);
        out.f64("vectors", &self.vectors, &[self.values.len(), self.mass.len()]);
        out.f64("mass", &self.mass, &[self.mass.len()]);
        out.header("certificate", &self.certificate);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let (values, _) = from.f64("values")?;
        let (vectors, shape) = from.f64("vectors")?;
        let (mass, _) = from.f64("mass")?;
        if shape != [values.len(), mass.len()] {
            return Err(FormatError(format!(
                "vectors of shape {shape:?} for {} values and {} vertices",
                values.len(),
                mass.len()
            )));
        }
        Ok(Self { values, vectors, mass, certificate: from.header("certificate")? })
    }

    fn json(&self) -> Value {
        json!({ "values": self.values, "certificate": self.certificate })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let last = self.values.last().copied().unwrap_or_default();
        let c = &self.certificate;
        vec![
            ("eigenpairs", self.values.len().to_string()),
            ("largest", format!("{last:.6e}")),
            ("certificate", format!("{} found, {} by inertia", c.found, c.expected)),
            ("residual", format!("{:.1e}", c.max_residual)),
        ]
    }

    fn table(&self) -> Option<Table> {
        let row = |(k, x): (usize, &f64)| vec![k.to_string(), x.to_string()];
        Some(Table::new(&["k", "lambda"], self.values.iter().enumerate().map(row).collect()))
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::eigenpairs(self, other)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::eigenpairs(self)
    }
}

/// The node.
pub struct Eigensolve;

impl Node for Eigensolve {
    const KIND: &'static str = "eigensolve";
    const VERSION: u32 = 10;
    const DOC: &'static str = "The smallest eigenpairs of M v = lambda S v, certified by inertia (eq. 10). \
        Shift-invert block Lanczos; dense for small meshes. It fails rather than return a wrong basis.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Eigenpairs;

    fn run(params: &Params, In { operator }: In, cx: Context) -> Result<Eigenpairs, NodeError> {
        let found = eigen::eigenpairs(&operator.0, params.pairs as usize, &Options::default(), &ContextHooks(cx))
            .map_err(|e| explain(&e))?;
        cx.record("rounds", found.certificate.rounds);
        let c = found.certificate;
        let method = match c.method {
            Method::Dense => "dense",
            Method::Lanczos => "lanczos",
        };
        Ok(Eigenpairs {
            values: found.values,
            vectors: found.vectors,
            mass: operator.0.mass.clone(),
            certificate: Certificate {
                method: method.into(),
                cut: c.cut,
                expected: c.expected,
                found: c.found,
                max_residual: c.max_residual,
                max_orthogonality_error: c.max_orthogonality_error,
            },
        })
    }
}

fn explain(e: &EigenError) -> NodeError {
    match e {
        EigenError::Cancelled => NodeError::cancelled(),
        EigenError::TooMany { available, .. } => {
            NodeError::new(e.to_string()).help(format!("ask for `pairs: {available}` or fewer"))
        }
        EigenError::Scratch { .. } => NodeError::passing(e.to_string())
            .help("it is in the cache's directory: free space there, or name another with --cache"),
        _ => NodeError::new(e.to_string()),
    }
}

/// Progress and cancellation of a kernel, through the node's context.
pub(crate) struct ContextHooks<'a>(pub Context<'a>);

impl Hooks for ContextHooks<'_> {
    fn progress(&self, fraction: f64) {
        self.0.progress(fraction);
    }
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
    fn scratch(&self) -> io::Result<Option<File>> {
        self.0.scratch()
    }
    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        // Tasks that are left out are noticed by the kernel.
        self.0.each(count, task);
    }
}
