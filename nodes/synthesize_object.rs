//! `synthesize_object`: an individual of one of 20 families, for databases to try retrieval on.

use salient_kernels::object::{self, families};
use salient_sdk::{Context, Mesh, Node, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Params of [`SynthesizeObject`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Family and individual, such as `chair-3`. Families: airplane, ant, armadillo, bearing, bird, bust, chair, cup, fish, fourleg, glasses,
    /// hand, human, mechanic, octopus, plier, spring, table, teddy, vase. Required.
    pub model: String,
    /// Number of vertices, about. 300 to 200,000, default 4000.
    #[serde(default = "vertices")]
    #[schemars(range(min = 300, max = 200_000))]
    pub vertices: u32,
    /// Individuals have their own number of vertices: up to this many times fewer. 1 to 100, default 1.
    #[serde(default = "spread")]
    #[schemars(range(min = 1.0, max = 100.0))]
    pub spread: f64,
}

fn vertices() -> u32 {
    4000
}

fn spread() -> f64 {
    1.0
}

/// The node.
pub struct SynthesizeObject;

impl Node for SynthesizeObject {
    const KIND: &'static str = "synthesize_object";
    const VERSION: u32 = 1;
    const DOC: &'static str = "An individual of one of 20 families of objects, articulated and rigid, with proportions, pose and details of its own: a closed \
        mesh in no particular orientation, size or order of vertices.";
    const EXAMPLE: &'static str = r#"
        "chair": synthesize_object(model: "chair-3"),
    "#;
    type Params = Params;
    type Inputs = ();
    type Output = Mesh;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        parse(&params.model).err().map(|message| ("model", message)).into_iter().collect()
    }

    fn run(params: &Params, (): (), _: Context) -> Result<Mesh, NodeError> {
        let (family, seed) = parse(&params.model).map_err(NodeError::new)?;
        // The golden ratio's multiples are spread evenly, whatever the number of individuals.
        let share = (seed as f64 * 0.618_033_988_749_894_9).fract();
        let vertices = (f64::from(params.vertices) * params.spread.powf(-share)).max(300.0) as usize;
        let made = object::generate(family, seed, vertices).map_err(|e| NodeError::new(e.to_string()))?;
        Ok(Mesh { vertices: made.vertices, faces: made.faces, ..Mesh::default() })
    }
}

fn parse(model: &str) -> Result<(&str, u64), String> {
    let parts = model.split_once('-').and_then(|(family, seed)| Some((family, seed.parse().ok()?)));
    match parts {
        Some((family, seed)) if families().contains(&family) => Ok((family, seed)),
        _ => Err(format!(
            "`{model}` is not a family and a number, such as `chair-3`; families: {}",
            families().join(", ")
        )),
    }
}
