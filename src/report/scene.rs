//! What a page shows, as it is sent to it: one JSON document that names arrays ([`super::Blobs`]).
//!
//! Vertices are those of the surface as it is displayed, which for a large mesh is a simplified one; vertices of the
//! mesh itself stand beside them where people read them.

use salient_sdk::view::{Certificate, Chart, Level, Point};
use serde::Serialize;
use serde_json::Value;

use crate::compare::{Comparison, Figure, StageRow};

/// All that a page shows.
#[derive(Clone, Debug, Serialize)]
pub struct Scene {
    /// The title of the page.
    pub title: String,
    /// The graph files.
    pub graphs: Vec<String>,
    /// The program and its version.
    pub program: String,
    /// When the run began, in milliseconds since 1970.
    pub when: u64,
    /// How long it took, in seconds.
    pub seconds: f64,
    /// Whether sides are compared.
    pub compared: bool,
    /// The variants, graphs or runs; a plain run is one side.
    pub sides: Vec<SideScene>,
    /// Surfaces, each once.
    pub surfaces: Vec<Surface>,
    /// Figures of results, by side.
    pub figures: Vec<Figure>,
    /// Costs of stages, by side.
    pub stages: Vec<StageRow>,
    /// What pairs of sides differ in.
    pub differences: Vec<Value>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// A variant, a graph or a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SideScene {
    /// Its name.
    pub name: String,
    /// Its nodes, producers before consumers.
    pub nodes: Vec<NodeScene>,
    /// Addresses and nodes of results.
    pub shown: Vec<(String, usize)>,
    /// Families of functions.
    pub fields: Vec<FieldScene>,
    /// Sets of points.
    pub points: Vec<PointScene>,
    /// Correspondences.
    pub links: Vec<LinkScene>,
    /// Shapes in the order of their likeness to others.
    pub rankings: Vec<RankingScene>,
    /// Charts, each with the node that gave it.
    pub charts: Vec<ChartScene>,
}

/// A node of the graph.
#[derive(Clone, Debug, Serialize)]
pub struct NodeScene {
    /// Its address.
    pub address: String,
    /// Its kind.
    pub kind: String,
    /// Type of its output.
    #[serde(rename = "type")]
    pub output: String,
    /// `hit`, `computed`, `failed`, `skipped` or `cancelled`.
    pub outcome: &'static str,
    /// How long computing the output took, in this run or when it was done.
    pub seconds: Option<f64>,
    /// Size of its output.
    pub bytes: Option<u64>,
    /// Its key.
    pub key: Option<String>,
    /// Hash of its output.
    pub digest: Option<String>,
    /// Its typed params.
    pub params: Value,
    /// Paths of input files by param.
    pub files: Vec<(String, String)>,
    /// Wires: port, label and producing node, which may have been left out.
    pub inputs: Vec<(String, String, Option<usize>)>,
    /// What is doubtful about its output.
    pub defects: Vec<String>,
    /// Why it failed or was skipped.
    pub message: Option<String>,
    /// Why it was executed.
    pub why: Vec<String>,
    /// What its output says of itself.
    pub summary: Vec<(&'static str, String)>,
    /// The surface that it makes or rests on, in the scene's list.
    pub surface: Option<usize>,
}

/// A surface as displayed.
#[derive(Clone, Debug, Serialize)]
pub struct Surface {
    /// Address of the node that made it, on the first side that has it.
    pub name: String,
    /// Vertices displayed.
    pub vertices: usize,
    /// Faces displayed.
    pub faces: usize,
    /// Vertices and faces of the mesh.
    pub mesh: [usize; 2],
    /// Array: positions, three floats each.
    pub positions: String,
    /// Array: three vertices a face.
    pub triangles: String,
    /// Array: the mesh's vertex of each displayed one; none if they are the same.
    pub source: Option<String>,
}

/// A family of functions on a surface.
#[derive(Clone, Debug, Serialize)]
pub struct FieldScene {
    /// The node that gave it.
    pub node: usize,
    /// The surface.
    pub surface: usize,
    /// What one of them is called.
    pub name: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Whether zero is the centre of the values.
    pub signed: bool,
    /// One for each function.
    pub levels: Vec<Level>,
    /// Least and greatest value of each function.
    pub ranges: Vec<[f64; 2]>,
    /// Array: values, one `u16` each, from 0 for the least of its function to 65,535 for the greatest.
    pub values: String,
    /// Coefficients of the positions by function (eq. 15), and the centre that they are relative to.
    pub coefficients: Option<Coefficients>,
}

/// Positions taken apart into functions.
#[derive(Clone, Debug, Serialize)]
pub struct Coefficients {
    /// The mean position by mass.
    pub centre: [f64; 3],
    /// By function; zero where the eigenvalue is.
    pub of: Vec<[f64; 3]>,
}

/// A set of points on a surface.
#[derive(Clone, Debug, Serialize)]
pub struct PointScene {
    /// The node that gave it.
    pub node: usize,
    /// The surface.
    pub surface: usize,
    /// The points; vertices are those of the mesh.
    pub points: Vec<Point>,
    /// The displayed vertex of each.
    pub at: Vec<u32>,
    /// Descriptor of each; empty if there are none in this set or in those it was made from.
    pub profiles: Vec<Option<Vec<f64>>>,
    /// Why a point has no descriptor.
    pub lacking: Vec<Option<String>>,
    /// The piece of surface about each; none if there are none.
    pub regions: Option<RegionScene>,
}

/// Pieces of a surface.
#[derive(Clone, Debug, Serialize)]
pub struct RegionScene {
    /// What each looks like.
    pub kinds: Vec<&'static str>,
    /// How many vertices and faces each has.
    pub sizes: Vec<[usize; 2]>,
    /// Array: positions of one after the other.
    pub positions: String,
    /// Array: faces over each one's own vertices.
    pub triangles: String,
}

/// Correspondences between two surfaces.
#[derive(Clone, Debug, Serialize)]
pub struct LinkScene {
    /// The node that gave them.
    pub node: usize,
    /// The surfaces.
    pub surfaces: [usize; 2],
    /// The sets of points that were matched, if they are in the scene: their nodes.
    pub points: [Option<usize>; 2],
    /// The correspondence and others beside it.
    pub sets: Vec<LinkSetScene>,
    /// What is proved of the first.
    pub certificate: Option<Certificate>,
    /// The node that says how right pairs are, if there is one.
    pub judge: Option<usize>,
}

/// One correspondence.
#[derive(Clone, Debug, Serialize)]
pub struct LinkSetScene {
    /// What it is called.
    pub name: String,
    /// Value of the objective.
    pub objective: f64,
    /// The pairs.
    pub pairs: Vec<LinkPair>,
}

/// A pair.
#[derive(Clone, Debug, Serialize)]
pub struct LinkPair {
    /// Indices of the points.
    pub points: [u32; 2],
    /// Vertices of the meshes.
    pub vertices: [u32; 2],
    /// Displayed vertices.
    pub at: [u32; 2],
    /// Distance of the descriptors.
    pub distance: f64,
    /// How far it is from the truth over sqrt(area), plain and up to symmetry; none if nobody knows. An infinite distance is null.
    pub error: Option<[Option<f64>; 2]>,
}

/// Shapes in the order of their likeness to others.
#[derive(Clone, Debug, Serialize)]
pub struct RankingScene {
    /// The node that gave it.
    pub node: usize,
    /// What the order is by.
    pub measure: String,
    /// One list for each query.
    pub lists: Vec<ListScene>,
}

/// A query and the shapes that are most like it, best first.
#[derive(Clone, Debug, Serialize)]
pub struct ListScene {
    /// The query.
    pub query: Ranked,
    /// What was found.
    pub found: Vec<Ranked>,
}

/// A shape in a ranking.
#[derive(Clone, Debug, Serialize)]
pub struct Ranked {
    /// Its name.
    pub name: String,
    /// Its score; none for the query.
    pub score: Option<f64>,
    /// Its class, if anybody says.
    pub class: Option<String>,
    /// Its surface, if it is there.
    pub surface: Option<usize>,
}

/// A chart and who gave it.
#[derive(Clone, Debug, Serialize)]
pub struct ChartScene {
    /// The node that gave it.
    pub node: usize,
    /// The chart.
    #[serde(flatten)]
    pub chart: Chart,
}

/// A comparison with its causes in words.
#[must_use]
pub(super) fn difference(of: &Comparison) -> Value {
    let mut value = serde_json::to_value(of).unwrap_or_default();
    for (divergence, entry) in of.diverging.iter().zip(value["diverging"].as_array_mut().into_iter().flatten()) {
        entry["text"] = divergence.causes.iter().map(ToString::to_string).collect::<Vec<_>>().into();
    }
    value
}
