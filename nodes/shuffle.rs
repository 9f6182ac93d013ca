//! `shuffle`: the same surface with vertices and faces renumbered at random.
//!
//! Matching two meshes that share a vertex order can look better than it is, because ties fall to the
//! same index. Shuffle one of a pair, and the truth survives in `source`.

use std::sync::Arc;

use salient_kernels::random::Random;
use salient_sdk::{Context, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Params of [`Shuffle`].
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Seed of the permutation. Default 0.
    pub seed: u64,
}

/// A mesh.
pub struct In {
    mesh: Arc<Mesh>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "the mesh to renumber")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")? })
    }
}

/// The node.
pub struct Shuffle;

impl Node for Shuffle {
    const KIND: &'static str = "shuffle";
    const VERSION: u32 = 1;
    const DOC: &'static str = "The same surface with vertices, faces and the first corner of each face renumbered at random. \
        Ground truth survives in `source`.";
    const EXAMPLE: &'static str = r#"
        "mesh":     synthesize(),
        "shuffled": shuffle(mesh: "mesh", seed: 1),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Mesh;

    fn run(params: &Params, In { mesh }: In, cx: Context) -> Result<Mesh, NodeError> {
        let mut random = Random::from_state(params.seed);
        let kept = random.permutation(mesh.vertices.len());
        let mut position = vec![0; kept.len()];
        for (new, old) in kept.iter().enumerate() {
            position[*old as usize] = new as u32;
        }
        cx.check()?;
        let order = random.permutation(mesh.faces.len());
        let face = |old: &u32| {
            let mut face = mesh.faces[*old as usize].map(|v| position[v as usize]);
            face.rotate_left(random.below(3) as usize);
            face
        };
        let faces = order.iter().map(face).collect();
        cx.check()?;
        let vertices = kept.iter().map(|old| mesh.vertices[*old as usize]).collect();
        Ok(mesh.renumbered(vertices, faces, &kept))
    }
}
