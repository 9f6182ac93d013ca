//! `patch_extract`: the geodesic disc about each feature, of radius r / sqrt(lambda_k) with r = 1.7.
//!
//! Besides the patches the node measures the geodesic distances between the features, which the
//! matching needs: both come from the same graph, and never is there an n x n matrix.

use std::collections::BTreeSet;
use std::sync::Arc;

use salient_kernels::disc::{DiscCutter, PatchKind};
use salient_kernels::geodesic::{self, Geodesics, Search};
use salient_sdk::{
    Artefact, Context, Decoder, Encoder, FormatError, Inputs, Mesh, Node, NodeError, Port, PortValues, Table,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::feature::{self, Feature};
use crate::maxima::Salient;

/// How distances on the surface are measured. Mean errors, on analytic surfaces and on scans of about 10,000 vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Metric {
    /// Dijkstra along edges, as the paper has it: 4-12 % too long.
    Edges,
    /// Dijkstra along edges and across each edge's two unfolded triangles: 1.4-4 % too long.
    Unfolded,
    /// The heat method: off by 0.3-2.6 %, either way. Each patch costs a solve on the whole mesh.
    Heat,
    /// Shortest paths through the triangles, without error.
    Exact,
}

impl Metric {
    /// The kernel's name for it.
    #[must_use]
    pub fn kernel(self) -> geodesic::Metric {
        match self {
            Self::Edges => geodesic::Metric::Edges,
            Self::Unfolded => geodesic::Metric::Unfolded,
            Self::Heat => geodesic::Metric::Heat,
            Self::Exact => geodesic::Metric::Exact,
        }
    }
}

/// Params of [`PatchExtract`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Radius of a patch in units of its feature's scale 1 / sqrt(lambda). Above 0, default 1.7 (paper).
    #[schemars(range(min = 0.01, max = 100.0))]
    pub radius: f64,
    /// Cut triangles where the distance equals the radius, rather than keep only whole triangles.
    /// Default true: it makes patches of different triangulations alike.
    pub clip: bool,
    /// How distances are measured, of patches and between features: `Edges` (paper; default), `Unfolded`, `Heat` or `Exact`.
    pub metric: Metric,
}

impl Default for Params {
    fn default() -> Self {
        Self { radius: 1.7, clip: true, metric: Metric::Edges }
    }
}

/// A mesh and its features.
pub struct In {
    mesh: Arc<Mesh>,
    maxima: Arc<Salient>,
}

impl Inputs for In {
    const PORTS: &'static [Port] =
        &[Port::one::<Mesh>("mesh", "the shape"), Port::one::<Salient>("maxima", "its features")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")?, maxima: from.one("maxima")? })
    }
}

/// What a patch looks like (names in JSON: `disk`, `annulus`, `whole`, `too_small`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A topological disc.
    Disk,
    /// Bounded, but not a disc.
    Annulus,
    /// A closed component.
    Whole,
    /// No face, or the centre on the rim.
    TooSmall,
}

/// A piece of the surface about a feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// What it looks like.
    pub kind: Kind,
    /// Radius, a length.
    pub radius: f64,
    /// Number of boundary curves.
    pub loops: u32,
    /// Area.
    pub area: f64,
    /// Vertex positions.
    pub vertices: Vec<[f64; 3]>,
    /// Faces over `vertices`.
    pub faces: Vec<[u32; 3]>,
    /// The mesh's vertex of each patch vertex; `u32::MAX` for a vertex made by the cut.
    pub source: Vec<u32>,
}

/// The patches of a shape's features.
#[derive(Clone, Debug, PartialEq)]
pub struct Patches {
    /// The features, in the order of the input.
    pub features: Vec<Feature>,
    /// The patch of each.
    pub patches: Vec<Patch>,
    /// Geodesic distances between features, f x f row-major, symmetric; -1 where no path leads.
    pub distances: Vec<f64>,
    /// Area of the whole shape.
    pub area: f64,
}

#[derive(Serialize, Deserialize)]
struct PatchHeader {
    kind: Kind,
    radius: f64,
    loops: u32,
    area: f64,
    vertices: usize,
    faces: usize,
}

impl Artefact for Patches {
    const TYPE: &'static str = "patches";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "Features with their patches, whose `patch_vertices` [sum, 3], `patch_faces` [sum, 3] (indices within \
        the patch) and `patch_source` [sum] follow each other in order, and geodesic `distances` [f, f] between features (-1: no path).";

    fn encode(&self, out: &mut Encoder) {
        feature::encode(&self.features, out);
        let header = |p: &Patch| PatchHeader {
            kind: p.kind,
            radius: p.radius,
            loops: p.loops,
            area: p.area,
            vertices: p.vertices.len(),
            faces: p.faces.len(),
        };
        out.header("patches", &self.patches.iter().map(header).collect::<Vec<_>>());
        out.header("area", &self.area);
        out.points("patch_vertices", &flat(&self.patches, |p| &p.vertices));
        out.triples("patch_faces", &flat(&self.patches, |p| &p.faces));
        let source = flat(&self.patches, |p| &p.source);
        out.u32("patch_source", &source, &[source.len()]);
        out.f64("distances", &self.distances, &[self.features.len(), self.features.len()]);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let features = feature::decode(from)?;
        let headers: Vec<PatchHeader> = from.header("patches")?;
        let mut vertices = from.points("patch_vertices")?.into_iter();
        let mut faces = from.triples("patch_faces")?.into_iter();
        let mut source = from.u32("patch_source")?.0.into_iter();
        let (distances, shape) = from.f64("distances")?;
        let mut patches = Vec::with_capacity(headers.len());
        for h in headers {
            patches.push(Patch {
                kind: h.kind,
                radius: h.radius,
                loops: h.loops,
                area: h.area,
                vertices: vertices.by_ref().take(h.vertices).collect(),
                faces: faces.by_ref().take(h.faces).collect(),
                source: source.by_ref().take(h.vertices).collect(),
            });
        }
        if patches.len() != features.len() || shape != [features.len(), features.len()] {
            return Err(FormatError("patches, features and distances differ in number".into()));
        }
        Ok(Self { features, patches, distances, area: from.header("area")? })
    }

    fn json(&self) -> Value {
        let entry = |(f, p): (&Feature, &Patch)| {
            let mut entry = f.json();
            entry["radius"] = json!(p.radius);
            entry["patch"] = json!({
                "kind": p.kind, "vertices": p.vertices.len(), "area": p.area, "loops": p.loops,
            });
            entry
        };
        let list: Vec<Value> = self.features.iter().zip(&self.patches).map(entry).collect();
        json!({ "features": list, "area": self.area })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let count = |kind| self.patches.iter().filter(|p| p.kind == kind).count();
        vec![
            ("patches", self.patches.len().to_string()),
            (
                "kinds",
                format!(
                    "{} disks, {} annuli, {} whole, {} too small",
                    count(Kind::Disk),
                    count(Kind::Annulus),
                    count(Kind::Whole),
                    count(Kind::TooSmall)
                ),
            ),
        ]
    }

    fn table(&self) -> Option<Table> {
        let columns = [&feature::COLUMNS[..], &["radius", "loops", "area"]].concat();
        let row = |(f, p): (&Feature, &Patch)| {
            let own = [p.radius.to_string(), p.loops.to_string(), p.area.to_string()];
            [feature::row(f), own.to_vec()].concat()
        };
        Some(Table::new(&columns, self.features.iter().zip(&self.patches).map(row).collect()))
    }

    fn differences(&self, other: &Self, surfaces: &salient_sdk::Surfaces) -> Vec<salient_sdk::Difference> {
        crate::differences::patches(self, other, surfaces)
    }

    fn view(&self) -> salient_sdk::View<'_> {
        crate::views::patches(self)
    }
}

fn flat<T: Copy>(patches: &[Patch], of: impl Fn(&Patch) -> &Vec<T>) -> Vec<T> {
    patches.iter().flat_map(|p| of(p).iter().copied()).collect()
}

/// The node.
pub struct PatchExtract;

impl Node for PatchExtract {
    const KIND: &'static str = "patch_extract";
    const VERSION: u32 = 1;
    const DOC: &'static str = "The geodesic disc of radius r / sqrt(lambda) about each feature, and the distances between features. \
        Only the component of the centre is kept; patches are typed disk, annulus, whole or too small.";
    const EXAMPLE: &'static str = r#"
        "mesh":      synthesize(),
        "laplacian": laplacian(mesh: "mesh"),
        "basis":     eigensolve(operator: "laplacian", pairs: 100),
        "energy":    reconstruction_energy(mesh: "mesh", basis: "basis"),
        "maxima":    maxima(mesh: "mesh", energy: "energy"),
        "patches":   patch_extract(mesh: "mesh", maxima: "maxima", radius: 1.7),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Patches;

    fn run(params: &Params, In { mesh, maxima }: In, cx: Context) -> Result<Patches, NodeError> {
        let bad = |e: &dyn std::fmt::Display| NodeError::new(format!("the mesh has no discs: {e}"));
        if let Some(f) = maxima.features.iter().find(|f| f.vertex as usize >= mesh.vertices.len()) {
            return Err(NodeError::new(format!(
                "feature vertex {} is past the mesh's {} vertices",
                f.vertex,
                mesh.vertices.len()
            )));
        }
        let geodesics = Geodesics::new(&mesh.vertices, &mesh.faces, params.metric.kernel()).map_err(|e| bad(&e))?;
        let cutter = DiscCutter::new(&mesh.vertices, &mesh.faces).map_err(|e| bad(&e))?;
        let batches: Vec<&[Feature]> = maxima.features.chunks(BATCH).collect();
        let patches = cx.map(&batches, |_, batch| {
            let (mut cutter, mut search) = (cutter.clone(), geodesics.search());
            let patch = |f: &Feature| {
                cx.check()?;
                Ok(patch(&mut cutter, &mut search, f, params))
            };
            batch.iter().map(patch).collect::<Result<Vec<_>, NodeError>>()
        })?;
        let distances = distances(&geodesics, &maxima.features, cx)?;
        Ok(Patches {
            features: maxima.features.clone(),
            patches: patches.into_iter().flatten().collect(),
            distances,
            area: mesh.area(),
        })
    }
}

/// Features that share one workspace.
const BATCH: usize = 8;

fn patch(cutter: &mut DiscCutter, search: &mut Search, f: &Feature, params: &Params) -> Patch {
    let radius = params.radius * f.scale;
    let ball = search.ball(&[f.vertex], radius);
    let disc = cutter.cut(f.vertex, &ball, params.clip);
    let kind = match disc.kind {
        PatchKind::Disk => Kind::Disk,
        PatchKind::Annulus => Kind::Annulus,
        PatchKind::Whole => Kind::Whole,
        PatchKind::TooSmall => Kind::TooSmall,
    };
    Patch {
        kind,
        radius,
        loops: disc.loops as u32,
        area: disc.area,
        vertices: disc.vertices,
        faces: disc.faces,
        source: disc.source,
    }
}

/// Distances between features, f x f: one search per different vertex, symmetric by construction.
fn distances(geodesics: &Geodesics, features: &[Feature], cx: Context) -> Result<Vec<f64>, NodeError> {
    let vertices: Vec<u32> = features.iter().map(|f| f.vertex).collect::<BTreeSet<_>>().into_iter().collect();
    let batches: Vec<&[u32]> = vertices.chunks(BATCH).collect();
    let rows = cx.map(&batches, |_, batch| {
        cx.check()?;
        Ok(geodesics.search().between(batch, &vertices))
    })?;
    let rows: Vec<Vec<f64>> = rows.into_iter().flatten().collect();
    let at = |f: &Feature| vertices.partition_point(|v| *v < f.vertex);
    let between = |a: &Feature, b: &Feature| {
        let (i, j) = (at(a).min(at(b)), at(a).max(at(b)));
        if rows[i][j].is_finite() { rows[i][j] } else { -1.0 }
    };
    Ok(features.iter().flat_map(|a| features.iter().map(move |b| (a, b))).map(|(a, b)| between(a, b)).collect())
}
