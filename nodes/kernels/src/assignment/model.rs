//! The problem in integers: scaled by a power of two, rounded up, costs of unmatched features folded into the candidates.

use super::problem::Problem;

/// Candidates are *variables* here, in the order of (left, right); the left side is the one that must be matched, if one must.
/// With `nulls`, the last part of each left's variables is its own "unmatched" variable, on a right feature of its own.
pub(super) struct Model {
    pub n_left: usize,
    pub n_right: usize,
    pub left: Vec<u32>,
    pub right: Vec<u32>,
    /// Index of the candidate in the problem, `None` for a null variable.
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

/// Above this many entries (16 bytes each) zeros are not stored: the bound is then weaker for negative scores, and still valid.
const DENSE_ENTRIES: usize = 3_000_000;

impl Model {
    /// `Self` for the heuristics has no nulls; `bounding` adds what the dual bound profits from.
    pub fn new(p: &Problem, bounding: bool) -> Self {
        let flip = p.must_match_all && p.n_left > p.n_right;
        let (n_left, n_right) = if flip { (p.n_right, p.n_left) } else { (p.n_left, p.n_right) };
        let negative = p.val.iter().any(|&h| h < 0.0);
        let nulls = bounding && negative && !p.must_match_all;
        let size = p.candidates.len() + if nulls { n_left } else { 0 };
        let dense = bounding && (negative || p.must_match_all) && size.saturating_mul(size) <= DENSE_ENTRIES;
        let nulls = nulls && dense;
        let grid = Grid::new(p, n_left);
        let mut order: Vec<(u32, u32, Option<usize>)> = p
            .candidates
            .iter()
            .enumerate()
            .map(|(a, &(i, j))| if flip { (j as u32, i as u32, Some(a)) } else { (i as u32, j as u32, Some(a)) })
            .collect();
        if nulls {
            order.extend((0..n_left).map(|i| (i as u32, (n_right + i) as u32, None)));
        }
        order.sort_unstable_by_key(|v| (v.0, v.1));
        let linear = order.iter().map(|v| v.2.map_or(0, |a| grid.candidate(p, a))).collect();
        let mut model = Self {
            n_left,
            n_right: n_right + if nulls { n_left } else { 0 },
            left: order.iter().map(|v| v.0).collect(),
            right: order.iter().map(|v| v.1).collect(),
            source: order.iter().map(|v| v.2).collect(),
            linear,
            row: vec![0],
            col: Vec::new(),
            val: Vec::new(),
            constant: -p.left_cost.iter().chain(&p.right_cost).map(|&c| grid.down(c)).sum::<i64>(),
            mandatory: p.must_match_all || nulls,
            dense,
            step: 1,
            limit: grid.limit,
            exponent: grid.exponent,
        };
        model.fill_pairs(p, &grid);
        let common = model.linear.iter().chain(&model.val).fold(0, |g, &v| gcd(g, v.unsigned_abs()));
        model.step = (common as i64).max(1);
        model
    }

    fn fill_pairs(&mut self, p: &Problem, grid: &Grid) {
        let mut variable = vec![0_u32; p.candidates.len()];
        for (v, a) in self.source.iter().enumerate() {
            if let Some(a) = *a {
                variable[a] = v as u32;
            }
        }
        let mut own: Vec<(u32, i64)> = Vec::new();
        for v in 0..self.left.len() {
            own.clear();
            if let Some(a) = self.source[v] {
                own.extend((p.row[a]..p.row[a + 1]).map(|e| (variable[p.col[e] as usize], grid.up(p.val[e]))));
                own.sort_unstable();
            }
            if self.dense {
                let mut at = 0;
                for b in 0..self.left.len() {
                    if self.left[b] == self.left[v] || self.right[b] == self.right[v] {
                        continue;
                    }
                    let given = own.get(at).filter(|e| e.0 as usize == b);
                    at += usize::from(given.is_some());
                    self.col.push(b as u32);
                    self.val.push(given.map_or(0, |e| e.1));
                }
            } else {
                self.col.extend(own.iter().map(|e| e.0));
                self.val.extend(own.iter().map(|e| e.1));
            }
            self.row.push(self.col.len());
        }
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
    pub fn resolution(&self, p: &Problem) -> f64 {
        let n = p.n_left.min(p.n_right) as f64;
        let exact = |v: &f64| scale(*v, self.exponent).fract() == 0.0;
        let all = p.linear.iter().chain(&p.val).chain(&p.left_cost).chain(&p.right_cost);
        if all.into_iter().all(exact) {
            return 0.0;
        }
        unscale(n * (n - 1.0) / 2.0 + n + (p.n_left + p.n_right) as f64, self.exponent)
    }
}

/// Real scores to integers.
struct Grid {
    exponent: i32,
    limit: i64,
}

impl Grid {
    fn new(p: &Problem, n_left: usize) -> Self {
        // No objective exceeds, in magnitude, the sum over lefts of the best |c| + star of |h|, plus all the costs.
        let mut best = vec![0.0_f64; p.n_left];
        let mut group = vec![0.0_f64; p.n_left];
        for (a, &(i, _)) in p.candidates.iter().enumerate() {
            let range = p.row[a]..p.row[a + 1];
            let lefts = || p.col[range.clone()].iter().map(|&b| p.candidates[b as usize].0);
            lefts().zip(&p.val[range.clone()]).for_each(|(k, h)| group[k] = group[k].max(h.abs()));
            let mut star = p.linear[a].abs();
            lefts().for_each(|k| star += std::mem::take(&mut group[k]));
            best[i] = best[i].max(star);
        }
        let total = best.iter().chain(&p.left_cost).chain(&p.right_cost).map(|v| v.abs()).sum::<f64>();
        let limit = (1_i64 << 60) / (n_left.max(p.n_left).max(p.n_right) as i64 + 4);
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

    /// A chosen candidate also saves the costs of its two features.
    fn candidate(&self, p: &Problem, a: usize) -> i64 {
        let (i, j) = p.candidates[a];
        self.up(p.linear[a]) + self.up(p.left_cost[i]) + self.up(p.right_cost[j])
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
