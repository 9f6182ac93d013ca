//! The dual bound of a subproblem, its ascent, and the subproblems of its branches.
//!
//! A subproblem keeps, for its variables, leader scores `c_a` and shares `w_ab` with `w_ab + w_ba = h_ab`. With `star_a` the
//! optimum of the assignment problem over row `a`, every assignment `x` satisfies
//!
//! ```text
//! objective(x) <= base + sum_a (c_a + star_a) x_a <= base + LAP(c + star)
//! ```
//!
//! With the duals of all these assignment problems at hand the difference is a sum of nonnegative slacks: `R_a` for each chosen
//! variable, `u_k + v_l - w_ab` for each chosen ordered pair, and more. Slack is what the ascent moves: raising `w_ab` by the slack of
//! its entry, plus a part of `R_a`, leaves `a`'s side of the bound as it was and lowers `w_ba`. Slack also excludes: a variable, or pair, whose slack
//! exceeds the gap to the best known assignment cannot be part of a better one.

use super::lap::{FORBIDDEN, Lap};
use super::model::Model;

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

/// What the ascent came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// Nothing in here is better than the best known.
    Pruned,
    /// An upper bound on the objective (without the model's constant).
    Bound(i64),
}

/// Settings of one ascent.
pub(super) struct Ascent<'a> {
    /// Prune at or below this bound.
    pub threshold: i64,
    /// At most this many sweeps.
    pub sweeps: usize,
    /// Stop a sweep-by-sweep ascent when this many more sweeps at the present rate would not reach the threshold.
    pub patience: i64,
    pub stop: &'a dyn Fn() -> bool,
}

pub(super) struct Sub {
    base: i64,
    /// Model variables chosen so far.
    pub fixed: Vec<u32>,
    /// Model variable of each local one.
    vars: Vec<u32>,
    left: Vec<u32>,
    right: Vec<u32>,
    /// First variable of each local left feature.
    start: Vec<u32>,
    n_right: usize,
    c: Vec<i64>,
    star: Vec<i64>,
    row: Vec<u32>,
    col: Vec<u32>,
    mate: Vec<u32>,
    w: Vec<i64>,
    leader: Vec<i64>,
    slack: Vec<i64>,
    u: Vec<i64>,
    v: Vec<i64>,
    bound: i64,
    /// The leaders' assignment at the last bound, as local variables.
    matching: Vec<u32>,
    mandatory: bool,
    dense: bool,
    limit: i64,
}

/// Buffers shared by all subproblems of a search.
#[derive(Default)]
pub(super) struct Scratch {
    lap: Lap,
    star: Lap,
    start: Vec<u32>,
    rights: Vec<u32>,
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
            leader: Vec::new(),
            slack: vec![0; n],
            u: Vec::new(),
            v: Vec::new(),
            bound: i64::MAX,
            matching: Vec::new(),
            mandatory: m.mandatory,
            dense: m.dense,
            limit: m.limit,
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

    fn n_left(&self) -> usize {
        self.start.len() - 1
    }

    /// Bytes held, for the search's memory limit.
    pub fn bytes(&self) -> usize {
        16 * self.col.len() + 48 * self.vars.len() + 12 * (self.n_left() + self.n_right) + 256
    }

    fn entries(&self, a: usize) -> std::ops::Range<usize> {
        self.row[a] as usize..self.row[a + 1] as usize
    }

    fn alive(&self, a: usize) -> bool {
        self.c[a] != FORBIDDEN
    }

    /// The chosen variables together with the leaders' assignment: an assignment of the whole problem.
    pub fn completion(&self) -> Vec<u32> {
        let rest = self.matching.iter().map(|&a| self.vars[a as usize]);
        self.fixed.iter().copied().chain(rest).collect()
    }

    /// Lowers the bound sweep by sweep. Every state in between is valid, so that it may be stopped at any time.
    pub fn ascend(&mut self, s: &mut Scratch, how: &Ascent) -> Outcome {
        self.stars(s, None);
        if self.lead(s, how.threshold) {
            return Outcome::Pruned;
        }
        // Single sweeps may gain nothing on the way; three in a row seldom.
        let mut recent = [0_i64; 3];
        for sweep in 0..how.sweeps {
            if (how.stop)() || self.vars.is_empty() {
                break;
            }
            let before = self.bound;
            self.spread();
            self.stars(s, Some((how.threshold, sweep)));
            if self.lead(s, how.threshold) {
                return Outcome::Pruned;
            }
            recent = [recent[1], recent[2], before - self.bound];
            let missing = self.bound - how.threshold;
            if sweep >= 2 && recent.iter().sum::<i64>().saturating_mul(how.patience) < 3 * missing {
                break;
            }
        }
        Outcome::Bound(self.bound)
    }

    /// Solves every star; with `push` (threshold and number of the sweep, odd ones backwards), moves slack.
    fn stars(&mut self, s: &mut Scratch, push: Option<(i64, usize)>) {
        let n = self.vars.len();
        for at in 0..n {
            let a = if push.is_some_and(|p| p.1 % 2 == 1) { n - 1 - at } else { at };
            if !self.alive(a) {
                continue;
            }
            let range = self.entries(a);
            s.rights.clear();
            s.start.clear();
            s.start.push(0);
            for e in range.clone() {
                let b = self.col[e] as usize;
                while s.start.len() <= self.left[b] as usize {
                    s.start.push((e - range.start) as u32);
                }
                s.rights.push(self.right[b]);
            }
            s.start.resize(self.n_left() + 1, range.len() as u32);
            let own = self.left[a] as usize;
            let value = s.star.solve(&s.start, &s.rights, &self.w[range], self.n_right, !self.dense, own);
            let Some(value) = value else {
                self.kill(a);
                continue;
            };
            self.star[a] = value;
            if let Some((threshold, _)) = push {
                self.push(s, a, threshold);
            }
        }
    }

    /// The most entries of a row that one assignment can use.
    fn others(&self) -> i64 {
        (self.n_left().min(self.n_right) as i64 - 1).max(1)
    }

    /// Hands every variable's slack to its row (whose star must be solved again before it is used), from where the mates profit. This only pays off between a leaders' problem and the stars that
    /// follow: slack handed on as soon as it appears would never lower the leaders' problem.
    fn spread(&mut self) {
        let others = self.others();
        for a in 0..self.vars.len() {
            let share = if self.alive(a) { self.slack[a] / others } else { 0 };
            if share == 0 {
                continue;
            }
            for e in self.entries(a) {
                if self.w[e] != FORBIDDEN {
                    self.shift(e, share);
                }
            }
            self.slack[a] -= share * others;
        }
    }

    /// Moves `delta` >= 0 of a pair's score into the share of entry `e`, unless a share would leave its range.
    fn shift(&mut self, e: usize, delta: i64) {
        let mate = self.mate[e] as usize;
        if self.w[mate] - delta > -self.limit && self.w[e] + delta < self.limit {
            self.w[e] += delta;
            self.w[mate] -= delta;
        }
    }

    /// Moves the slack of row `a`'s entries to their mates, and excludes pairs.
    fn push(&mut self, s: &Scratch, a: usize, threshold: i64) {
        let own = (self.left[a] as usize, self.right[a] as usize);
        // The bound's duals are those of the last leaders' problem; the star may have fallen since.
        self.slack[a] = self.u[own.0] + self.v[own.1] - self.c[a] - self.star[a];
        let room = self.bound - threshold - self.slack[a];
        for e in self.entries(a) {
            if self.w[e] == FORBIDDEN {
                continue;
            }
            let b = self.col[e] as usize;
            let spare = s.star.u[self.left[b] as usize] + s.star.v[self.right[b] as usize] - self.w[e];
            if spare + self.slack[b] >= room {
                self.w[e] = FORBIDDEN;
                self.w[self.mate[e] as usize] = FORBIDDEN;
            } else {
                // A quarter stays behind: measured to fall faster than handing on everything.
                self.shift(e, spare - spare / 4);
            }
        }
    }

    /// Excludes a variable.
    fn kill(&mut self, a: usize) {
        self.c[a] = FORBIDDEN;
        for e in self.entries(a) {
            self.w[e] = FORBIDDEN;
            self.w[self.mate[e] as usize] = FORBIDDEN;
        }
    }

    /// Combines the stars. True when pruned.
    fn lead(&mut self, s: &mut Scratch, threshold: i64) -> bool {
        self.leader.clear();
        self.leader
            .extend(self.c.iter().zip(&self.star).map(|(&c, &t)| if c == FORBIDDEN { FORBIDDEN } else { c + t }));
        let value = s.lap.solve(&self.start, &self.right, &self.leader, self.n_right, !self.mandatory, usize::MAX);
        let Some(value) = value else { return true };
        self.u.clone_from(&s.lap.u);
        self.v.clone_from(&s.lap.v);
        self.matching = s.lap.used.iter().copied().filter(|&e| e != u32::MAX).collect();
        self.bound = self.base + value;
        if self.bound <= threshold {
            return true;
        }
        for a in 0..self.vars.len() {
            if self.alive(a) {
                self.slack[a] = self.u[self.left[a] as usize] + self.v[self.right[a] as usize] - self.leader[a];
                if self.bound - self.slack[a] <= threshold {
                    self.kill(a);
                }
            }
        }
        false
    }

    /// The branches on the feature whose branches have the lowest bounds, best bound first. Call after [`Self::ascend`].
    pub fn branches(&self, threshold: i64) -> Vec<(i64, Branch)> {
        let mut best: Option<(f64, Vec<(i64, Branch)>)> = None;
        let mut consider = |options: Vec<(i64, Branch)>| {
            let gap = (self.bound - threshold).max(1) as f64;
            // Bounds far above the threshold weigh most; pruned branches nothing.
            let weight: f64 = options.iter().map(|o| ((o.0 - threshold) as f64 / gap).powi(2)).sum();
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
            consider(options);
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
            consider(options);
        }
        let mut options = best.map(|b| b.1).unwrap_or_default();
        options.retain(|o| o.0 > threshold);
        options.sort_by_key(|o| std::cmp::Reverse(o.0));
        options
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
        self.compress(&keep, &c, base, fixed, gone_left, gone_right)
    }

    fn compress(&self, keep: &[bool], c: &[i64], base: i64, fixed: Vec<u32>, gone_left: u32, gone_right: u32) -> Self {
        let n = self.vars.len();
        let (mut index, mut count) = (vec![u32::MAX; n], 0);
        for a in 0..n {
            if keep[a] {
                index[a] = count;
                count += 1;
            }
        }
        let kept: Vec<usize> = (0..n).filter(|&a| keep[a]).collect();
        let mut place = vec![u32::MAX; self.col.len()];
        let (mut row, mut col, mut w, mut old) = (vec![0_u32], Vec::new(), Vec::new(), Vec::new());
        for &a in &kept {
            for e in self.entries(a) {
                // A forbidden pair may be left out only where an absent entry means just that.
                if keep[self.col[e] as usize] && !(self.dense && self.w[e] == FORBIDDEN) {
                    place[e] = col.len() as u32;
                    col.push(index[self.col[e] as usize]);
                    w.push(self.w[e]);
                    old.push(e);
                }
            }
            row.push(col.len() as u32);
        }
        let shift = |gone: u32| move |f: u32| f - u32::from(gone < f);
        // With a feature of unknown index (none gone) nothing shifts.
        let (shift_left, shift_right) = (shift(gone_left), shift(gone_right));
        let mut sub = Self {
            base,
            fixed,
            vars: kept.iter().map(|&a| self.vars[a]).collect(),
            left: kept.iter().map(|&a| shift_left(self.left[a])).collect(),
            right: kept.iter().map(|&a| shift_right(self.right[a])).collect(),
            start: Vec::new(),
            n_right: self.n_right - usize::from(gone_right != u32::MAX),
            c: kept.iter().map(|&a| c[a]).collect(),
            star: vec![0; kept.len()],
            row,
            mate: old.iter().map(|&e| place[self.mate[e] as usize]).collect(),
            col,
            w,
            leader: Vec::new(),
            slack: vec![0; kept.len()],
            u: Vec::new(),
            v: Vec::new(),
            bound: i64::MAX,
            matching: Vec::new(),
            mandatory: self.mandatory,
            dense: self.dense,
            limit: self.limit,
        };
        sub.index_lefts(self.n_left() - usize::from(gone_left != u32::MAX));
        sub
    }
}
