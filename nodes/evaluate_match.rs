//! `evaluate_match`: how far matches are from the ground truth, on the surface.
//!
//! The error of a match is the geodesic distance on the right shape between the matched vertex and the
//! true image of the left vertex, over the square root of the right shape's area. Up to symmetry, the
//! image of the left vertex's mirror twin counts as well.
//!
//! The truth is, in this order: positions on a `template` of which both meshes are poses (by vertex
//! index); the reference positions that the meshes carry; a vertex index that both meshes share.

use std::collections::BTreeMap;
use std::sync::Arc;

use salient_kernels::geodesic::{Dijkstra, Graph, Metric};
use salient_kernels::nearest::NearestVertex;
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::iqp_match::Match;

/// Which plane of the reference mirrors left to right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Mirror {
    /// The coordinate plane through the middle about which the reference is symmetric, if one is.
    Auto,
    /// No figures up to symmetry.
    Never,
    /// x changes sign.
    X,
    /// y changes sign.
    Y,
    /// z changes sign.
    Z,
}

/// Params of [`EvaluateMatch`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// The left-right symmetry of the reference: `Auto` (default), `Never`, `X`, `Y` or `Z`.
    pub mirror: Mirror,
    /// A left vertex whose reference position is farther than this from every one of the right shape, in
    /// units of the square root of its area, has no true image, and any match of it is wrong.
    /// Above 0, default 0.1.
    #[schemars(range(min = 1e-6))]
    pub reach: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self { mirror: Mirror::Auto, reach: 0.1 }
    }
}

/// A match, its two meshes, and where they have no truth of their own, a template.
pub struct In {
    matched: Arc<Match>,
    left: Arc<Mesh>,
    right: Arc<Mesh>,
    template: Option<Arc<Mesh>>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Match>("match", "the correspondence"),
        Port::one::<Mesh>("left", "the mesh of the left features"),
        Port::one::<Mesh>("right", "the mesh of the right features"),
        Port::optional::<Mesh>(
            "template",
            "a mesh with the vertex order of both, in a symmetric pose; without it the meshes' own reference positions are the truth",
        ),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self {
            matched: from.one("match")?,
            left: from.one("left")?,
            right: from.one("right")?,
            template: from.optional("template")?,
        })
    }
}

/// Shares of matches within some distances, and averages; all over sqrt(area).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Share of matches within 5 % of sqrt(area), 0 to 1.
    pub within_5: f64,
    /// Share within 10 %.
    pub within_10: f64,
    /// Share within 25 %.
    pub within_25: f64,
    /// Median error; null where half of the matches have no finite one.
    pub median: Option<f64>,
}

/// The error of one match over sqrt(area); null where there is no true image or no path to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairError {
    /// Vertex on the left mesh.
    pub left_vertex: u32,
    /// Vertex on the right mesh.
    pub right_vertex: u32,
    /// Where the left vertex truly is on the right mesh.
    pub true_vertex: Option<u32>,
    /// Error.
    pub error: Option<f64>,
    /// Error up to symmetry.
    pub error_symmetric: Option<f64>,
}

/// Accuracy of a match.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Number of matches.
    pub matched: usize,
    /// Figures as they are; null if nothing was matched.
    pub plain: Option<Figures>,
    /// Figures up to symmetry; null if nothing was matched or the reference has no symmetry.
    pub symmetric: Option<Figures>,
    /// The axis that the symmetry reverses: `X`, `Y` or `Z`; null if there is none.
    pub mirror: Option<String>,
    /// What the truth was: `template`, `reference` or `shared_index`.
    pub truth: String,
    /// Each match, in its order.
    pub pairs: Vec<PairError>,
}

impl Artefact for Evaluation {
    const TYPE: &'static str = "evaluation";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Errors of matches as geodesic distance over sqrt(area): shares within 5, 10 and 25 %, plain and up to the \
        left-right symmetry, and the error of each pair.";

    fn encode(&self, out: &mut Encoder) {
        out.header("evaluation", self);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        from.header("evaluation")
    }

    fn json(&self) -> Value {
        json!(self)
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let percent = |x: f64| format!("{:.0} %", 100.0 * x);
        let line = |f: &Option<Figures>, why: &str| match f {
            Some(f) => {
                format!("{} within 5 %, {} within 10 % of sqrt(area)", percent(f.within_5), percent(f.within_10))
            }
            None => why.to_owned(),
        };
        vec![
            ("matches", self.matched.to_string()),
            ("right", line(&self.plain, "nothing was matched")),
            (
                "up to symmetry",
                line(
                    &self.symmetric,
                    if self.mirror.is_some() { "nothing was matched" } else { "no symmetry is known" },
                ),
            ),
        ]
    }

    fn table(&self) -> Option<Table> {
        let number = |x: &Option<f64>| x.map_or(String::new(), |x| x.to_string());
        let row = |p: &PairError| {
            vec![
                p.left_vertex.to_string(),
                p.right_vertex.to_string(),
                p.true_vertex.map_or(String::new(), |v| v.to_string()),
                number(&p.error),
                number(&p.error_symmetric),
            ]
        };
        let columns = ["left_vertex", "right_vertex", "true_vertex", "error", "error_symmetric"];
        Some(Table::new(&columns, self.pairs.iter().map(row).collect()))
    }

    fn differences(&self, other: &Self, _: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::evaluations(self, other)
    }
}

/// The node.
pub struct EvaluateMatch;

impl Node for EvaluateMatch {
    const KIND: &'static str = "evaluate_match";
    const VERSION: u32 = 1;
    const DOC: &'static str = "How far matches are from the ground truth: geodesic error over sqrt(area), plain and up to the left-right symmetry.";
    const EXAMPLE: &'static str = r#"
        "a":        synthesize(pose: 0),
        "b":        synthesize(pose: 1),
        "fa":       graph(file: "salient_features.ron", mesh: "a"),
        "fb":       graph(file: "salient_features.ron", mesh: "b"),
        "match":    iqp_match(left: "fa", right: "fb"),
        "accuracy": evaluate_match(match: "match", left: "a", right: "b"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Evaluation;

    fn run(params: &Params, inputs: In, cx: Context) -> Result<Evaluation, NodeError> {
        let In { matched, left, right, template } = inputs;
        check_vertices(&matched, &left, &right)?;
        let truth = Truth::new(&left, &right, template.as_deref(), params)?;
        let graph = Graph::new(&right.vertices, &right.faces, Metric::Unfolded)
            .map_err(|e| NodeError::new(format!("the right mesh has no geodesics: {e}")))?;
        let root = right.area().sqrt();
        let mut dijkstra = Dijkstra::new();
        let mut pairs = Vec::with_capacity(matched.pairs.len());
        for p in &matched.pairs {
            cx.check()?;
            let distances = dijkstra.distances(&graph, &[p.right_vertex]);
            let error = |v: Option<u32>| v.map(|v| distances[v as usize] / root).filter(|e| e.is_finite());
            let true_vertex = truth.image(p.left_vertex);
            let (plain, twin) = (error(true_vertex), error(truth.twin(p.left_vertex)));
            pairs.push(PairError {
                left_vertex: p.left_vertex,
                right_vertex: p.right_vertex,
                true_vertex,
                error: plain,
                error_symmetric: [plain, twin].into_iter().flatten().min_by(f64::total_cmp),
            });
        }
        Ok(Evaluation {
            matched: pairs.len(),
            plain: figures(pairs.iter().map(|p| p.error)),
            symmetric: truth.mirror().and_then(|_| figures(pairs.iter().map(|p| p.error_symmetric))),
            mirror: truth.mirror().map(|axis| ["X", "Y", "Z"][axis].to_owned()),
            truth: truth.name().into(),
            pairs,
        })
    }
}

fn check_vertices(matched: &Match, left: &Mesh, right: &Mesh) -> Result<(), NodeError> {
    for p in &matched.pairs {
        for (side, vertex, mesh) in [("left", p.left_vertex, left), ("right", p.right_vertex, right)] {
            let n = mesh.vertices.len();
            if vertex as usize >= n {
                let message = format!("a match names {side} vertex {vertex}, but that mesh has {n}");
                return Err(
                    NodeError::new(message).help(format!("wire `{side}` to the mesh whose features were matched"))
                );
            }
        }
    }
    Ok(())
}

fn figures(errors: impl Iterator<Item = Option<f64>>) -> Option<Figures> {
    let mut all: Vec<f64> = errors.map(|e| e.unwrap_or(f64::INFINITY)).collect();
    if all.is_empty() {
        return None;
    }
    all.sort_by(f64::total_cmp);
    let within = |limit: f64| all.partition_point(|e| *e <= limit) as f64 / all.len() as f64;
    let middle = 0.5 * (all[(all.len() - 1) / 2] + all[all.len() / 2]);
    Some(Figures {
        within_5: within(0.05),
        within_10: within(0.1),
        within_25: within(0.25),
        median: middle.is_finite().then_some(middle),
    })
}

/// Where left vertices are on the right mesh.
enum Truth {
    /// Equal vertex index.
    Shared(Vec<Option<u32>>),
    /// Nearest reference position.
    Reference(Box<References>),
}

struct References {
    name: &'static str,
    left: Vec<[f64; 3]>,
    nearest: NearestVertex,
    reach: f64,
    /// Axis and the coordinate of the plane of symmetry.
    mirror: Option<(usize, f64)>,
}

impl Truth {
    fn new(left: &Mesh, right: &Mesh, template: Option<&Mesh>, params: &Params) -> Result<Self, NodeError> {
        let (name, left, references) = match (template, &left.reference, &right.reference) {
            (Some(t), ..) => ("template", on_template(left, t, "left")?, on_template(right, t, "right")?),
            (None, Some(l), Some(r)) => ("reference", l.clone(), r.clone()),
            (None, ..) => return shared(left, right),
        };
        let nearest = NearestVertex::new(&references);
        let mirror = mirror(&references, &nearest, params.mirror);
        let reach = params.reach * right.area().sqrt();
        Ok(Self::Reference(Box::new(References { name, left, nearest, reach, mirror })))
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Shared(_) => "shared_index",
            Self::Reference(r) => r.name,
        }
    }

    fn image(&self, left: u32) -> Option<u32> {
        match self {
            Self::Shared(images) => images[left as usize],
            Self::Reference(r) => r.at(r.left[left as usize]),
        }
    }

    /// The image of the left vertex's mirror twin.
    fn twin(&self, left: u32) -> Option<u32> {
        let Self::Reference(r) = self else { return None };
        r.at(reflected(r.left[left as usize], r.mirror?))
    }

    fn mirror(&self) -> Option<usize> {
        let Self::Reference(r) = self else { return None };
        r.mirror.map(|(axis, _)| axis)
    }
}

impl References {
    fn at(&self, point: [f64; 3]) -> Option<u32> {
        self.nearest.nearest(point).filter(|(_, d)| *d <= self.reach).map(|(v, _)| v)
    }
}

fn reflected(mut p: [f64; 3], (axis, plane): (usize, f64)) -> [f64; 3] {
    p[axis] = 2.0 * plane - p[axis];
    p
}

/// The index that a vertex had in the file.
fn identity(mesh: &Mesh, vertex: usize) -> u32 {
    mesh.source.as_ref().map_or(vertex as u32, |s| s[vertex])
}

fn on_template(mesh: &Mesh, template: &Mesh, side: &str) -> Result<Vec<[f64; 3]>, NodeError> {
    let at = |vertex: usize| {
        let index = identity(mesh, vertex);
        template.vertices.get(index as usize).copied().ok_or_else(|| {
            NodeError::new(format!(
                "{side} vertex {vertex} is vertex {index} of its original, but the template has {}",
                template.vertices.len()
            ))
        })
    };
    (0..mesh.vertices.len()).map(at).collect()
}

fn shared(left: &Mesh, right: &Mesh) -> Result<Truth, NodeError> {
    let (l, r) = (left.vertices.len(), right.vertices.len());
    if l != r && left.source.is_none() && right.source.is_none() {
        return Err(NodeError::new(format!(
            "no ground truth: the meshes carry no reference positions, and {l} and {r} vertices share no index"
        ))
        .help("wire `template`, or match meshes that share their vertex order"));
    }
    let images: BTreeMap<u32, u32> = (0..r).rev().map(|j| (identity(right, j), j as u32)).collect();
    let image = |i| images.get(&identity(left, i)).copied();
    Ok(Truth::Shared((0..l).map(image).collect()))
}

/// A reference counts as symmetric if the median distance from mirrored vertices to the nearest one is
/// below this share of its bounding box's diagonal.
const SYMMETRIC: f64 = 0.01;

fn mirror(points: &[[f64; 3]], nearest: &NearestVertex, wanted: Mirror) -> Option<(usize, f64)> {
    let extent = |axis: usize| {
        let coordinates = points.iter().map(|p| p[axis]);
        let low = coordinates.clone().fold(f64::INFINITY, f64::min);
        (low, coordinates.fold(f64::NEG_INFINITY, f64::max))
    };
    let extents = [extent(0), extent(1), extent(2)];
    let plane = |axis: usize| (axis, 0.5 * (extents[axis].0 + extents[axis].1));
    let diagonal = extents.iter().map(|(low, high)| (high - low).powi(2)).sum::<f64>().sqrt();
    let asymmetry = |axis: usize| {
        let distance = |p: &[f64; 3]| nearest.nearest(reflected(*p, plane(axis))).map(|(_, d)| d);
        let mut all: Vec<f64> = points.iter().filter_map(distance).collect();
        let middle = all.len() / 2;
        if all.is_empty() { f64::INFINITY } else { *all.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    match wanted {
        Mirror::Never => None,
        Mirror::X => Some(plane(0)),
        Mirror::Y => Some(plane(1)),
        Mirror::Z => Some(plane(2)),
        Mirror::Auto => (0..3)
            .map(|axis| (axis, asymmetry(axis)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(_, a)| *a <= SYMMETRIC * diagonal)
            .map(|(axis, _)| plane(axis)),
    }
}
