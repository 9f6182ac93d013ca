//! The dual bound of a subproblem.
//!
//! A subproblem keeps, for its variables, leader scores `c_a` and shares `w_ab` with `w_ab + w_ba = h_ab`. With `star_a` the
//! optimum of the assignment problem over row `a`, every assignment `x` satisfies
//!
//! ```text
//! objective(x) <= base + sum_a (c_a + star_a) x_a <= base + LAP(c + star)
//! ```
//!
//! for *any* shares. Good shares come from the linear relaxation ([`super::relax`]), in floating point; everything here is exact in integers.
//!
//! With the duals of all these assignment problems at hand the difference is a sum of nonnegative slacks: `R_a` for each chosen
//! variable, `u_k + v_l - w_ab` for each chosen ordered pair, and more. Slack excludes: a variable, or pair, whose slacks
//! exceed the gap to the best known assignment cannot be part of a better one.

use super::lap::{FORBIDDEN, Lap};
use super::relax::Relax;
use super::sub::Sub;
use crate::stop::{Pace, Stop};

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
    /// At most this many rounds.
    pub rounds: usize,
    /// Iterations of the relaxation in a round.
    pub iterations: usize,
    /// Stop when this many more rounds at the present rate would not reach the threshold.
    pub patience: i64,
    /// Ends the ascent; the bound stays valid.
    pub stop: Stop<'a>,
    /// Ends it at once; what it comes to is of no use.
    pub cancelled: Stop<'a>,
}

/// Buffers shared by all subproblems of a search.
#[derive(Default)]
pub(super) struct Scratch {
    lap: Lap,
    star: Lap,
    start: Vec<u32>,
    rights: Vec<u32>,
    leader: Vec<i64>,
    /// Slack of each entry in its star.
    spare: Vec<i64>,
}

impl Sub {
    /// Lowers the bound round by round. Every state in between is valid, so that it may be stopped at any time.
    pub fn ascend(&mut self, s: &mut Scratch, how: &Ascent) -> Outcome {
        if self.measure(s, how) {
            return Outcome::Pruned;
        }
        let (mut relax, mut edges) = (None, self.live());
        let mut best = self.bound;
        for _ in 0..how.rounds {
            if (how.stop)() || self.vars.is_empty() {
                break;
            }
            let before = best;
            if self.dwindled(edges) {
                *self = self.compact();
                (relax, edges) = (None, self.live());
            }
            let relax = relax.get_or_insert_with(|| Relax::new(self, how.stop));
            relax.run(how.iterations, how.stop);
            relax.store(self);
            if self.measure(s, how) {
                return Outcome::Pruned;
            }
            best = best.min(self.bound);
            let missing = best - how.threshold;
            if (before - best).saturating_mul(how.patience) < missing {
                break;
            }
        }
        Outcome::Bound(best)
    }

    fn live(&self) -> usize {
        self.w.iter().filter(|&&w| w != FORBIDDEN).count()
    }

    /// A good part of the variables, or of this many entries, has been excluded.
    fn dwindled(&self, entries: usize) -> bool {
        let dead = (0..self.vars.len()).filter(|&a| !self.alive(a)).count();
        8 * dead > self.vars.len() || 8 * (entries - self.live()) > entries
    }

    /// The bound of the present shares; excludes what it can. True when pruned.
    fn measure(&mut self, s: &mut Scratch, how: &Ascent) -> bool {
        let threshold = how.threshold;
        self.stars(s, how.cancelled);
        if (how.cancelled)() || self.lead(s, threshold) {
            return true;
        }
        self.exclude(s, how);
        false
    }

    fn stars(&mut self, s: &mut Scratch, cancelled: Stop) {
        let pace = Pace::new(cancelled, 64);
        s.spare.clear();
        s.spare.resize(self.w.len(), 0);
        for a in 0..self.vars.len() {
            if pace.ends() {
                return;
            }
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
            let w = &self.w[range.clone()];
            let Some(value) = s.star.solve(&s.start, &s.rights, w, self.n_right, !self.dense, own) else {
                self.kill(a);
                continue;
            };
            self.star[a] = value;
            for e in range.filter(|&e| self.w[e] != FORBIDDEN) {
                let b = self.col[e] as usize;
                s.spare[e] = s.star.u[self.left[b] as usize] + s.star.v[self.right[b] as usize] - self.w[e];
            }
        }
    }

    /// Combines the stars, and excludes variables. True when pruned.
    fn lead(&mut self, s: &mut Scratch, threshold: i64) -> bool {
        s.leader.clear();
        s.leader.extend(self.c.iter().zip(&self.star).map(|(&c, &t)| if c == FORBIDDEN { FORBIDDEN } else { c + t }));
        s.lap.clear();
        let value = s.lap.solve(&self.start, &self.right, &s.leader, self.n_right, !self.mandatory, usize::MAX);
        let Some(value) = value else { return true };
        self.u.clone_from(&s.lap.u);
        self.v.clear();
        self.v.extend(&s.lap.v[..self.n_right]);
        self.matching = s.lap.used.iter().copied().filter(|&e| e != u32::MAX).collect();
        self.bound = self.base + value;
        if self.bound <= threshold {
            return true;
        }
        for a in 0..self.vars.len() {
            if self.alive(a) {
                self.slack[a] = self.u[self.left[a] as usize] + self.v[self.right[a] as usize] - s.leader[a];
                if self.bound - self.slack[a] <= threshold {
                    self.kill(a);
                }
            }
        }
        false
    }

    /// Excludes pairs.
    fn exclude(&mut self, s: &Scratch, how: &Ascent) {
        let gap = self.bound - how.threshold;
        let pace = Pace::new(how.stop, 64);
        for a in 0..self.vars.len() {
            if pace.ends() {
                return;
            }
            for e in self.entries(a) {
                let b = self.col[e] as usize;
                if b < a || self.w[e] == FORBIDDEN {
                    continue;
                }
                let spare = s.spare[e] + s.spare[self.mate[e] as usize];
                if spare + self.slack[a] + self.slack[b] >= gap {
                    self.forbid(e);
                }
            }
        }
    }
}
