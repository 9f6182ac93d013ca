//! `synthesize`: an articulated creature in a pose, meshed on its own, with ground truth.
//!
//! The creature is an implicit surface about a skeleton. Each pose has its own triangulation, and every
//! vertex carries the point of the rest pose that it shows: `reference`. At rest the creature is
//! symmetric in x.

use salient_kernels::creature::{self, CreatureError, CreatureParams};
use salient_sdk::{Context, Mesh, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Proportions of a creature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Species {
    /// Long tail, short neck.
    Cat,
    /// Long legs and neck.
    Horse,
    /// Stout.
    Bear,
    /// Very long neck.
    Giraffe,
    /// Low, with a long tail.
    Lizard,
}

impl From<Species> for creature::Species {
    fn from(species: Species) -> Self {
        match species {
            Species::Cat => Self::Cat,
            Species::Horse => Self::Horse,
            Species::Bear => Self::Bear,
            Species::Giraffe => Self::Giraffe,
            Species::Lizard => Self::Lizard,
        }
    }
}

/// Params of [`Synthesize`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Proportions: `Cat` (default), `Horse`, `Bear`, `Giraffe` or `Lizard`.
    pub species: Species,
    /// Individual of the species: varies its proportions. Default 0.
    pub seed: u64,
    /// Joint angles: 0 (default) is rest, any other number a pose of its own.
    pub pose: u32,
    /// Number of vertices. 400 to 200,000, default 2000.
    #[schemars(range(min = 400, max = 200_000))]
    pub vertices: u32,
    /// Triangulation: another number meshes the same surface anew. Poses differ in theirs anyway. Default 0.
    pub triangulation: u64,
}

impl Default for Params {
    fn default() -> Self {
        Self { species: Species::Cat, seed: 0, pose: 0, vertices: 2000, triangulation: 0 }
    }
}

/// The node.
pub struct Synthesize;

impl Node for Synthesize {
    const KIND: &'static str = "synthesize";
    const VERSION: u32 = 1;
    const DOC: &'static str = "An articulated creature in a pose, meshed on its own, every vertex with its rest position as ground truth. \
        Closed, genus 0, and symmetric in x at rest; its torso is about one unit long.";
    const EXAMPLE: &'static str = r#"
        "rest":   synthesize(species: Cat),
        "moving": synthesize(species: Cat, pose: 1),
    "#;
    type Params = Params;
    type Inputs = ();
    type Output = Mesh;

    fn run(params: &Params, (): (), cx: Context) -> Result<Mesh, NodeError> {
        let wanted = CreatureParams {
            species: params.species.into(),
            seed: params.seed,
            pose: params.pose,
            vertices: params.vertices as usize,
            triangulation: params.triangulation,
        };
        let made = creature::generate_until(&wanted, &|| cx.cancelled()).map_err(|e| match e {
            CreatureError::Cancelled => NodeError::cancelled(),
            e => NodeError::new(e.to_string()),
        })?;
        Ok(Mesh { vertices: made.vertices, faces: made.faces, reference: Some(made.rest), ..Mesh::default() })
    }
}
