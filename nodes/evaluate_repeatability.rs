//! `evaluate_repeatability`: which share of one shape's best features the other shape has as well.
//!
//! The first N features of the left shape repeat *in position* if one of the right shape's first N lies within a distance (a
//! share of the square root of the area) of where they truly are, and *in position and scale* if such a one also has
//! the same scale up to a factor. The same is asked from right to left, and the two are averaged. Features whose true place the
//! other shape does not have, such as on a part that was cut off, are not counted.
//!
//! Many features on a small shape are near to everything. So beside each share stands the **chance level**: what
//! points thrown evenly on the surface, with the same scales, would reach. It is exact: the share of area within reach of
//! the other's features. Over *all* maxima, both are 1 and say nothing; that is refused.

use std::sync::Arc;

use salient_kernels::geodesic::{Dijkstra, Graph};
use salient_sdk::{Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::feature::Feature;
use crate::patch_spectrum::Features;
use crate::truth::{Mirror, Place, Truth};

/// Params of [`EvaluateRepeatability`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// How many features of each shape are compared, the first ones. At least 1, default 50.
    #[schemars(range(min = 1))]
    pub top: u32,
    /// Within this of the true place counts as repeated, over sqrt(area). Above 0 to 1, default 0.1.
    #[schemars(range(min = 1e-6, max = 1.0))]
    pub distance: f64,
    /// Scales, over sqrt(area), that differ by no more than this factor are the same. At least 1, default 1.25.
    #[schemars(range(min = 1.0, max = 100.0))]
    pub factor: f64,
    /// The left-right symmetry of the reference: `Auto` (default), `Never`, `X`, `Y` or `Z`.
    pub mirror: Mirror,
    /// A place farther than this from the other shape's reference surface, over sqrt(area), is not on it. Above 0, default 0.1.
    #[schemars(range(min = 1e-6))]
    pub reach: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self { top: 50, distance: 0.1, factor: 1.25, mirror: Mirror::Auto, reach: 0.1 }
    }
}

/// Two shapes with their features, and where they have no truth of their own, a template.
pub struct In {
    features: [Arc<Features>; 2],
    meshes: [Arc<Mesh>; 2],
    template: Option<Arc<Mesh>>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Features>("left", "features of the first shape, best first"),
        Port::one::<Features>("right", "features of the second shape, best first"),
        Port::one::<Mesh>("left_mesh", "the mesh of the left features"),
        Port::one::<Mesh>("right_mesh", "the mesh of the right features"),
        Port::optional::<Mesh>(
            "template",
            "a mesh with the vertex order of both, in a symmetric pose; without it the meshes' own reference positions are the truth",
        ),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self {
            features: [from.one("left")?, from.one("right")?],
            meshes: [from.one("left_mesh")?, from.one("right_mesh")?],
            template: from.optional("template")?,
        })
    }
}

/// A share and what chance would give, both 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Share of features that repeat.
    pub repeated: f64,
    /// The same for points thrown evenly on the surface.
    pub chance: f64,
}

/// How well features repeat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Repeatability {
    /// Features compared, of each shape.
    pub top: [usize; 2],
    /// Those whose true place the other shape has.
    pub common: [usize; 2],
    /// In position.
    pub position: Share,
    /// In position and scale.
    pub position_scale: Share,
    /// In position, the mirror twin's place counting as well; null without a symmetry. Chance is as for `position`, at most doubled.
    pub position_symmetric: Option<f64>,
    /// In position and scale, the mirror twin's place counting as well; null without a symmetry.
    pub position_scale_symmetric: Option<f64>,
    /// Distance over sqrt(area) that counts as the same place.
    pub distance: f64,
    /// Factor between scales that count as the same.
    pub factor: f64,
    /// What the truth was: `template`, `reference` or `shared_index`.
    pub truth: String,
}

impl Artefact for Repeatability {
    const TYPE: &'static str = "repeatability";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "The share of two shapes' best features that repeat, in position and in position and scale, with the chance \
        level beside each.";

    fn encode(&self, out: &mut Encoder) {
        out.header("repeatability", self);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        from.header("repeatability")
    }

    fn json(&self) -> Value {
        json!(self)
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let line = |s: &Share| format!("{:.2} (chance {:.2})", s.repeated, s.chance);
        let mut lines = vec![
            ("features", format!("{} and {}", self.top[0], self.top[1])),
            ("position", format!("{} within {} sqrt(area)", line(&self.position), self.distance)),
            ("position and scale", format!("{} up to a factor {}", line(&self.position_scale), self.factor)),
        ];
        if let (Some(p), Some(s)) = (self.position_symmetric, self.position_scale_symmetric) {
            lines.push(("up to symmetry", format!("{p:.2} and {s:.2}")));
        }
        lines
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::repeatability(self)
    }
}

/// The node.
pub struct EvaluateRepeatability;

impl Node for EvaluateRepeatability {
    const KIND: &'static str = "evaluate_repeatability";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Which share of two shapes' best features lie at the same true place (and scale), with the chance level beside it. \
        Refuses so many features that chance alone would reach nearly all.";
    const EXAMPLE: &'static str = r#"
        "a":      synthesize(pose: 0),
        "b":      synthesize(pose: 1),
        "fa":     graph(file: "salient_features.ron", mesh: "a"),
        "fb":     graph(file: "salient_features.ron", mesh: "b"),
        "repeat": evaluate_repeatability(left: "fa", right: "fb", left_mesh: "a", right_mesh: "b", top: 50),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Repeatability;

    fn run(params: &Params, In { features, meshes, template }: In, cx: Context) -> Result<Repeatability, NodeError> {
        let top = params.top as usize;
        let shapes = [
            Shape::new(&features[0], &meshes[0], top, "left", cx)?,
            Shape::new(&features[1], &meshes[1], top, "right", cx)?,
        ];
        let truth = |from: usize, to: usize| {
            Truth::new(&meshes[from], &meshes[to], template.as_deref(), params.mirror, params.reach)
        };
        let truths = [truth(0, 1)?, truth(1, 0)?];
        let ways = [
            direction(&shapes[0], &shapes[1], &truths[0], params, cx)?,
            direction(&shapes[1], &shapes[0], &truths[1], params, cx)?,
        ];
        if ways[0].common + ways[1].common == 0 {
            return Err(NodeError::new("no feature has a true place on the other shape"));
        }
        let sum = |of: fn(&Way) -> f64| (of(&ways[0]) + of(&ways[1])) / (ways[0].common + ways[1].common) as f64;
        let position = Share { repeated: sum(|w| w.position[0]), chance: sum(|w| w.chance[0]) };
        if position.chance > SATURATED {
            let message = format!(
                "{} and {} features lie within {} of {:.0} % of the surface: any points would repeat",
                shapes[0].features.len(),
                shapes[1].features.len(),
                params.distance,
                100.0 * position.chance
            );
            return Err(NodeError::new(message).help("compare fewer features (`top`) or a smaller `distance`"));
        }
        let symmetric = truths[0].mirror().is_some() && truths[1].mirror().is_some();
        Ok(Repeatability {
            top: [shapes[0].features.len(), shapes[1].features.len()],
            common: [ways[0].common, ways[1].common],
            position,
            position_scale: Share { repeated: sum(|w| w.position[1]), chance: sum(|w| w.chance[1]) },
            position_symmetric: symmetric.then(|| sum(|w| w.symmetric[0])),
            position_scale_symmetric: symmetric.then(|| sum(|w| w.symmetric[1])),
            distance: params.distance,
            factor: params.factor,
            truth: truths[0].name().into(),
        })
    }
}

/// A chance level above this leaves nothing to measure.
const SATURATED: f64 = 0.9;

struct Shape<'a> {
    features: &'a [Feature],
    root: f64,
    /// Distance of each vertex from each feature, over sqrt(area).
    fields: Vec<Vec<f64>>,
    /// Share of the area at each vertex: a third of each of its faces.
    mass: Vec<f64>,
}

impl<'a> Shape<'a> {
    fn new(of: &'a Features, mesh: &Mesh, top: usize, side: &str, cx: Context) -> Result<Self, NodeError> {
        let features = &of.features[..top.min(of.features.len())];
        let n = mesh.vertices.len();
        if let Some(f) = features.iter().find(|f| f.vertex as usize >= n) {
            let message = format!("{side} feature vertex {} is past the mesh's {n} vertices", f.vertex);
            return Err(NodeError::new(message).help(format!("wire `{side}_mesh` to the mesh of the {side} features")));
        }
        let graph = Graph::unfolded(&mesh.vertices, &mesh.faces)
            .map_err(|e| NodeError::new(format!("the {side} mesh has no geodesics: {e}")))?;
        let root = mesh.area().sqrt();
        let fields = cx.map(features, |_, f| {
            cx.check()?;
            let distances = Dijkstra::new().distances(&graph, &[f.vertex]);
            Ok(distances.into_iter().map(|d| d / root).collect::<Vec<f64>>())
        })?;
        let mut mass = vec![0.0; n];
        for face in &mesh.faces {
            let third = mesh.face_area(face) / (3.0 * root * root);
            for v in face {
                mass[*v as usize] += third;
            }
        }
        Ok(Self { features, root, fields, mass })
    }

    fn log_scale(&self, i: usize) -> f64 {
        (self.features[i].scale / self.root).ln()
    }
}

/// Sums over features with a place on the other shape: [in position, in position and scale].
struct Way {
    common: usize,
    position: [f64; 2],
    symmetric: [f64; 2],
    chance: [f64; 2],
}

fn direction(from: &Shape, to: &Shape, truth: &Truth, params: &Params, cx: Context) -> Result<Way, NodeError> {
    let tolerance = params.factor.ln() * (1.0 + 1e-12);
    let mut way = Way { common: 0, position: [0.0; 2], symmetric: [0.0; 2], chance: [0.0; 2] };
    let everywhere: Vec<usize> = (0..to.features.len()).collect();
    let any = covered(to, &everywhere, params.distance);
    for (i, feature) in from.features.iter().enumerate() {
        cx.check()?;
        let Some(image) = truth.image(feature.vertex) else { continue };
        let scale = from.log_scale(i);
        let alike: Vec<usize> =
            everywhere.iter().copied().filter(|j| (to.log_scale(*j) - scale).abs() <= tolerance).collect();
        let hit = |place: Place, among: &[usize]| among.iter().any(|j| place.value(&to.fields[*j]) <= params.distance);
        let twin = truth.twin(feature.vertex);
        way.common += 1;
        for (kind, among) in [&everywhere, &alike].into_iter().enumerate() {
            let own = hit(image, among);
            way.position[kind] += f64::from(u8::from(own));
            way.symmetric[kind] += f64::from(u8::from(own || twin.is_some_and(|t| hit(t, among))));
        }
        way.chance[0] += any;
        way.chance[1] += covered(to, &alike, params.distance);
    }
    Ok(way)
}

/// Share of the area within a distance of some features.
fn covered(shape: &Shape, features: &[usize], distance: f64) -> f64 {
    let near = |v: usize| features.iter().any(|j| shape.fields[*j][v] <= distance);
    shape.mass.iter().enumerate().filter(|(v, _)| near(*v)).map(|(_, m)| m).sum()
}
