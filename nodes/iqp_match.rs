//! `iqp_match`: the correspondence of two shapes' features as an integer quadratic program (eq. 19-26).
//!
//! Over one-to-one partial assignments x of candidate pairs a = (left i, right j) it maximises
//!
//! x' H x + beta C x - cost (number of unmatched features), where
//!
//! - C(a) = exp(-u² / 2), u² = d² / sigma² with d = ||f_i - f_j|| the distance of descriptors;
//! - H(a, b) = exp(-g² / 2 sigma²) exp(-s² / 2 sigma²) - agreement, for a = (i, j), b = (p, q), compares relations: g those of
//!   geodesic distances dist(i, p) and dist(j, q), s = | ln(sf_i / sf_p) - ln(sf_j / sf_q) |.
//!
//! H is symmetric, its diagonal is zero, and x' H x counts each pair twice.
//!
//! **As the paper has it**, `unit: Scale, compare: Difference`: g is the difference of distances, each divided by
//! the geometric mean of its two features' scales; and `agreement: 0`, so that H >= 0 and a match is never rejected.
//! Each sigma is then the median of its distances over the candidates. As printed, without the minus sign, the kernels
//! would reward mismatch; `kernel: AsPrinted` shows that. The graphs `literal.ron` and `corrected.ron` are set so.
//!
//! **By default** distances are in units of the square root of the area and compared by the logarithm of their ratio,
//! g = | ln((dist(i, p) + floor) / (dist(j, q) + floor)) |, because a pose and a remeshing change them by
//! a share; scales are compared candidate by candidate, u² = d² / sigma² + ln²(sf_i / sf_j) / sigma², because whole
//! shapes in the same unit share their frequencies; and candidates that contradict each other cost something:
//! a match must agree with the average of the others to be made at all. docs/accuracy.md has the measurements.

use std::sync::Arc;

use salient_kernels::assignment::{self, Control, Limits, Problem, Solution, SolveError};
use salient_sdk::{Context, Inputs, Node, NodeError, Port, PortValues};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pair_scores::PairScore;
use crate::patch_spectrum::Features;

mod matched;
mod model;
mod quick;
mod stretch;
mod twin;

pub use matched::{Match, Orientation, Pair, Twin};
use model::Model;
pub(crate) use twin::NEAR;

/// The sign in the exponent of the kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Kernel {
    /// exp(-d² / 2 sigma²): similarity.
    Decaying,
    /// exp(d² / 2 sigma²) as printed in eq. 21 and 23, capped at exp(2): rewards mismatch.
    AsPrinted,
}

/// What lengths are measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// A geodesic distance in the geometric mean of its two features' scales, as in the paper: free of the shape's size.
    Scale,
    /// The square root of the shape's area: free of its size, for whole shapes.
    Area,
    /// The file's unit, which both shapes share: for a part of a shape, whose eigenvalues and area differ
    /// from the whole's.
    Length,
}

/// How two geodesic distances are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Compare {
    /// By their difference, as in the paper.
    Difference,
    /// By the logarithm of their ratio, `floor` added to both: errors that grow with the distance count the same everywhere.
    LogRatio,
}

/// How features' scales are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Scales {
    /// The ratio of two features' scales on one shape with that of their partners, in H, as in the paper.
    Relative,
    /// The scale of a feature with its partner's, both in `unit`, in C and in the choice of candidates.
    Absolute,
}

/// When the search for a proof ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Limit {
    /// After this many nodes of the branch and bound: the same result every time.
    Nodes(u64),
    /// After this many seconds: the result may differ from run to run.
    Seconds(f64),
}

/// Params of [`IqpMatch`]. The defaults are the robust reading; `corrected.ron` has the paper's.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Candidates of each feature: its nearest by descriptor (and scale) on the other shape, both ways. 1 to 1000, default 6.
    #[schemars(range(min = 1, max = 1000))]
    pub candidates: u32,
    /// Weight of the descriptors' term against the relations'. At least 0, default 1 (paper).
    #[schemars(range(min = 0.0))]
    pub beta: f64,
    /// What lengths are measured in: `Scale` (paper), `Area` (default) or `Length`.
    pub unit: Unit,
    /// How geodesic distances are compared: `Difference` (paper) or `LogRatio` (default).
    pub compare: Compare,
    /// Added to both distances before their ratio is taken, in that unit: about the size of a feature, so that short
    /// distances do not ask for accuracy that no mesh has. Above 0, default 0.15.
    #[schemars(range(min = 1e-9))]
    pub floor: f64,
    /// How scales are compared: `Relative` (paper) or `Absolute` (default), which asks for the unit `Area` or `Length`.
    pub scales: Scales,
    /// How well two matches must agree, on the kernel's scale, to support each other; below it they count
    /// against each other. 0 (paper: nothing ever does) to 1, default 0.7.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub agreement: f64,
    /// Sigma of descriptor distances, without unit. Above 0; default the median over the nearest by descriptor.
    #[schemars(range(min = 1e-9))]
    pub sigma_descriptor: Option<f64>,
    /// Sigma of g. Above 0; default 0.15, a seventh of a distance; `None` for the median over candidates.
    #[schemars(range(min = 1e-9))]
    pub sigma_geodesic: Option<f64>,
    /// Sigma of logarithmic scale ratios. Above 0; default 0.15; `None` for the median over candidates. `Absolute` scales
    /// that differ by more than three sigmas are no candidates.
    #[schemars(range(min = 1e-9))]
    pub sigma_scale: Option<f64>,
    /// The shapes' lengths may differ, in `unit`, by a factor up to this, and the factor is searched: for a
    /// part against the whole, or files in different units. 1 to 10, default 1: none is.
    #[schemars(range(min = 1.0, max = 10.0))]
    pub stretch: f64,
    /// Cost of leaving a feature unmatched, of either shape. Negative rewards it. Default 0.
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
            candidates: 6,
            beta: 1.0,
            unit: Unit::Area,
            compare: Compare::LogRatio,
            floor: 0.15,
            scales: Scales::Absolute,
            agreement: 0.7,
            sigma_descriptor: None,
            sigma_geodesic: Some(0.15),
            sigma_scale: Some(0.15),
            stretch: 1.0,
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

/// The node.
pub struct IqpMatch;

impl Node for IqpMatch {
    const KIND: &'static str = "iqp_match";
    const VERSION: u32 = 4;
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
        let mut wrong = Vec::new();
        if let Limit::Seconds(s) = params.limit
            && !(s.is_finite() && s > 0.0)
        {
            wrong.push(("limit", format!("{s} seconds are no time limit")));
        }
        if params.unit == Unit::Scale && params.scales == Scales::Absolute {
            wrong.push((
                "scales",
                "absolute scales have a unit, but `unit` is `Scale`: choose `Area` or `Length`".into(),
            ));
        }
        if params.unit == Unit::Scale && params.stretch > 1.0 {
            wrong.push((
                "stretch",
                "in the unit `Scale` a factor makes no difference: choose `Area` or `Length`".into(),
            ));
        }
        wrong
    }

    fn run(params: &Params, In { left, right }: In, cx: Context) -> Result<Match, NodeError> {
        if left.values != right.values {
            return Err(NodeError::new(format!(
                "left descriptors have {} values, right ones {}",
                left.values, right.values
            )));
        }
        let stretch = stretch::search(&left, &right, params, cx)?;
        let model = Model::new(&left, &right, params, stretch, cx)?;
        let problem = model.problem(cx)?;
        let solution = solve(&problem, params.limit, cx)?;
        let pair = |c: &usize| {
            let c = model.candidates[*c];
            let (left_vertex, right_vertex) = (left.features[c.left].vertex, right.features[c.right].vertex);
            Pair { left: c.left, right: c.right, left_vertex, right_vertex, descriptor_distance: c.distance }
        };
        let twins = twin::search(&model, &problem, &solution.candidates, solution.objective, cx)?;
        let mut twins = twins.iter().map(|t| Twin {
            pairs: t.chosen.iter().map(pair).collect(),
            objective: t.objective,
            moved: t.moved,
        });
        Ok(Match {
            pairs: solution.candidates.iter().map(pair).collect(),
            objective: solution.objective,
            bound: solution.upper_bound,
            gap: solution.gap(),
            proved: solution.proved,
            stopped: match solution.stop {
                assignment::StopReason::Proved => "proved",
                assignment::StopReason::NodeLimit => "nodes",
                assignment::StopReason::Stopped => "seconds",
            }
            .into(),
            heuristic: solution.heuristic_objective,
            features: [left.features.len(), right.features.len()],
            candidates: model.candidates.len(),
            sigmas: [model.sigmas.descriptor, model.sigmas.geodesic, model.sigmas.scale],
            stretch,
            twin: twins.next(),
            others: twins.collect(),
            orientation: None,
        })
    }
}

/// One match of a quick search, and what it earns: together with the others half of its pairs' terms.
pub(crate) struct Earned {
    pub left: usize,
    pub right: usize,
    pub distance: f64,
    pub alone: f64,
    pub together: f64,
}

/// What a good match comes to, without proof and twins: for ranking, where there are many pairs.
pub(crate) fn outcome(
    left: &Features,
    right: &Features,
    params: &Params,
    passes: usize,
    cx: Context,
) -> Result<PairScore, NodeError> {
    explained(left, right, params, passes, cx).map(|(score, _)| score)
}

/// The same, with its terms.
pub(crate) fn explained(
    left: &Features,
    right: &Features,
    params: &Params,
    passes: usize,
    cx: Context,
) -> Result<(PairScore, Vec<Earned>), NodeError> {
    let mut best: Option<(PairScore, Vec<Earned>)> = None;
    for log in stretch::factors(params) {
        cx.check()?;
        let model = Model::new(left, right, params, log.exp(), cx)?;
        let found = quick::best(&model, passes);
        let unmatched = left.features.len() + right.features.len() - 2 * found.len();
        let sum = |of: fn(&Earned) -> f64| found.iter().map(of).sum::<f64>();
        let score = PairScore {
            objective: sum(|t| t.alone + t.together) - params.unmatched * unmatched as f64,
            descriptors: sum(|t| t.alone),
            matched: found.len() as u32,
        };
        if best.as_ref().is_none_or(|(b, _)| score.objective > b.objective) {
            best = Some((score, found));
        }
    }
    best.ok_or_else(|| NodeError::new("no factor between the lengths was tried"))
}

/// The objective of a shape matched with itself, each described feature with itself.
pub(crate) fn own(shape: &Features, params: &Params) -> f64 {
    let described: Vec<usize> = (0..shape.features.len()).filter(|i| shape.descriptors[*i].is_ok()).collect();
    let reached = |i: usize| described.iter().filter(|j| **j != i && shape.distance(i, **j).is_some()).count();
    let supports: usize = described.iter().map(|i| reached(*i)).sum();
    let unmatched = 2 * (shape.features.len() - described.len());
    // Every kernel is 1 at 0, and H counts each pair twice.
    params.beta * described.len() as f64 + (1.0 - params.agreement) * supports as f64
        - params.unmatched * unmatched as f64
}

fn unbuildable(e: &assignment::ProblemError) -> NodeError {
    NodeError::new(format!("the matching problem cannot be built: {e}"))
}

fn unsolvable(e: SolveError) -> NodeError {
    match e {
        SolveError::Cancelled => NodeError::cancelled(),
        e => NodeError::new(e.to_string()),
    }
}

/// Workers of the run for the parts of the heuristics. What a cancelled run leaves out is never looked at.
fn lent(cx: Context) -> impl Fn(usize, &(dyn Fn(usize) + Sync)) {
    move |n, call| cx.each(n, call)
}

fn solve(problem: &Problem, limit: Limit, cx: Context) -> Result<Solution, NodeError> {
    let (node_limit, seconds) = match limit {
        Limit::Nodes(n) => (n, f64::INFINITY),
        Limit::Seconds(s) => (u64::MAX, s),
    };
    let stop = || seconds.is_finite() && cx.seconds() > seconds;
    let cancelled = || cx.cancelled();
    let progress = |p: &assignment::Progress| cx.progress(p.nodes as f64 / node_limit as f64);
    let limits = Limits { node_limit, ..Limits::default() };
    let spread = lent(cx);
    let control = Control { stop: &stop, cancelled: &cancelled, progress: &progress, spread: &spread };
    let solution = assignment::solve(problem, &limits, &control).map_err(unsolvable)?;
    cx.record("nodes", solution.nodes);
    Ok(solution)
}
