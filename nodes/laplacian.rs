//! `laplacian`: cotangent stiffness M and diagonal mass S of a mesh (eq. 7-10), for M v = lambda S v.
//!
//! M is positive semidefinite: M(i, j) = -(cot a + cot b) / 2 over the angles opposite the edge, and
//! its rows sum to zero. S holds Meyer's mixed area of each vertex, which unlike the plain Voronoi
//! area stays positive on obtuse triangles; the masses sum to the area of the surface.

use std::sync::Arc;

use salient_kernels::laplacian::{self, LaplacianError, Operator as Matrices};
use salient_kernels::sparse::SymmetricCsr;
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// How a triangle's area is shared among its corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Area {
    /// Meyer's mixed Voronoi area.
    Mixed,
    /// A third of each incident triangle.
    Barycentric,
}

impl From<Area> for laplacian::Area {
    fn from(area: Area) -> Self {
        match area {
            Area::Mixed => Self::Mixed,
            Area::Barycentric => Self::Barycentric,
        }
    }
}

/// Params of [`Laplacian`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Area of a vertex: `Mixed` (Meyer et al. 2003; default) or `Barycentric`.
    pub area: Area,
    /// Use the intrinsic Delaunay triangulation of the same surface, whose weights are never negative
    /// (Bobenko & Springborn 2007). Needs a manifold mesh. Default false, as in the paper.
    pub intrinsic_delaunay: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self { area: Area::Mixed, intrinsic_delaunay: false }
    }
}

/// A mesh.
pub struct In {
    mesh: Arc<Mesh>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "the surface")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")? })
    }
}

/// The Laplacian's matrices.
#[derive(Clone, Debug, PartialEq)]
pub struct Operator(pub Matrices);

impl Artefact for Operator {
    const TYPE: &'static str = "operator";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "The generalised eigenproblem M v = lambda S v: symmetric stiffness M in CSR (`offsets` [n+1], \
        `columns` and `stiffness` [nonzeros], both triangles, no unit) and diagonal `mass` [n] (area).";

    fn encode(&self, out: &mut Encoder) {
        let m = &self.0.stiffness;
        let offsets: Vec<u32> = m.offsets().iter().map(|o| *o as u32).collect();
        out.u32("offsets", &offsets, &[offsets.len()]);
        out.u32("columns", m.columns(), &[m.columns().len()]);
        out.f64("stiffness", m.values(), &[m.values().len()]);
        out.f64("mass", &self.0.mass, &[self.0.mass.len()]);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let offsets = from.u32("offsets")?.0.into_iter().map(|o| o as usize).collect();
        let (columns, _) = from.u32("columns")?;
        let (values, _) = from.f64("stiffness")?;
        let (mass, _) = from.f64("mass")?;
        let stiffness = SymmetricCsr::from_parts(offsets, columns, values).map_err(|e| FormatError(e.to_string()))?;
        if stiffness.n() != mass.len() {
            return Err(FormatError(format!("{} rows, {} masses", stiffness.n(), mass.len())));
        }
        Ok(Self(Matrices { stiffness, mass }))
    }

    fn json(&self) -> Value {
        let m = &self.0.stiffness;
        json!({
            "offsets": m.offsets(),
            "columns": m.columns(),
            "stiffness": m.values(),
            "mass": self.0.mass,
            "area": self.0.area(),
        })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        vec![
            ("rows", self.0.mass.len().to_string()),
            ("nonzeros", self.0.stiffness.values().len().to_string()),
            ("area", format!("{:.6}", self.0.area())),
        ]
    }

    fn table(&self) -> Option<Table> {
        let m = &self.0.stiffness;
        let entry = |i: usize| {
            let line = move |(j, x): (usize, f64)| vec![i.to_string(), j.to_string(), x.to_string()];
            m.row(i).map(line)
        };
        Some(Table::new(&["row", "column", "stiffness"], (0..m.n()).flat_map(entry).collect()))
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::operators(self, other)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::operator(self)
    }
}

/// The node.
pub struct Laplacian;

impl Node for Laplacian {
    const KIND: &'static str = "laplacian";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Cotangent stiffness and diagonal mass of a mesh (eq. 7-10). \
        Symmetric, rows sum to zero, masses positive and summing to the area.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh", area: Mixed),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Operator;

    fn run(params: &Params, In { mesh }: In, _: Context) -> Result<Operator, NodeError> {
        let area = params.area.into();
        let matrices = laplacian::laplacian(&mesh.vertices, &mesh.faces, area, params.intrinsic_delaunay)
            .map_err(|e| explain(&e))?;
        Ok(Operator(matrices))
    }
}

/// What is wrong with the mesh, and which repair mends it.
fn explain(e: &LaplacianError) -> NodeError {
    let error = NodeError::new(format!("the mesh has no Laplacian: {e}"));
    match e {
        LaplacianError::ZeroAreaFace { .. } | LaplacianError::RepeatedVertex { .. } => error
            .help("add `drop_degenerate: true, drop_unreferenced: true` to the mesh's `load`, which removes all faces without area, and vertices that only they had"),
        LaplacianError::UnreferencedVertex { .. } => {
            error.help("add `drop_unreferenced: true` to the mesh's `load`, which removes all vertices without a face")
        }
        LaplacianError::NonManifoldEdge { .. } | LaplacianError::NotOrientable { .. } => {
            error.help("`intrinsic_delaunay: false` works on such a mesh")
        }
        LaplacianError::NotPositive { .. } | LaplacianError::DelaunayStalled { .. } => {
            error.help("scale the mesh to ordinary units, and mend triangles that are needles")
        }
        _ => error,
    }
}
