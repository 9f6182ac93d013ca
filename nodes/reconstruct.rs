//! `reconstruct`: a shape from its first eigenfunctions, P(k) = sum of V(:, j) C(:, j)' over j < k
//! (eq. 17, fig. 4).

use std::sync::Arc;

use salient_sdk::{Context, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::eigensolve::Eigenpairs;
use crate::reconstruction_energy::{centre_of_mass, coefficients};

/// Params of [`Reconstruct`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of eigenfunctions used, counted with the zero ones. At least 1, default 100.
    #[schemars(range(min = 1))]
    pub count: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { count: 100 }
    }
}

/// A mesh and the eigenpairs of its Laplacian.
pub struct In {
    mesh: Arc<Mesh>,
    basis: Arc<Eigenpairs>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Mesh>("mesh", "the shape"),
        Port::one::<Eigenpairs>("basis", "eigenpairs of its Laplacian, at least `count`"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")?, basis: from.one("basis")? })
    }
}

/// The node.
pub struct Reconstruct;

impl Node for Reconstruct {
    const KIND: &'static str = "reconstruct";
    const VERSION: u32 = 1;
    const DOC: &'static str = "The shape rebuilt from its first eigenfunctions (eq. 17, fig. 4). \
        With all of them it is the shape itself.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "smooth":    reconstruct(mesh: "mesh", basis: "basis", count: 20),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Mesh;

    fn run(params: &Params, In { mesh, basis }: In, cx: Context) -> Result<Mesh, NodeError> {
        basis.must_belong_to(&mesh)?;
        let count = params.count as usize;
        if count > basis.values.len() {
            let message = format!("`count` is {count}, but the basis has {} eigenpairs", basis.values.len());
            return Err(NodeError::new(message).help(format!("ask the eigensolve node for `pairs: {count}` or more")));
        }
        let centre = centre_of_mass(&mesh.vertices, &basis.mass);
        let mut vertices = vec![centre; mesh.vertices.len()];
        for (k, c) in coefficients(&mesh.vertices, &basis).iter().enumerate().take(count) {
            cx.check()?;
            for (p, v) in vertices.iter_mut().zip(basis.vector(k)) {
                *p = [p[0] + v * c[0], p[1] + v * c[1], p[2] + v * c[2]];
            }
        }
        Ok(Mesh { vertices, ..(*mesh).clone() })
    }
}
