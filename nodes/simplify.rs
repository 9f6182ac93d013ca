//! `simplify`: decimation to a number of vertices, by quadric error (Garland & Heckbert 1997).

use std::sync::Arc;

use salient_kernels::simplify;
use salient_sdk::{Context, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Params of [`Simplify`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of vertices to reach; a mesh with fewer stays as it is. At least 4, default 1500
    /// (the paper works on 1,000 to 1,500).
    #[schemars(range(min = 4))]
    pub vertices: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { vertices: 1500 }
    }
}

/// A mesh.
pub struct In {
    mesh: Arc<Mesh>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "the mesh to decimate")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")? })
    }
}

/// The node.
pub struct Simplify;

impl Node for Simplify {
    const KIND: &'static str = "simplify";
    const VERSION: u32 = 1;
    const DOC: &'static str = "The surface with fewer vertices, by quadric error decimation that keeps its topology. \
        `source` and ground truth are those of the nearest original vertex.";
    const EXAMPLE: &'static str = r#"
        "mesh":  synthesize(),
        "small": simplify(mesh: "mesh", vertices: 1000),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Mesh;

    fn run(params: &Params, In { mesh }: In, cx: Context) -> Result<Mesh, NodeError> {
        if mesh.vertices.len() <= params.vertices as usize {
            return Ok((*mesh).clone());
        }
        let small = simplify::simplify_until(&mesh.vertices, &mesh.faces, params.vertices as usize, &|| cx.cancelled())
            .map_err(|e| NodeError::new(format!("the mesh cannot be decimated: {e}")))?;
        cx.check()?;
        if !small.reached {
            cx.record("stopped_at_vertices", small.vertices.len());
        }
        Ok(mesh.renumbered(small.vertices, small.faces, &small.source))
    }
}
