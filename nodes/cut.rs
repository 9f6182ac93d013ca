//! `cut`: a piece of a surface, for partial matching.
//!
//! The piece is the part nearest, along the surface, to the vertex that lies farthest in a given
//! direction, grown until it has the wanted share of the area.

use std::sync::Arc;

use salient_kernels::geodesic::{Geodesics, Metric};
use salient_kernels::topology;
use salient_sdk::{Context, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Params of [`Cut`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Share of the area that is kept. 0.01 to 1, default 0.6.
    #[schemars(range(min = 0.01, max = 1.0))]
    pub keep: f64,
    /// The piece grows from the vertex farthest in this direction. Default (0, 0, 1).
    pub toward: [f64; 3],
}

impl Default for Params {
    fn default() -> Self {
        Self { keep: 0.6, toward: [0.0, 0.0, 1.0] }
    }
}

/// A mesh.
pub struct In {
    mesh: Arc<Mesh>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "the whole")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")? })
    }
}

/// The node.
pub struct Cut;

impl Node for Cut {
    const KIND: &'static str = "cut";
    const VERSION: u32 = 1;
    const DOC: &'static str = "A connected piece of a surface of a given share of its area, grown along the surface from its end in one direction. \
        Ground truth survives in `source` and `reference`.";
    const EXAMPLE: &'static str = r#"
        "whole": synthesize(),
        "part":  cut(mesh: "whole", keep: 0.6, toward: (0, 0, 1)),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Mesh;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        if params.toward.iter().all(|x| *x == 0.0) {
            return vec![("toward", "the direction is zero".into())];
        }
        Vec::new()
    }

    fn run(params: &Params, In { mesh }: In, cx: Context) -> Result<Mesh, NodeError> {
        let bad = |e: &dyn std::fmt::Display| NodeError::new(format!("the mesh cannot be cut: {e}"));
        let along = |v: u32| {
            let p = mesh.vertices[v as usize];
            p[0] * params.toward[0] + p[1] * params.toward[1] + p[2] * params.toward[2]
        };
        let last =
            mesh.faces.as_flattened().iter().copied().max_by(|a, b| along(*a).total_cmp(&along(*b)).then(b.cmp(a)));
        let start = last.ok_or_else(|| NodeError::new("the mesh has no faces to cut"))?;
        let geodesics = Geodesics::new(&mesh.vertices, &mesh.faces, Metric::Unfolded).map_err(|e| bad(&e))?;
        cx.check()?;
        let distance = geodesics.search().distances(&[start]);
        cx.check()?;
        let faces = nearest_faces(&mesh, &distance, params.keep);
        cx.check()?;
        let used = topology::drop_unreferenced(&mesh.vertices, &faces).map_err(|e| bad(&e))?;
        cx.check()?;
        let piece = topology::largest_component(&used.vertices, &used.faces).map_err(|e| bad(&e))?;
        let kept: Vec<u32> = piece.source.iter().map(|v| used.source[*v as usize]).collect();
        Ok(mesh.renumbered(piece.vertices, piece.faces, &kept))
    }
}

/// The nearest faces (by their farthest corner) whose areas reach the share, in their old order.
fn nearest_faces(mesh: &Mesh, distance: &[f64], keep: f64) -> Vec<[u32; 3]> {
    let far = |f: &[u32; 3]| f.iter().map(|v| distance[*v as usize]).fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..mesh.faces.len()).collect();
    order.sort_by(|a, b| far(&mesh.faces[*a]).total_cmp(&far(&mesh.faces[*b])).then(a.cmp(b)));
    let total = mesh.area();
    let mut sum = 0.0;
    let mut kept: Vec<usize> = order
        .into_iter()
        .take_while(|f| {
            let before = sum;
            sum += mesh.face_area(&mesh.faces[*f]);
            before < keep * total && far(&mesh.faces[*f]).is_finite()
        })
        .collect();
    kept.sort_unstable();
    kept.into_iter().map(|f| mesh.faces[f]).collect()
}
