//! `evaluate_match`: how far matches are from the ground truth, on the surface.
//!
//! The error of a match is the geodesic distance on the right shape between the matched vertex and the
//! true image of the left vertex, over the square root of the right shape's area. Up to symmetry, the
//! image of the left vertex's mirror twin counts as well.
//!
//! What the truth is, [`crate::truth`] says. A position between vertices is not rounded to one: distances to the three corners
//! of its face are interpolated.

use std::collections::BTreeMap;
use std::sync::Arc;

use salient_kernels::geodesic::Geodesics;
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::iqp_match::Match;
use crate::patch_extract::Metric;
use crate::truth::{Place, Truth};

pub use crate::truth::Mirror;

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
    /// How the distances of the error are measured: `Edges`, `Unfolded` (default), `Heat` or `Exact`.
    pub metric: Metric,
}

impl Default for Params {
    fn default() -> Self {
        Self { mirror: Mirror::Auto, reach: 0.1, metric: Metric::Unfolded }
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
    /// The error curve: share of matches within 0, 1, ... 25 %.
    pub curve: Vec<f64>,
    /// Area under the curve of the share within e, for e from 0 to 25 %, over its greatest possible value: 1 if all are exact.
    pub auc: f64,
}

/// The error of one match over sqrt(area); null where there is no true image or no path to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairError {
    /// Vertex on the left mesh.
    pub left_vertex: u32,
    /// Vertex on the right mesh.
    pub right_vertex: u32,
    /// The vertex nearest to where the left vertex truly is on the right mesh.
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
    const FORMAT: u32 = 2;
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
                let [five, ten, quarter] = [f.within_5, f.within_10, f.within_25].map(percent);
                format!("{five} within 5 %, {ten} within 10 %, {quarter} within 25 % of sqrt(area); AUC {:.2}", f.auc)
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

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::evaluation(self)
    }
}

/// The node.
pub struct EvaluateMatch;

impl Node for EvaluateMatch {
    const KIND: &'static str = "evaluate_match";
    const VERSION: u32 = 2;
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
        matched.check_vertices(&left, &right)?;
        let truth = Truth::new(&left, &right, template.as_deref(), params.mirror, params.reach)?;
        let geodesics = Geodesics::new(&right.vertices, &right.faces, params.metric.kernel())
            .map_err(|e| NodeError::new(format!("the right mesh has no geodesics: {e}")))?;
        let root = right.area().sqrt();
        let mut search = geodesics.search();
        let mut distances: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
        let mut pairs = Vec::with_capacity(matched.pairs.len());
        for p in &matched.pairs {
            cx.check()?;
            let from = distances.entry(p.right_vertex);
            let from = from.or_insert_with(|| search.distances(&[p.right_vertex]));
            let error = |place: Option<Place>| place.map(|at| at.value(from) / root).filter(|e| e.is_finite());
            let image = truth.image(p.left_vertex);
            let (plain, twin) = (error(image), error(truth.twin(p.left_vertex)));
            pairs.push(PairError {
                left_vertex: p.left_vertex,
                right_vertex: p.right_vertex,
                true_vertex: image.map(|at| at.nearest_vertex()),
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

/// Where the error curve ends.
const WORST: f64 = 0.25;

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
        curve: (0..=25).map(|percent| within(f64::from(percent) / 100.0)).collect(),
        auc: all.iter().map(|e| 1.0 - (e / WORST).min(1.0)).sum::<f64>() / all.len() as f64,
    })
}
