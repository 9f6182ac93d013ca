//! `iqp_match`: the correspondence of two shapes' features as an integer quadratic program (eq. 19-26).
//!
//! Over one-to-one partial assignments x of candidate pairs a = (left i, right j) it maximises
//!
//! x' H x + beta C x - cost (number of unmatched features), where
//!
//! - C(a) = exp(-d² / 2 sigma²) compares descriptors, d = ||f_i - f_j||;
//! - H(a, b) = exp(-g² / 2 sigma²) exp(-s² / 2 sigma²) compares relations: for a = (i, j), b = (p, q) the
//!   *relative* geodesic distance g = | dist(i, p) / r_ip - dist(j, q) / r_jq |, where r is the geometric mean
//!   of the two features' scales (or another [`Unit`]), and s = | ln(sf_i / sf_p) - ln(sf_j / sf_q) |. Both are free of scale and
//!   symmetric in the two features, so H is symmetric; its diagonal is zero. x' H x counts each pair twice.
//!
//! Each sigma is the median of its distances over the candidates unless given. As printed, without the
//! minus sign, the kernels would reward mismatch; `kernel: AsPrinted` shows that.

use std::sync::Arc;

use salient_kernels::assignment::{self, Control, Limits, Problem, ProblemBuilder, Solution};
use salient_sdk::{Artefact, Context, Decoder, Encoder, FormatError, Inputs, Node, NodeError, Port, PortValues, Table};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::patch_spectrum::Features;

/// The sign in the exponent of the kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Kernel {
    /// exp(-d² / 2 sigma²): similarity.
    Decaying,
    /// exp(d² / 2 sigma²) as printed in eq. 21 and 23, capped at exp(2): rewards mismatch.
    AsPrinted,
}

/// What a geodesic distance between two features is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// The geometric mean of the two features' scales, as in the paper: free of the shape's size.
    Scale,
    /// The square root of the shape's area: free of its size, for whole shapes.
    Area,
    /// The file's unit, which both shapes share: for a part of a shape, whose eigenvalues and area differ
    /// from the whole's.
    Length,
}

/// When the search for a proof ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Limit {
    /// After this many nodes of the branch and bound: the same result every time.
    Nodes(u64),
    /// After this many seconds: the result may differ from run to run.
    Seconds(f64),
}

/// Params of [`IqpMatch`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Candidates of each feature: its nearest by descriptor on the other shape. 1 to 1000, default 3.
    #[schemars(range(min = 1, max = 1000))]
    pub candidates: u32,
    /// Weight of the descriptors' term against the relations'. At least 0, default 1 (paper).
    #[schemars(range(min = 0.0))]
    pub beta: f64,
    /// What geodesic distances are measured in: `Scale` (paper; default), `Area` or `Length`.
    pub unit: Unit,
    /// Sigma of descriptor distances, without unit. Above 0; default the median over candidates.
    #[schemars(range(min = 1e-9))]
    pub sigma_descriptor: Option<f64>,
    /// Sigma of geodesic distances in that unit. Above 0; default the median over candidates.
    #[schemars(range(min = 1e-9))]
    pub sigma_geodesic: Option<f64>,
    /// Sigma of logarithmic scale ratios. Above 0; default the median over candidates.
    #[schemars(range(min = 1e-9))]
    pub sigma_scale: Option<f64>,
    /// Cost of leaving a feature unmatched, of either shape. Negative rewards it: with H, C >= 0 a match
    /// is never rejected otherwise. Default 0.
    pub unmatched: f64,
    /// `Decaying` (default) or `AsPrinted`.
    pub kernel: Kernel,
    /// When to stop without a proof: `Nodes(n)` or `Seconds(s)`. The best match found is then returned
    /// with its proved bound. Default `Nodes(200)`.
    pub limit: Limit,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            candidates: 3,
            beta: 1.0,
            unit: Unit::Scale,
            sigma_descriptor: None,
            sigma_geodesic: None,
            sigma_scale: None,
            unmatched: 0.0,
            kernel: Kernel::Decaying,
            limit: Limit::Nodes(200),
        }
    }
}

/// Two shapes' features.
pub struct In {
    left: Arc<Features>,
    right: Arc<Features>,
}

impl Inputs for In {
    const PORTS: &'static [Port] = &[
        Port::one::<Features>("left", "features of the first shape"),
        Port::one::<Features>("right", "features of the second shape"),
    ];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { left: from.one("left")?, right: from.one("right")? })
    }
}

/// One matched pair of features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Index of the left feature.
    pub left: usize,
    /// Index of the right feature.
    pub right: usize,
    /// Its vertex on the left mesh.
    pub left_vertex: u32,
    /// Its vertex on the right mesh.
    pub right_vertex: u32,
    /// Distance of the two descriptors, without unit.
    pub descriptor_distance: f64,
}

/// A correspondence of features with its certificate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Match {
    /// Matched pairs, by left feature.
    pub pairs: Vec<Pair>,
    /// Value of the objective.
    pub objective: f64,
    /// No assignment has a greater one; proved.
    pub bound: f64,
    /// `bound - objective`.
    pub gap: f64,
    /// Whether the match is proved to be optimal.
    pub proved: bool,
    /// What ended the search: `proved`, `nodes` or `seconds`.
    pub stopped: String,
    /// Objective of the heuristic alone, before branching.
    pub heuristic: f64,
    /// Numbers of left and right features.
    pub features: [usize; 2],
    /// Number of candidate pairs.
    pub candidates: usize,
    /// Sigmas used: of descriptors, relative geodesic distances and logarithmic scale ratios.
    pub sigmas: [f64; 3],
}

impl Artefact for Match {
    const TYPE: &'static str = "match";
    const FORMAT: u32 = 1;
    const DOC: &'static str = "A one-to-one correspondence of features, `pairs` [p, 2] (left and right feature) and `vertices` [p, 2], \
        with the value of the objective, a proved upper bound and their gap.";

    fn encode(&self, out: &mut Encoder) {
        let two = [self.pairs.len(), 2];
        let features: Vec<u32> = self.pairs.iter().flat_map(|p| [p.left as u32, p.right as u32]).collect();
        let vertices: Vec<u32> = self.pairs.iter().flat_map(|p| [p.left_vertex, p.right_vertex]).collect();
        out.u32("pairs", &features, &two);
        out.u32("vertices", &vertices, &two);
        out.header("match", self);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        from.header("match")
    }

    fn json(&self) -> Value {
        json!(self)
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        let [left, right] = self.features;
        let proof = if self.proved {
            "proved optimal".to_owned()
        } else {
            format!("gap {:.2} % (stopped by {})", 100.0 * self.gap / self.objective.abs(), self.stopped)
        };
        vec![
            ("matches", format!("{} of {left} and {right} features", self.pairs.len())),
            ("objective", format!("{:.6}", self.objective)),
            ("bound", format!("{:.6}, {proof}", self.bound)),
        ]
    }

    fn table(&self) -> Option<Table> {
        let columns = ["left", "right", "left_vertex", "right_vertex", "descriptor_distance"];
        let row = |p: &Pair| {
            vec![
                p.left.to_string(),
                p.right.to_string(),
                p.left_vertex.to_string(),
                p.right_vertex.to_string(),
                p.descriptor_distance.to_string(),
            ]
        };
        Some(Table::new(&columns, self.pairs.iter().map(row).collect()))
    }
}

/// The node.
pub struct IqpMatch;

impl Node for IqpMatch {
    const KIND: &'static str = "iqp_match";
    const VERSION: u32 = 2;
    const DOC: &'static str = "The correspondence of two shapes' features that best agrees in descriptors, relative geodesic distances and scales \
        (eq. 19-26), by branch and bound with a proved upper bound.";
    const EXAMPLE: &'static str = r#"
        "a":        synthesize(pose: 0),
        "b":        synthesize(pose: 1),
        "fa":       graph(file: "salient_features.ron", mesh: "a"),
        "fb":       graph(file: "salient_features.ron", mesh: "b"),
        "match":    iqp_match(left: "fa", right: "fb"),
    "#;
    type Params = Params;
    type Inputs = In;
    type Output = Match;

    fn check(params: &Params) -> Vec<(&'static str, String)> {
        match params.limit {
            Limit::Seconds(s) if !(s.is_finite() && s > 0.0) => {
                vec![("limit", format!("{s} seconds are no time limit"))]
            }
            _ => Vec::new(),
        }
    }

    fn run(params: &Params, In { left, right }: In, cx: Context) -> Result<Match, NodeError> {
        if left.values != right.values {
            return Err(NodeError::new(format!(
                "left descriptors have {} values, right ones {}",
                left.values, right.values
            )));
        }
        let candidates = candidates(&left, &right, params.candidates as usize);
        let sigmas = sigmas(&left, &right, &candidates, params);
        let problem = problem(&left, &right, &candidates, &sigmas, params)
            .map_err(|e| NodeError::new(format!("the matching problem cannot be built: {e}")))?;
        let solution = solve(&problem, params.limit, cx)?;
        let pair = |&c: &usize| {
            let Candidate { left: i, right: j, distance } = candidates[c];
            Pair {
                left: i,
                right: j,
                left_vertex: left.features[i].vertex,
                right_vertex: right.features[j].vertex,
                descriptor_distance: distance,
            }
        };
        Ok(Match {
            pairs: solution.candidates.iter().map(pair).collect(),
            objective: solution.objective,
            bound: solution.upper_bound,
            gap: solution.gap(),
            proved: solution.proved,
            stopped: match (solution.stop, params.limit) {
                (assignment::StopReason::Proved, _) => "proved",
                (assignment::StopReason::NodeLimit, _) => "nodes",
                (assignment::StopReason::Stopped, _) => "seconds",
            }
            .into(),
            heuristic: solution.heuristic_objective,
            features: [left.features.len(), right.features.len()],
            candidates: candidates.len(),
            sigmas: [sigmas.descriptor, sigmas.geodesic, sigmas.scale],
        })
    }
}

fn solve(problem: &Problem, limit: Limit, cx: Context) -> Result<Solution, NodeError> {
    let (node_limit, seconds) = match limit {
        Limit::Nodes(n) => (n, f64::INFINITY),
        Limit::Seconds(s) => (u64::MAX, s),
    };
    let stop = || cx.cancelled() || (seconds.is_finite() && cx.seconds() > seconds);
    let progress = |p: &assignment::Progress| cx.progress(p.nodes as f64 / node_limit as f64);
    let limits = Limits { node_limit, ..Limits::default() };
    let solution = assignment::solve(problem, &limits, &Control { stop: &stop, progress: &progress })
        .map_err(|e| NodeError::new(e.to_string()))?;
    cx.check()?;
    cx.record("nodes", solution.nodes);
    Ok(solution)
}

/// A pair of features that may be matched.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    left: usize,
    right: usize,
    /// Distance of their descriptors.
    distance: f64,
}

/// The `count` nearest of each feature by descriptor, both ways, each pair once, by (left, right).
fn candidates(left: &Features, right: &Features, count: usize) -> Vec<Candidate> {
    let described =
        |f: &Features| -> Vec<usize> { (0..f.features.len()).filter(|i| f.descriptors[*i].is_ok()).collect() };
    let (lefts, rights) = (described(left), described(right));
    let distance = |i: usize, j: usize| match (&left.descriptors[i], &right.descriptors[j]) {
        (Ok(a), Ok(b)) => a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt(),
        _ => f64::INFINITY,
    };
    let mut all = Vec::new();
    let mut nearest = |mut of: Vec<Candidate>| {
        of.sort_by(|a, b| a.distance.total_cmp(&b.distance).then((a.left, a.right).cmp(&(b.left, b.right))));
        all.extend(of.into_iter().take(count));
    };
    let candidate = |i, j| Candidate { left: i, right: j, distance: distance(i, j) };
    for &i in &lefts {
        nearest(rights.iter().map(|&j| candidate(i, j)).collect());
    }
    for &j in &rights {
        nearest(lefts.iter().map(|&i| candidate(i, j)).collect());
    }
    all.sort_by_key(|c| (c.left, c.right));
    all.dedup_by_key(|c| (c.left, c.right));
    all
}

/// How far two candidates are from agreeing: differences of relative geodesic distance and of the
/// logarithm of the scale ratio. `None` if they exclude each other or no path joins one side.
fn relation(left: &Features, right: &Features, a: &Candidate, b: &Candidate, unit: Unit) -> Option<(f64, f64)> {
    if a.left == b.left || a.right == b.right {
        return None;
    }
    let side = |f: &Features, i: usize, p: usize| {
        let (si, sp) = (f.features[i].scale, f.features[p].scale);
        let unit = match unit {
            Unit::Scale => (si * sp).sqrt(),
            Unit::Area => f.area.sqrt(),
            Unit::Length => 1.0,
        };
        Some((f.distance(i, p)? / unit, (si / sp).ln()))
    };
    let (l, r) = (side(left, a.left, b.left)?, side(right, a.right, b.right)?);
    Some(((l.0 - r.0).abs(), (l.1 - r.1).abs()))
}

struct Sigmas {
    descriptor: f64,
    geodesic: f64,
    scale: f64,
}

fn sigmas(left: &Features, right: &Features, candidates: &[Candidate], params: &Params) -> Sigmas {
    let (mut geodesic, mut scale) = (Vec::new(), Vec::new());
    if params.sigma_geodesic.is_none() || params.sigma_scale.is_none() {
        for (i, a) in candidates.iter().enumerate() {
            for b in &candidates[i + 1..] {
                if let Some((g, s)) = relation(left, right, a, b, params.unit) {
                    geodesic.push(g);
                    scale.push(s);
                }
            }
        }
    }
    let descriptor = candidates.iter().map(|c| c.distance).collect();
    Sigmas {
        descriptor: params.sigma_descriptor.unwrap_or_else(|| median(descriptor)),
        geodesic: params.sigma_geodesic.unwrap_or_else(|| median(geodesic)),
        scale: params.sigma_scale.unwrap_or_else(|| median(scale)),
    }
}

/// The median; of nothing, or where it is zero, 1 (any positive value then does the same).
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 1.0;
    }
    let middle = values.len() / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if *median > 0.0 { *median } else { 1.0 }
}

fn problem(
    left: &Features,
    right: &Features,
    candidates: &[Candidate],
    sigmas: &Sigmas,
    params: &Params,
) -> Result<Problem, assignment::ProblemError> {
    let kernel = |x: f64| match params.kernel {
        Kernel::Decaying => (-0.5 * x).exp(),
        Kernel::AsPrinted => (0.5 * x).min(2.0).exp(),
    };
    let mut builder = ProblemBuilder::new(left.features.len(), right.features.len());
    for c in candidates {
        let score = params.beta * kernel((c.distance / sigmas.descriptor).powi(2));
        builder.candidate(c.left, c.right, score)?;
    }
    for (i, a) in candidates.iter().enumerate() {
        for (j, b) in candidates.iter().enumerate().skip(i + 1) {
            if let Some((g, s)) = relation(left, right, a, b, params.unit) {
                let x = (g / sigmas.geodesic).powi(2) + (s / sigmas.scale).powi(2);
                // Each unordered pair is given once; x' H x counts it twice.
                builder.pair(i, j, 2.0 * kernel(x))?;
            }
        }
    }
    builder.unmatched_cost(params.unmatched)?;
    builder.build()
}
