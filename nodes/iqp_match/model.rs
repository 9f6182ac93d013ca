//! Candidates, what they score alone (C) and in pairs (H).

use salient_kernels::assignment::{Problem, ProblemBuilder};
use salient_sdk::{Context, NodeError};

use super::{Compare, Kernel, Params, Scales, Unit};
use crate::patch_spectrum::Features;

/// A pair of features that may be matched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub left: usize,
    pub right: usize,
    /// Distance of their descriptors.
    pub distance: f64,
    /// Difference of the logarithms of their scales, each in its shape's unit.
    pub scale: f64,
}

impl Candidate {
    pub fn excludes(&self, other: &Self) -> bool {
        self.left == other.left || self.right == other.right
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Sigmas {
    pub descriptor: f64,
    pub geodesic: f64,
    pub scale: f64,
}

/// One shape, with what its lengths are divided by.
struct Side<'a> {
    features: &'a Features,
    unit: f64,
    /// Distances are divided by the geometric mean of two features' scales as well.
    by_scale: bool,
}

impl Side<'_> {
    fn distance(&self, i: usize, p: usize) -> Option<f64> {
        let f = self.features;
        let scale = if self.by_scale { (f.features[i].scale * f.features[p].scale).sqrt() } else { 1.0 };
        f.distance(i, p).map(|d| d / (self.unit * scale))
    }

    fn log_scale(&self, i: usize) -> f64 {
        (self.features.features[i].scale / self.unit).ln()
    }
}

/// The matching problem before it is handed to the solver.
pub(super) struct Model<'a> {
    left: Side<'a>,
    right: Side<'a>,
    params: &'a Params,
    pub candidates: Vec<Candidate>,
    pub sigmas: Sigmas,
}

impl<'a> Model<'a> {
    /// With left lengths enlarged by `stretch`.
    pub fn new(
        left: &'a Features,
        right: &'a Features,
        params: &'a Params,
        stretch: f64,
        cx: Context,
    ) -> Result<Self, NodeError> {
        let by_scale = params.unit == Unit::Scale;
        let unit = |f: &Features| if params.unit == Unit::Area { f.area.sqrt() } else { 1.0 };
        let mut model = Self {
            left: Side { features: left, unit: unit(left) / stretch, by_scale },
            right: Side { features: right, unit: unit(right), by_scale },
            params,
            candidates: Vec::new(),
            sigmas: Sigmas { descriptor: 1.0, geodesic: 1.0, scale: 1.0 },
        };
        cx.check()?;
        let all = model.all();
        cx.check()?;
        let count = params.candidates as usize;
        model.candidates = nearest(&all, count, |c| c.distance);
        let distances = model.candidates.iter().map(|c| c.distance).collect();
        model.sigmas.descriptor = params.sigma_descriptor.unwrap_or_else(|| median(distances));
        if params.scales == Scales::Absolute {
            let scales = model.candidates.iter().map(|c| c.scale.abs()).collect();
            model.sigmas.scale = params.sigma_scale.unwrap_or_else(|| median(scales));
            let reach = REACH * model.sigmas.scale;
            let near: Vec<Candidate> = all.into_iter().filter(|c| c.scale.abs() <= reach).collect();
            model.candidates = nearest(&near, count, |c| model.unlikeness(c));
        }
        model.set_relation_sigmas(cx)?;
        Ok(model)
    }

    /// Every pair of described features.
    fn all(&self) -> Vec<Candidate> {
        let (l, r) = (self.left.features, self.right.features);
        let mut all = Vec::new();
        for (left, a) in l.descriptors.iter().enumerate() {
            for (right, b) in r.descriptors.iter().enumerate() {
                if let (Ok(a), Ok(b)) = (a, b) {
                    let distance = a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
                    let scale = self.left.log_scale(left) - self.right.log_scale(right);
                    all.push(Candidate { left, right, distance, scale });
                }
            }
        }
        all
    }

    /// Squared distance of a candidate's two features, in sigmas.
    fn unlikeness(&self, c: &Candidate) -> f64 {
        let scale = if self.params.scales == Scales::Absolute { c.scale / self.sigmas.scale } else { 0.0 };
        (c.distance / self.sigmas.descriptor).powi(2) + scale * scale
    }

    fn set_relation_sigmas(&mut self, cx: Context) -> Result<(), NodeError> {
        let relative = self.params.scales == Scales::Relative;
        let (mut geodesic, mut scale) = (Vec::new(), Vec::new());
        if self.params.sigma_geodesic.is_none() || (relative && self.params.sigma_scale.is_none()) {
            for (i, a) in self.candidates.iter().enumerate() {
                cx.check()?;
                for b in self.candidates[i + 1..].iter().filter(|b| !a.excludes(b)) {
                    geodesic.extend(self.geodesic(a, b).filter(|g| g.is_finite()));
                    scale.push((a.scale - b.scale).abs());
                }
            }
        }
        self.sigmas.geodesic = self.params.sigma_geodesic.unwrap_or_else(|| median(geodesic));
        if relative {
            self.sigmas.scale = self.params.sigma_scale.unwrap_or_else(|| median(scale));
        }
        Ok(())
    }

    /// By how much two candidates disagree in the distance between their features. Infinite where a path leads on
    /// one side only, `None` where on neither.
    fn geodesic(&self, a: &Candidate, b: &Candidate) -> Option<f64> {
        match (self.left.distance(a.left, b.left), self.right.distance(a.right, b.right)) {
            (None, None) => None,
            (Some(l), Some(r)) => Some(match self.params.compare {
                Compare::Difference => (l - r).abs(),
                Compare::LogRatio => ((l + self.params.floor) / (r + self.params.floor)).ln().abs(),
            }),
            _ => Some(f64::INFINITY),
        }
    }

    fn kernel(&self, x: f64) -> f64 {
        match self.params.kernel {
            Kernel::Decaying => (-0.5 * x).exp(),
            Kernel::AsPrinted => (0.5 * x).min(2.0).exp(),
        }
    }

    /// `beta C(a)`.
    pub fn alone(&self, c: &Candidate) -> f64 {
        self.params.beta * self.kernel(self.unlikeness(c))
    }

    /// What a match saves: the cost of leaving its two features unmatched.
    pub fn saves(&self) -> f64 {
        2.0 * self.params.unmatched
    }

    /// `H(a, b) + H(b, a)`: each unordered pair of candidates is given once, and x' H x counts it twice.
    pub fn together(&self, a: &Candidate, b: &Candidate) -> f64 {
        if a.excludes(b) {
            return 0.0;
        }
        let Some(g) = self.geodesic(a, b) else { return 0.0 };
        let mut x = (g / self.sigmas.geodesic).powi(2);
        if self.params.scales == Scales::Relative {
            x += ((a.scale - b.scale) / self.sigmas.scale).powi(2);
        }
        2.0 * (self.kernel(x) - self.params.agreement)
    }

    /// The problem as the solver takes it.
    pub fn problem(&self, cx: Context) -> Result<Problem, NodeError> {
        let mut builder = ProblemBuilder::new(self.left.features.features.len(), self.right.features.features.len());
        for c in &self.candidates {
            builder.candidate(c.left, c.right, self.alone(c)).map_err(|e| super::unbuildable(&e))?;
        }
        for (i, a) in self.candidates.iter().enumerate() {
            cx.check()?;
            for (j, b) in self.candidates.iter().enumerate().skip(i + 1).filter(|(_, b)| !a.excludes(b)) {
                builder.pair(i, j, self.together(a, b)).map_err(|e| super::unbuildable(&e))?;
            }
        }
        builder.unmatched_cost(self.params.unmatched).map_err(|e| super::unbuildable(&e))?;
        cx.check()?;
        let problem = builder.build().map_err(|e| super::unbuildable(&e))?;
        cx.check()?;
        Ok(problem)
    }

    /// ln(right / left) of the distances between features that chosen candidates match, both above `floor`.
    pub fn log_ratios(&self, chosen: &[usize], floor: f64) -> Vec<f64> {
        let mut all = Vec::new();
        for (n, i) in chosen.iter().enumerate() {
            for j in &chosen[n + 1..] {
                let (a, b) = (&self.candidates[*i], &self.candidates[*j]);
                let both = (self.left.distance(a.left, b.left), self.right.distance(a.right, b.right));
                if let (Some(l), Some(r)) = both
                    && l.min(r) > floor
                {
                    all.push((r / l).ln());
                }
            }
        }
        all
    }

    /// Geodesic distance between two right features over the square root of the area.
    pub fn apart(&self, j: usize, q: usize) -> f64 {
        let f = self.right.features;
        f.distance(j, q).map_or(f64::INFINITY, |d| d / f.area.sqrt())
    }
}

/// Candidates whose scales differ by more than this many sigmas are not considered.
const REACH: f64 = 3.0;

/// The `count` nearest of each feature, both ways, each pair once, by (left, right).
fn nearest(all: &[Candidate], count: usize, key: impl Fn(&Candidate) -> f64) -> Vec<Candidate> {
    let mut kept = Vec::new();
    for side in [|c: &Candidate| c.left, |c: &Candidate| c.right] {
        let mut order: Vec<(usize, f64, &Candidate)> = all.iter().map(|c| (side(c), key(c), c)).collect();
        order.sort_by(|a, b| {
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2.left, a.2.right).cmp(&(b.2.left, b.2.right)))
        });
        for of_one in order.chunk_by(|a, b| a.0 == b.0) {
            kept.extend(of_one.iter().take(count).map(|(_, _, c)| **c));
        }
    }
    kept.sort_by_key(|c| (c.left, c.right));
    kept.dedup_by_key(|c| (c.left, c.right));
    kept
}

/// The median; of nothing, or where it is zero, 1 (any positive value then does the same).
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 1.0;
    }
    let middle = values.len() / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if *median > 0.0 { *median } else { 1.0 }
}
