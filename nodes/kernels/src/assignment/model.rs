//! The problem in integers: scaled by a power of two, rounded up, costs of unmatched features folded into the candidates.

use super::canonical::Canonical;
use crate::stop::{Pace, Stop};

/// Candidates are *variables* here, in canonical order. If one side must be matched, it is the left one.
/// With null variables, each left's last one stands for "unmatched", on a right feature of its own.
#[derive(Clone)]
pub(super) struct Model {
    pub n_left: usize,
    pub n_right: usize,
    pub left: Vec<u32>,
    pub right: Vec<u32>,
    /// Index of the candidate in the canonical form, `None` for a null variable.
    pub source: Vec<Option<usize>>,
    pub linear: Vec<i64>,
    pub row: Vec<usize>,
    pub col: Vec<u32>,
    pub val: Vec<i64>,
    /// Added to every objective.
    pub constant: i64,
    /// Every left must take a variable (its null variable counts).
    pub mandatory: bool,
    /// Every two compatible variables have an entry, possibly 0; stars may then insist on serving every left.
    pub dense: bool,
    /// Objectives (without the constant) are multiples of this.
    pub step: i64,
    /// No share of a pair term may leave [-limit, limit]: keeps every sum inside `i64`.
    pub limit: i64,
    exponent: i32,
}

/// Above this many entries (16 bytes each) no zeros are stored: the bound is then weaker for negative scores, and still valid.
const MOST_ENTRIES: usize = 3_000_000;

impl Model {
    /// What the heuristics work on: variables are candidates, scores are as given.
    pub fn plain(p: &Canonical) -> Self {
        let grid = Grid::new(p);
        let candidate = |a: usize| {
            // A chosen candidate also saves the costs of its two features.
            let (i, j) = p.candidates[a];
            grid.up(p.linear[a]) + grid.up(p.cost[0][i as usize]) + grid.up(p.cost[1][j as usize])
        };
        let mut model = Self {
            n_left: p.n[0],
            n_right: p.n[1],
            left: p.candidates.iter().map(|c| c.0).collect(),
            right: p.candidates.iter().map(|c| c.1).collect(),
            source: (0..p.candidates.len()).map(Some).collect(),
            linear: (0..p.candidates.len()).map(candidate).collect(),
            row: p.row.clone(),
            col: p.col.clone(),
            val: p.val.iter().map(|&h| grid.up(h)).collect(),
            constant: -p.cost.iter().flatten().map(|&c| grid.down(c)).sum::<i64>(),
            mandatory: p.must_match_all,
            dense: false,
            step: 1,
            limit: grid.limit,
            exponent: grid.exponent,
        };
        let common = model.linear.iter().chain(&model.val).fold(0, |g, &v| gcd(g, v.unsigned_abs()));
        model.step = (common as i64).max(1);
        model
    }

    /// What the bound works on: the same problem, stated so that the relaxation is tighter. Of no use if `cancelled`.
    pub fn bounding(&self, cancelled: Stop) -> Self {
        let size = self.left.len();
        let better = if self.mandatory {
            (size.saturating_mul(size) <= MOST_ENTRIES).then(|| self.densified())
        } else {
            let lifts = self.val.iter().any(|&h| h < 0);
            lifts.then(|| self.lifted(&Pace::new(cancelled, 16))).flatten()
        };
        better.unwrap_or_else(|| self.clone())
    }

    /// With an entry, perhaps 0, for every two compatible variables.
    fn densified(&self) -> Self {
        let (mut row, mut col, mut val) = (vec![0], Vec::new(), Vec::new());
        for a in 0..self.left.len() {
            let mut at = self.row[a];
            for b in 0..self.left.len() {
                if self.left[b] == self.left[a] || self.right[b] == self.right[a] {
                    continue;
                }
                let given = at < self.row[a + 1] && self.col[at] as usize == b;
                col.push(b as u32);
                val.push(if given { self.val[at] } else { 0 });
                at += usize::from(given);
            }
            row.push(col.len());
        }
        Self { row, col, val, dense: true, ..self.clone() }
    }

    /// Without negative pair terms. A relaxation with `y_ab >= 0` alone would ignore them. Let `z_k` be 1 if left `k` is unmatched. Then
    ///
    /// ```text
    /// x_a = sum_{b of k} x_a x_b + x_a z_k
    /// ```
    ///
    /// so that `s` can be added to every pair term of `a` with the candidates of `k`, and to that of `a` and `z_k`, if it is subtracted
    /// from `c_a`. With `s` = the most negative `h_ab`, from both ends, no term is negative any more.
    ///
    /// `None` if that has too many entries, or the caller says to stop.
    fn lifted(&self, pace: &Pace) -> Option<Self> {
        let (n, n_left) = (self.left.len(), self.n_left);
        let mut first = vec![0; n_left + 1];
        self.left.iter().for_each(|&k| first[k as usize + 1] += 1);
        (0..n_left).for_each(|k| first[k + 1] += first[k]);
        // Each left's candidates, then what stands for "unmatched".
        let place = |a: usize| a + self.left[a] as usize;
        let null = |k: usize| first[k + 1] + k;
        let (of_candidate, of_left) = self.lifts();
        let (mut row, mut col, mut val) = (vec![0], Vec::new(), Vec::new());
        let (mut linear, mut source) = (Vec::new(), Vec::new());
        let mut line = Line { sum: vec![0; n + n_left], met: vec![false; n + n_left], at: Vec::new() };
        for k in 0..n_left {
            for a in first[k]..first[k + 1] {
                if pace.ends() || col.len() > MOST_ENTRIES {
                    return None;
                }
                let fits = |b: &usize| self.right[*b] != self.right[a];
                (self.row[a]..self.row[a + 1]).for_each(|e| line.add(place(self.col[e] as usize), self.val[e]));
                for &(other, s) in &of_candidate[a] {
                    (first[other]..first[other + 1]).filter(fits).for_each(|b| line.add(place(b), s));
                    line.add(null(other), s);
                }
                of_left[k].iter().filter(|(b, _)| fits(b)).for_each(|&(b, s)| line.add(place(b), s));
                line.end(&mut row, &mut col, &mut val);
                linear.push(self.linear[a] - of_candidate[a].iter().map(|l| l.1).sum::<i64>());
                source.push(Some(a));
            }
            of_left[k].iter().for_each(|&(b, s)| line.add(place(b), s));
            line.end(&mut row, &mut col, &mut val);
            linear.push(0);
            source.push(None);
        }
        let (mut left, mut right) = (Vec::new(), Vec::new());
        for k in 0..n_left {
            let own = &self.right[first[k]..first[k + 1]];
            right.extend(own.iter().copied().chain([(self.n_right + k) as u32]));
            left.resize(right.len(), k as u32);
        }
        let n_right = self.n_right + n_left;
        let lifted = Self { n_right, left, right, source, linear, row, col, val, mandatory: true, ..self.clone() };
        (lifted.col.len() <= MOST_ENTRIES).then_some(lifted)
    }

    /// For each candidate the lefts whose pair terms with it are lifted, and by how much; and the same by left.
    fn lifts(&self) -> (Vec<Lifts>, Vec<Lifts>) {
        let (mut of_candidate, mut of_left) = (Vec::new(), vec![Lifts::new(); self.n_left]);
        let mut lift = vec![0_i64; self.n_left];
        for a in 0..self.left.len() {
            let entries = self.row[a]..self.row[a + 1];
            let lefts = || entries.clone().map(|e| (self.left[self.col[e] as usize] as usize, self.val[e]));
            lefts().for_each(|(k, h)| lift[k] = lift[k].max(-h));
            let mut own = Lifts::new();
            for (k, _) in lefts() {
                let s = std::mem::take(&mut lift[k]);
                if s > 0 {
                    own.push((k, s));
                    of_left[k].push((a, s));
                }
            }
            of_candidate.push(own);
        }
        (of_candidate, of_left)
    }

    /// The pair term of two variables.
    pub fn pair(&self, a: usize, b: usize) -> i64 {
        let range = self.row[a]..self.row[a + 1];
        self.col[range.clone()].binary_search(&(b as u32)).map_or(0, |at| self.val[range.start + at])
    }

    /// A real number at or above an integer bound (which excludes the constant).
    pub fn to_real(&self, bound: i64) -> f64 {
        let total = i128::from(bound) + i128::from(self.constant);
        let mut real = total as f64;
        if (real as i128) < total {
            real = real.next_up();
        }
        let result = unscale(real, self.exponent);
        // Only among subnormal numbers can scaling back round.
        if scale(result, self.exponent) < real { result.next_up() } else { result }
    }

    /// By how much at most the integer objective of an assignment exceeds its real one; 0 if scaling rounded nothing.
    pub fn resolution(&self, p: &Canonical) -> f64 {
        let n = p.n[0] as f64;
        let exact = |v: &f64| scale(*v, self.exponent).fract() == 0.0;
        if p.linear.iter().chain(&p.val).chain(p.cost.iter().flatten()).all(exact) {
            return 0.0;
        }
        unscale(n * (n - 1.0) / 2.0 + n + (p.n[0] + p.n[1]) as f64, self.exponent)
    }
}

/// A left (or a candidate), and what is added to its pair terms.
type Lifts = Vec<(usize, i64)>;

/// A row of a matrix while it is summed up.
struct Line {
    sum: Vec<i64>,
    met: Vec<bool>,
    at: Vec<u32>,
}

impl Line {
    fn add(&mut self, at: usize, h: i64) {
        self.sum[at] += h;
        if !std::mem::replace(&mut self.met[at], true) {
            self.at.push(at as u32);
        }
    }

    /// Writes the row, columns ascending, and begins another.
    fn end(&mut self, row: &mut Vec<usize>, col: &mut Vec<u32>, val: &mut Vec<i64>) {
        self.at.sort_unstable();
        for b in self.at.drain(..) {
            self.met[b as usize] = false;
            col.push(b);
            val.push(std::mem::take(&mut self.sum[b as usize]));
        }
        row.push(col.len());
    }
}

/// Real scores to integers.
struct Grid {
    exponent: i32,
    limit: i64,
}

impl Grid {
    fn new(p: &Canonical) -> Self {
        // No objective exceeds, in magnitude, the sum over lefts of the best |c| + star of |h|, plus all the costs.
        let mut best = vec![0.0_f64; p.n[0]];
        let mut group = vec![0.0_f64; p.n[0]];
        for (a, &(i, _)) in p.candidates.iter().enumerate() {
            let range = p.row[a]..p.row[a + 1];
            let lefts = || p.col[range.clone()].iter().map(|&b| p.candidates[b as usize].0 as usize);
            lefts().zip(&p.val[range.clone()]).for_each(|(k, h)| group[k] = group[k].max(h.abs()));
            let mut star = p.linear[a].abs();
            lefts().for_each(|k| star += std::mem::take(&mut group[k]));
            let best = &mut best[i as usize];
            *best = best.max(star);
        }
        let total = best.iter().chain(p.cost.iter().flatten()).map(|v| v.abs()).sum::<f64>();
        let limit = (1_i64 << 60) / (p.n[1] as i64 + 4);
        let room = (limit >> 6) as f64;
        let exponent =
            if total > 0.0 { (room.log2() - total.log2()).floor().clamp(-2000.0, 2000.0) as i32 - 1 } else { 0 };
        Self { exponent, limit }
    }

    fn up(&self, x: f64) -> i64 {
        let y = scale(x, self.exponent);
        // Underflow must not round a positive score down.
        if y == 0.0 && x > 0.0 { 1 } else { y.ceil() as i64 }
    }

    fn down(&self, x: f64) -> i64 {
        -self.up(-x)
    }
}

/// `x * 2^exponent`, in two steps since one factor alone may overflow.
fn scale(x: f64, exponent: i32) -> f64 {
    x * 2.0_f64.powi(exponent / 2) * 2.0_f64.powi(exponent - exponent / 2)
}

fn unscale(x: f64, exponent: i32) -> f64 {
    scale(x, -exponent)
}

fn gcd(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}
