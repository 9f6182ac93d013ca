//! `orient_match`: which of a match and its mirror twin keeps the orientation of the surface.
//!
//! Eigenvalues and geodesic distances are the same on a shape and its mirror image, so the matching cannot tell left
//! from right (the paper names it as future work). The surface can: its faces run counterclockwise seen from outside. For three
//! landmarks a, b, c with the geodesic distances d_a, d_b, d_c to them,
//!
//! V(a, b, c) = integral of d_a  grad d_b x grad d_c . n = sum over faces of det [d_a d_b d_c at the corners] / 6
//!
//! is the volume that the surface encloses under the map x -> (d_a, d_b, d_c) to space. An isometry that keeps orientation keeps V, one
//! that reverses it changes its sign. Over all triples of some matched features, spread over the shape, the correlation of V on the
//! left with V on the right, in units of area, is near 1 for a right match and near -1 for a mirrored one. Where both have the
//! same sign, the twin is no mirror image (but, say, back to front), and another of those that the matching found may be.

use std::sync::Arc;

use salient_kernels::geodesic::{Dijkstra, Graph};
use salient_sdk::{Context, Inputs, Mesh, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::iqp_match::{Match, NEAR, Orientation, Pair, Twin};

/// Params of [`OrientMatch`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Number of matched features used as landmarks, far apart from each other. 3 to 50, default 12.
    #[schemars(range(min = 3, max = 50))]
    pub landmarks: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self { landmarks: 12 }
    }
}

/// A match and its two meshes.
pub struct In {
    matched: Arc<Match>,
    left: Arc<Mesh>,
    right: Arc<Mesh>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Match>("match", "the correspondence, with its twin"),
        Port::one::<Mesh>("left", "the mesh of the left features"),
        Port::one::<Mesh>("right", "the mesh of the right features"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { matched: from.one("match")?, left: from.one("left")?, right: from.one("right")? })
    }
}

/// The node.
pub struct OrientMatch;

impl Node for OrientMatch {
    const KIND: &'static str = "orient_match";
    const VERSION: u32 = 2;
    const DOC: &'static str = "Exchanges a match and its mirror twin if the twin keeps the orientation of the surface and the match reverses it. \
        Both meshes must be oriented alike: faces counterclockwise from outside.";
    const EXAMPLE: &'static str = r#"
        "a":        synthesize(pose: 0),
        "b":        synthesize(pose: 1),
        "fa":       graph(file: "salient_features.ron", mesh: "a"),
        "fb":       graph(file: "salient_features.ron", mesh: "b"),
        "match":    iqp_match(left: "fa", right: "fb"),
        "oriented": orient_match(match: "match", left: "a", right: "b"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Match;

    fn run(params: &Params, In { matched, left, right }: In, cx: Context) -> Result<Match, NodeError> {
        matched.check_vertices(&left, &right)?;
        let graph = |mesh: &Mesh| {
            Graph::unfolded(&mesh.vertices, &mesh.faces)
                .map_err(|e| NodeError::new(format!("a mesh has no geodesics: {e}")))
        };
        let sides = [Shape { graph: graph(&left)?, mesh: &left }, Shape { graph: graph(&right)?, mesh: &right }];
        let count = params.landmarks as usize;
        let own = orientation(&sides, &matched.pairs, count, cx)?;
        let mut twins = Vec::new();
        for twin in matched.twin.iter().chain(&matched.others) {
            twins.push((orientation(&sides, &twin.pairs, count, cx)?, twin.clone()));
        }
        let mut found = decided(&matched, own, twins);
        if found.orientation.is_some_and(|o| o.exchanged) {
            // These are told apart from the match, which is another one now.
            for twin in &mut found.others {
                twin.moved = moved(&sides[1], &found.pairs, &twin.pairs, cx)?;
            }
        }
        Ok(found)
    }
}

/// The match with its best twin of the other orientation first, and in its place if the match is mirrored.
fn decided(matched: &Match, own: f64, mut twins: Vec<(f64, Twin)>) -> Match {
    let opposite = twins.iter().position(|(o, _)| o * own < 0.0);
    if let Some(i) = opposite {
        twins[..=i].rotate_right(1);
    }
    let mut found = matched.clone();
    let exchanged = own < 0.0 && opposite.is_some();
    let mut orientation = Orientation { own, twin: twins.first().map(|(o, _)| *o), exchanged };
    if let Some((other, twin)) = twins.first_mut().filter(|_| exchanged) {
        orientation = Orientation { own: *other, twin: Some(own), exchanged };
        let moved = twin.moved;
        let twin = std::mem::replace(twin, Twin { pairs: matched.pairs.clone(), objective: matched.objective, moved });
        found.gap = matched.bound - twin.objective;
        (found.pairs, found.objective) = (twin.pairs, twin.objective);
        // What was found without branching is the twin.
        found.heuristic = found.objective;
        (found.proved, found.stopped) = (false, "exchanged".into());
    }
    let mut twins = twins.into_iter().map(|(_, twin)| twin);
    found.twin = twins.next();
    found.others = twins.collect();
    found.orientation = Some(orientation);
    found
}

struct Shape<'a> {
    graph: Graph,
    mesh: &'a Mesh,
}

/// Of the features that both match, the share whose right partners lie apart.
fn moved(right: &Shape, pairs: &[Pair], twin: &[Pair], cx: Context) -> Result<f64, NodeError> {
    let (mut both, mut apart) = (0.0, 0.0);
    let mut dijkstra = Dijkstra::new();
    let near = NEAR * right.mesh.area().sqrt();
    for own in pairs {
        cx.check()?;
        let Some(other) = twin.iter().find(|p| p.left == own.left) else { continue };
        let distance = dijkstra.to(&right.graph, &[own.right_vertex], &[other.right_vertex]);
        both += 1.0;
        apart += f64::from(u8::from(distance[0] > near));
    }
    Ok(if both > 0.0 { apart / both } else { 0.0 })
}

/// Correlation of the enclosed volumes of all triples of landmarks, -1 to 1; 0 if there are not three.
fn orientation(sides: &[Shape; 2], pairs: &[Pair], count: usize, cx: Context) -> Result<f64, NodeError> {
    let fields = landmarks(sides, pairs, count, cx)?;
    let n = fields[0].len();
    let triples: Vec<[usize; 3]> =
        (0..n).flat_map(|a| (a + 1..n).flat_map(move |b| (b + 1..n).map(move |c| [a, b, c]))).collect();
    let products = cx.map(&triples, |_, triple| {
        cx.check()?;
        Ok([0, 1].map(|side| volume(sides[side].mesh, triple.map(|i| fields[side][i].as_slice()))))
    })?;
    let sum = |x: usize, y: usize| products.iter().map(|v| v[x] * v[y]).sum::<f64>();
    let norm = (sum(0, 0) * sum(1, 1)).sqrt();
    Ok(if norm > 0.0 { sum(0, 1) / norm } else { 0.0 })
}

/// Distances over sqrt(area) to matched features, left and right, each new one the farthest on the left from those taken.
fn landmarks(sides: &[Shape; 2], pairs: &[Pair], count: usize, cx: Context) -> Result<[Vec<Vec<f64>>; 2], NodeError> {
    let mut fields = [Vec::new(), Vec::new()];
    let mut dijkstra = Dijkstra::new();
    let roots = [0, 1].map(|side| sides[side].mesh.area().sqrt());
    let mut apart = vec![f64::INFINITY; pairs.len()];
    let mut next = (!pairs.is_empty()).then_some(0);
    while let Some(p) = next.filter(|_| fields[0].len() < count) {
        cx.check()?;
        for (side, vertex) in [pairs[p].left_vertex, pairs[p].right_vertex].into_iter().enumerate() {
            let distances = dijkstra.distances(&sides[side].graph, &[vertex]);
            fields[side].push(distances.into_iter().map(|d| d / roots[side]).collect::<Vec<f64>>());
        }
        let from = fields[0].last().map_or(&[][..], Vec::as_slice);
        for (distance, pair) in apart.iter_mut().zip(pairs) {
            *distance = distance.min(from[pair.left_vertex as usize]);
        }
        let farthest = (0..pairs.len()).max_by(|a, b| apart[*a].total_cmp(&apart[*b]).then(b.cmp(a)));
        next = farthest.filter(|i| apart[*i] > 0.0);
    }
    Ok(fields)
}

/// The signed volume that the mesh encloses under the map to three fields. Faces that a field does not reach are left out.
fn volume(mesh: &Mesh, fields: [&[f64]; 3]) -> f64 {
    let face = |f: &[u32; 3]| {
        let [p, q, r] = f.map(|v| fields.map(|field| field[v as usize]));
        let det = p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
            + p[2] * (q[0] * r[1] - q[1] * r[0]);
        if det.is_finite() { det / 6.0 } else { 0.0 }
    };
    mesh.faces.iter().map(face).sum()
}
