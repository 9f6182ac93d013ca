//! A subproblem of the search: some variables chosen, some excluded; and the subproblems of its branches.

use super::lap::FORBIDDEN;
use super::model::Model;
use super::relax::Guide;
use super::symmetry::Symmetry;

/// A branch of a subproblem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Branch {
    /// This variable (local index) is chosen.
    Take(u32),
    /// This left feature (local index) stays unmatched.
    DropLeft(u32),
    /// This right feature (local index) stays unmatched.
    DropRight(u32),
}

pub(super) struct Sub {
    /// Objective of what is chosen.
    pub base: i64,
    /// Model variables chosen so far.
    pub fixed: Vec<u32>,
    /// Model variable of each local one.
    pub vars: Vec<u32>,
    pub left: Vec<u32>,
    pub right: Vec<u32>,
    /// First variable of each local left feature.
    pub start: Vec<u32>,
    pub n_right: usize,
    pub c: Vec<i64>,
    pub star: Vec<i64>,
    /// Entries: both directions of every pair, columns ascending in each row.
    pub row: Vec<u32>,
    pub col: Vec<u32>,
    pub mate: Vec<u32>,
    /// Shares: `w[e] + w[mate[e]]` is the pair's score. [`FORBIDDEN`] if no better assignment has both.
    pub w: Vec<i64>,
    /// With the duals `u`, `v`: by how much the bound falls, at least, if a variable is chosen.
    pub slack: Vec<i64>,
    pub u: Vec<i64>,
    pub v: Vec<i64>,
    pub bound: i64,
    /// The leaders' assignment at the last bound, as local variables.
    pub matching: Vec<u32>,
    pub mandatory: bool,
    pub dense: bool,
    pub limit: i64,
    /// One unit of the relaxation's scores.
    pub unit: f64,
    pub guide: Guide,
}

impl Sub {
    pub fn root(m: &Model) -> Self {
        let n = m.left.len();
        let mut next: Vec<u32> = m.row[..n].iter().map(|&e| e as u32).collect();
        let (mut mate, mut w) = (Vec::with_capacity(m.col.len()), Vec::with_capacity(m.col.len()));
        // Rows ascend, so the entries of column b are met in the order in which row b lists them.
        for a in 0..n {
            let range = m.row[a]..m.row[a + 1];
            for (&b, &h) in m.col[range.clone()].iter().zip(&m.val[range]) {
                let b = b as usize;
                mate.push(next[b]);
                next[b] += 1;
                w.push(if b < a { h >> 1 } else { h - (h >> 1) });
            }
        }
        let largest = m.linear.iter().chain(&m.val).map(|v| v.unsigned_abs()).max().unwrap_or(1);
        let entries = m.col.len();
        let mut sub = Self {
            base: 0,
            fixed: Vec::new(),
            vars: (0..n as u32).collect(),
            left: m.left.clone(),
            right: m.right.clone(),
            start: Vec::new(),
            n_right: m.n_right,
            c: m.linear.clone(),
            star: vec![0; n],
            row: m.row.iter().map(|&r| r as u32).collect(),
            col: m.col.clone(),
            mate,
            w,
            slack: vec![0; n],
            u: Vec::new(),
            v: Vec::new(),
            bound: i64::MAX,
            matching: Vec::new(),
            mandatory: m.mandatory,
            dense: m.dense,
            limit: m.limit,
            unit: largest.max(1) as f64,
            guide: Guide {
                x: vec![0.0; n],
                p: [vec![0.0; m.n_left], vec![0.0; m.n_right]],
                y: vec![0.0; entries],
                q: [vec![0.0; entries], vec![0.0; entries]],
                weight: 1.0,
            },
        };
        sub.index_lefts(m.n_left);
        sub
    }

    fn index_lefts(&mut self, n_left: usize) {
        self.start = vec![0; n_left + 1];
        for &k in &self.left {
            self.start[k as usize + 1] += 1;
        }
        for k in 0..n_left {
            self.start[k + 1] += self.start[k];
        }
    }

    pub fn n_left(&self) -> usize {
        self.start.len() - 1
    }

    /// Bytes held, for the search's memory limit.
    pub fn bytes(&self) -> usize {
        28 * self.col.len() + 52 * self.vars.len() + 20 * (self.n_left() + self.n_right) + 400
    }

    pub fn entries(&self, a: usize) -> std::ops::Range<usize> {
        self.row[a] as usize..self.row[a + 1] as usize
    }

    pub fn alive(&self, a: usize) -> bool {
        self.c[a] != FORBIDDEN
    }

    /// The chosen variables together with the leaders' assignment: an assignment of the whole problem.
    pub fn completion(&self) -> Vec<u32> {
        let rest = self.matching.iter().map(|&a| self.vars[a as usize]);
        self.fixed.iter().copied().chain(rest).collect()
    }

    /// Excludes a variable.
    pub fn kill(&mut self, a: usize) {
        self.c[a] = FORBIDDEN;
        for e in self.entries(a) {
            self.forbid(e);
        }
    }

    /// Excludes a pair.
    pub fn forbid(&mut self, e: usize) {
        self.w[e] = FORBIDDEN;
        self.w[self.mate[e] as usize] = FORBIDDEN;
    }

    /// Gives entry `e` this share of its pair's score, and its mate the rest; both stay in the range that keeps sums inside `i64`.
    pub fn split(&mut self, e: usize, share: f64) {
        let mate = self.mate[e] as usize;
        let total = self.w[e] + self.w[mate];
        // Casting from floating point saturates, and turns NaN into 0.
        let most = self.limit / 2;
        self.w[e] = (share as i64).clamp(-most, most);
        self.w[mate] = total - self.w[e];
    }

    /// The branches on the feature whose branches have the lowest bounds, best bound first. Call after [`Self::ascend`].
    /// Of branches that are images of each other under a `symmetry` one is given.
    pub fn branches(&self, threshold: i64, m: &Model, symmetry: Option<&Symmetry>) -> Vec<(i64, Branch)> {
        let mut best: Option<(i64, Vec<(i64, Branch)>)> = None;
        let mut consider = |mut options: Vec<(i64, Branch)>, of_left: bool| {
            if let Some(symmetry) = symmetry {
                options.sort_by_key(|o| o.0);
                self.merge(&mut options, m, symmetry, of_left);
            }
            // What is left to search below; measured to give half as many nodes as the sum of squares.
            let weight: i64 = options.iter().map(|o| (o.0 - threshold).max(0)).fold(0, i64::saturating_add);
            if best.as_ref().is_none_or(|b| weight < b.0) {
                best = Some((weight, options));
            }
        };
        let take = |a: usize| (self.bound - self.slack[a], Branch::Take(a as u32));
        for k in 0..self.n_left() {
            let range = self.start[k] as usize..self.start[k + 1] as usize;
            let mut options: Vec<_> = range.filter(|&a| self.alive(a)).map(take).collect();
            if options.is_empty() {
                continue;
            }
            if !self.mandatory {
                options.push((self.bound - self.u[k], Branch::DropLeft(k as u32)));
            }
            consider(options, true);
        }
        let mut of_right: Vec<Vec<(i64, Branch)>> = vec![Vec::new(); self.n_right];
        (0..self.vars.len()).filter(|&a| self.alive(a)).for_each(|a| of_right[self.right[a] as usize].push(take(a)));
        let all_used = self.mandatory && self.n_left() == self.n_right;
        for (l, mut options) in of_right.into_iter().enumerate() {
            if options.is_empty() {
                continue;
            }
            if !all_used {
                options.push((self.bound - self.v[l], Branch::DropRight(l as u32)));
            }
            consider(options, false);
        }
        let mut options = best.map(|b| b.1).unwrap_or_default();
        options.retain(|o| o.0 > threshold);
        options.sort_by_key(|o| std::cmp::Reverse(o.0));
        options
    }

    /// Keeps the first of the options, all on one left or all on one right, that symmetries take to each other.
    fn merge(&self, options: &mut Vec<(i64, Branch)>, m: &Model, symmetry: &Symmetry, of_left: bool) {
        let feature = |v: u32| if of_left { m.right[v as usize] } else { m.left[v as usize] };
        let fixed: Vec<u32> = self.fixed.iter().map(|&v| feature(v)).collect();
        let mut kept: Vec<u32> = Vec::new();
        options.retain(|(_, branch)| {
            let Branch::Take(a) = *branch else { return true };
            let own = feature(self.vars[a as usize]);
            let new = !kept.iter().any(|&other| symmetry.exchanges(!of_left, &fixed, own, other));
            if new {
                kept.push(own);
            }
            new
        });
    }

    /// The subproblem of a branch.
    pub fn child(&self, branch: Branch) -> Self {
        let n = self.vars.len();
        let mut keep: Vec<bool> = (0..n).map(|a| self.alive(a)).collect();
        let mut c = self.c.clone();
        let (mut base, mut fixed) = (self.base, self.fixed.clone());
        let (mut gone_left, mut gone_right) = (u32::MAX, u32::MAX);
        match branch {
            Branch::Take(a) => {
                let a = a as usize;
                (gone_left, gone_right) = (self.left[a], self.right[a]);
                base += self.c[a];
                fixed.push(self.vars[a]);
                // Where every compatible pair has an entry, a missing one has been excluded.
                let mut allowed = vec![!self.dense; n];
                for e in self.entries(a) {
                    let b = self.col[e] as usize;
                    allowed[b] = self.w[e] != FORBIDDEN;
                    if allowed[b] && keep[b] {
                        c[b] += self.w[e] + self.w[self.mate[e] as usize];
                    }
                }
                keep.iter_mut().zip(allowed).for_each(|(k, yes)| *k &= yes);
            }
            Branch::DropLeft(k) => gone_left = k,
            Branch::DropRight(l) => gone_right = l,
        }
        for (a, keep) in keep.iter_mut().enumerate() {
            *keep &= self.left[a] != gone_left && self.right[a] != gone_right;
        }
        let mut sub = self.compress(&keep, gone_left, gone_right);
        sub.c = c.into_iter().zip(keep).filter(|c| c.1).map(|c| c.0).collect();
        (sub.base, sub.fixed) = (base, fixed);
        sub
    }

    /// Without what has been excluded.
    pub fn compact(&self) -> Self {
        let keep: Vec<bool> = (0..self.vars.len()).map(|a| self.alive(a)).collect();
        self.compress(&keep, u32::MAX, u32::MAX)
    }

    fn compress(&self, keep: &[bool], gone_left: u32, gone_right: u32) -> Self {
        let n = self.vars.len();
        let kept: Vec<usize> = (0..n).filter(|&a| keep[a]).collect();
        let mut index = vec![u32::MAX; n];
        kept.iter().enumerate().for_each(|(at, &a)| index[a] = at as u32);
        let mut place = vec![u32::MAX; self.col.len()];
        let (mut row, mut col, mut old) = (vec![0_u32], Vec::new(), Vec::new());
        for &a in &kept {
            for e in self.entries(a) {
                // A forbidden pair may be left out only where an absent entry means just that.
                if keep[self.col[e] as usize] && !(self.dense && self.w[e] == FORBIDDEN) {
                    place[e] = col.len() as u32;
                    col.push(index[self.col[e] as usize]);
                    old.push(e);
                }
            }
            row.push(col.len() as u32);
        }
        // Where no feature goes (an index that none has) nothing shifts.
        let shift = |gone: u32, f: u32| f - u32::from(gone < f);
        let without = |p: &[f32], gone: u32| -> Vec<f32> {
            p.iter().enumerate().filter(|f| f.0 as u32 != gone).map(|f| *f.1).collect()
        };
        let of_entries = |v: &[f32]| -> Vec<f32> { old.iter().map(|&e| v[e]).collect() };
        let mut sub = Self {
            base: self.base,
            fixed: self.fixed.clone(),
            vars: kept.iter().map(|&a| self.vars[a]).collect(),
            left: kept.iter().map(|&a| shift(gone_left, self.left[a])).collect(),
            right: kept.iter().map(|&a| shift(gone_right, self.right[a])).collect(),
            start: Vec::new(),
            n_right: self.n_right - usize::from(gone_right != u32::MAX),
            c: kept.iter().map(|&a| self.c[a]).collect(),
            star: vec![0; kept.len()],
            mate: old.iter().map(|&e| place[self.mate[e] as usize]).collect(),
            w: old.iter().map(|&e| self.w[e]).collect(),
            slack: vec![0; kept.len()],
            u: Vec::new(),
            v: Vec::new(),
            bound: self.bound,
            matching: Vec::new(),
            mandatory: self.mandatory,
            dense: self.dense,
            limit: self.limit,
            unit: self.unit,
            guide: Guide {
                x: kept.iter().map(|&a| self.guide.x[a]).collect(),
                p: [without(&self.guide.p[0], gone_left), without(&self.guide.p[1], gone_right)],
                y: of_entries(&self.guide.y),
                q: [of_entries(&self.guide.q[0]), of_entries(&self.guide.q[1])],
                weight: self.guide.weight,
            },
            row,
            col,
        };
        sub.index_lefts(self.n_left() - usize::from(gone_left != u32::MAX));
        sub
    }
}
