//! Primal search: greedy construction, then tabu search over insertions that eject what they conflict with. Seeded, deterministic.
//!
//! The change that each move would make is kept up to date, so that a move costs what it changes and one pass over numbers that lie side by
//! side. Inserting `a = (i, j)` where `(i, j')` and `(i', j)` are chosen ejects both, and changes the objective by
//!
//! ```text
//! gain(a) - gain(i, j') - gain(i', j) + h of these two        (its *key*)
//! ```
//!
//! and, if `(i', j')` is a candidate, by what that then gains: it *rejoins*. For a chosen variable the key is that of its removal.

use super::lap::Lap;
use super::pool::Pool;
use super::tables::{NONE, Tables};
use crate::random::Random;
use crate::stop::Stop;

/// Below every key, and what is added to the key of a variable that is held.
const HELD: f64 = -1e18;

/// An assignment, and what every move would make of it.
pub(super) struct Search<'a> {
    pub t: &'a Tables<'a>,
    at_left: Vec<u32>,
    at_right: Vec<u32>,
    /// `c_a + sum of h_ab over the chosen b`, for chosen and unchosen `a` alike.
    gain: Vec<f64>,
    key: Vec<f64>,
    /// Of each variable: the pair term of the two that it would eject, what would rejoin, and the pair term of that with it.
    cross: Vec<f64>,
    rejoin: Vec<u32>,
    with: Vec<f64>,
    /// Variables that have a rejoin, in no order, and the place of each in this list.
    joining: Vec<u32>,
    place: Vec<u32>,
    value: f64,
    held: Held,
    random: Random,
    pool: Pool,
    /// The best of the present run.
    peak: (f64, Vec<u32>),
}

/// What may not be moved for a while.
struct Held {
    clock: usize,
    until: Vec<usize>,
    /// 0 or [`HELD`].
    fine: Vec<f64>,
    /// Variables to be looked at when the clock comes to a multiple of its length and so much.
    due: Vec<Vec<u32>>,
}

impl Held {
    fn new(n: usize, longest: usize) -> Self {
        Self { clock: 0, until: vec![0; n], fine: vec![0.0; n], due: vec![Vec::new(); longest + 1] }
    }

    fn clear(&mut self) {
        self.fine.fill(0.0);
        self.due.iter_mut().for_each(Vec::clear);
    }

    /// Holds `a` for the moves before the `moves`-th from now, at least one and no more than promised.
    fn hold(&mut self, a: usize, moves: usize) {
        self.until[a] = self.clock + moves;
        self.fine[a] = HELD;
        let at = self.until[a] % self.due.len();
        self.due[at].push(a as u32);
    }

    fn tick(&mut self) {
        self.clock += 1;
        let at = self.clock % self.due.len();
        for a in self.due[at].drain(..) {
            // It may have been held again.
            if self.until[a as usize] <= self.clock {
                self.fine[a as usize] = 0.0;
            }
        }
    }
}

impl<'a> Search<'a> {
    pub fn new(t: &'a Tables<'a>, seed: u64, keep: usize) -> Self {
        let (m, n) = (t.m, t.m.left.len());
        Self {
            t,
            at_left: vec![NONE; m.n_left],
            at_right: vec![NONE; m.n_right],
            gain: t.linear.clone(),
            key: t.linear.clone(),
            cross: vec![0.0; n],
            rejoin: vec![NONE; n],
            with: vec![0.0; n],
            joining: Vec::new(),
            place: vec![NONE; n],
            value: 0.0,
            held: Held::new(n, 2 * tenure(t)),
            random: Random::from_state(seed),
            pool: Pool::new(keep),
            peak: (f64::NEG_INFINITY, Vec::new()),
        }
    }

    /// What has been found; empty before anything, and where not every left that must be matched can be.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    pub fn pool_mut(&mut self) -> &mut Pool {
        &mut self.pool
    }

    pub fn random(&mut self) -> &mut Random {
        &mut self.random
    }

    /// The best since the last [`Self::descend`] began: its value and variables, ascending.
    pub fn peak(&self) -> (i64, &[u32]) {
        (self.peak.0 as i64, &self.peak.1)
    }

    /// Moves from the present assignment until `idle` of them bring no improvement.
    pub fn descend(&mut self, idle: usize, stop: Stop) {
        self.held.clear();
        self.peak.0 = f64::NEG_INFINITY;
        self.note();
        let (mut waited, mut best) = (0, self.value);
        while waited < idle && !(self.held.clock.is_multiple_of(64) && stop()) && self.step() {
            waited += 1;
            if self.value > best {
                (best, waited) = (self.value, 0);
            }
        }
    }

    /// Improves a given assignment by so many moves.
    pub fn polish(&mut self, set: &[u32], moves: usize, stop: Stop) {
        self.load(set);
        self.held.clear();
        for _ in 0..moves {
            if self.held.clock.is_multiple_of(64) && stop() || !self.step() {
                break;
            }
        }
    }

    /// The greedy assignment; false if not every left that must be matched can be.
    pub fn construct(&mut self) -> bool {
        let m = self.t.m;
        if m.mandatory {
            // Any assignment that serves every left: the best by linear scores.
            let start: Vec<u32> = self.t.start.iter().map(|&v| v as u32).collect();
            let mut lap = Lap::default();
            if lap.solve(&start, &m.right, &m.linear, m.n_right, false, usize::MAX).is_none() {
                return false;
            }
            let used = std::mem::take(&mut lap.used);
            self.load(&used);
            return true;
        }
        self.load(&[]);
        self.grow();
        true
    }

    /// Greedy insertion into the present assignment, by gain and potential.
    pub fn grow(&mut self) {
        loop {
            let (mut best, mut chosen) = (0.0, NONE);
            for left in (0..self.at_left.len()).filter(|&k| self.at_left[k] == NONE) {
                for a in self.t.of_left(left as u32).filter(|&a| self.at_right[self.t.m.right[a] as usize] == NONE) {
                    let score = self.gain[a] + self.t.potential[a];
                    if score > best {
                        (best, chosen) = (score, a as u32);
                    }
                }
            }
            if chosen == NONE {
                break;
            }
            self.insert(chosen as usize);
            self.note();
        }
    }

    /// Takes this assignment.
    pub fn load(&mut self, set: &[u32]) {
        self.at_left.fill(NONE);
        self.at_right.fill(NONE);
        self.gain.copy_from_slice(&self.t.linear);
        self.key.copy_from_slice(&self.t.linear);
        self.cross.fill(0.0);
        self.rejoin.fill(NONE);
        self.joining.clear();
        self.place.fill(NONE);
        self.value = 0.0;
        for &a in set {
            self.insert(a as usize);
        }
        self.note();
    }

    /// Inserts a variable if both of its features are free.
    pub fn fit(&mut self, a: usize) {
        let (left, right) = (self.t.m.left[a] as usize, self.t.m.right[a] as usize);
        if self.at_left[left] == NONE && self.at_right[right] == NONE {
            self.insert(a);
        }
    }

    /// So many moves of variables taken at random, whatever they bring.
    pub fn shake(&mut self, moves: usize) {
        let m = self.t.m;
        for _ in 0..moves {
            let a = self.random.below(m.left.len() as u64) as usize;
            let swaps = self.rejoin[a] != NONE || self.at_right[m.right[a] as usize] == NONE;
            if !m.mandatory || swaps {
                self.apply(a);
            }
        }
    }

    fn insert(&mut self, a: usize) {
        self.value += self.gain[a];
        self.change(a, a as u32, 1.0);
    }

    fn remove(&mut self, a: usize) {
        self.value -= self.gain[a];
        self.change(a, NONE, -1.0);
    }

    /// Lets the two features of `a` have `now`, and keeps all that rests on it.
    fn change(&mut self, a: usize, now: u32, sign: f64) {
        let t = self.t;
        let (left, right) = (t.m.left[a], t.m.right[a]);
        self.at_left[left as usize] = now;
        self.at_right[right as usize] = now;
        self.lower(left, right, sign * self.gain[a]);
        for e in t.m.row[a]..t.m.row[a + 1] {
            let (b, h) = (t.m.col[e] as usize, sign * t.val[e]);
            self.gain[b] += h;
            self.key[b] += h;
            let of_b = t.m.left[b];
            if self.at_left[of_b as usize] == b as u32 {
                self.lower(of_b, t.m.right[b], h);
            }
        }
        for b in t.of_left(left) {
            self.renew(b);
        }
        for &b in t.of_right(right) {
            self.renew(b as usize);
        }
    }

    /// The chosen variable of these two features gains `h` more: who would eject it loses that.
    fn lower(&mut self, left: u32, right: u32, h: f64) {
        for key in &mut self.key[self.t.of_left(left)] {
            *key -= h;
        }
        for &b in self.t.of_right(right) {
            self.key[b as usize] -= h;
        }
    }

    /// What `b` would eject has changed.
    fn renew(&mut self, b: usize) {
        let (t, m) = (self.t, self.t.m);
        let (x, y) = (self.at_left[m.left[b] as usize], self.at_right[m.right[b] as usize]);
        let (mut cross, mut other) = (0.0, NONE);
        if x != NONE && y != NONE && x != y {
            cross = t.pair(x as usize, y as usize);
            // b = (i, j) ejects x = (i, j') and y = (i', j): i' and j' will be free.
            other = t.find(m.left[y as usize], m.right[x as usize]);
            if other != NONE {
                self.with[b] = t.pair(b, other as usize);
            }
        }
        self.key[b] += cross - self.cross[b];
        self.cross[b] = cross;
        self.rejoin[b] = other;
        if other != NONE && self.place[b] == NONE {
            self.place[b] = self.joining.len() as u32;
            self.joining.push(b as u32);
        } else if other == NONE && self.place[b] != NONE {
            let at = std::mem::replace(&mut self.place[b], NONE) as usize;
            self.joining.swap_remove(at);
            if let Some(&moved) = self.joining.get(at) {
                self.place[moved as usize] = at as u32;
            }
        }
    }

    /// The best admissible move; false if there is none.
    fn step(&mut self) -> bool {
        self.held.tick();
        // What is held may be moved for a new best.
        let need = self.pool.best().map_or(f64::NEG_INFINITY, |b| b.0 as f64) - self.value;
        let mut best = (HELD / 2.0, NONE);
        if self.t.m.mandatory {
            self.best_free(need, &mut best);
        } else {
            self.best_key(need, &mut best);
        }
        self.best_joining(need, &mut best);
        if best.1 == NONE {
            return false;
        }
        self.apply(best.1 as usize);
        true
    }

    /// Of all moves by their keys.
    fn best_key(&mut self, need: f64, best: &mut (f64, u32)) {
        let (mut free, mut any) = ([f64::MIN; 8], [f64::MIN; 8]);
        let greater = |x: f64, y: f64| if x > y { x } else { y };
        // In eights, which the processor takes side by side.
        let ((keys, last_keys), (fines, last_fines)) = (self.key.as_chunks::<8>(), self.held.fine.as_chunks::<8>());
        for (keys, fines) in keys.iter().zip(fines) {
            for k in 0..8 {
                free[k] = greater(keys[k] + fines[k], free[k]);
                any[k] = greater(keys[k], any[k]);
            }
        }
        for (&key, &fine) in last_keys.iter().zip(last_fines) {
            free[0] = greater(key + fine, free[0]);
            any[0] = greater(key, any[0]);
        }
        let free = free.into_iter().fold(f64::MIN, greater);
        let any = any.into_iter().fold(f64::MIN, greater);
        let top = if any > need { any } else { free };
        if top <= best.0 {
            return;
        }
        let mut ties = 0;
        for (a, (&key, &fine)) in self.key.iter().zip(&self.held.fine).enumerate() {
            if key == top && (fine == 0.0 || key > need) {
                ties += 1;
                if ties == 1 || self.random.below(ties) == 0 {
                    *best = (top, a as u32);
                }
            }
        }
    }

    /// Where all lefts must stay matched: of the moves to a right that is free.
    fn best_free(&mut self, need: f64, best: &mut (f64, u32)) {
        if self.t.m.n_left == self.t.m.n_right {
            return;
        }
        for a in 0..self.key.len() {
            let admissible = self.key[a] > need || self.held.fine[a] == 0.0;
            if self.at_right[self.t.m.right[a] as usize] == NONE && admissible && self.key[a] > best.0 {
                *best = (self.key[a], a as u32);
            }
        }
    }

    /// Of the moves after which something rejoins.
    fn best_joining(&mut self, need: f64, best: &mut (f64, u32)) {
        let mut ties = 1;
        for &b in &self.joining {
            let (a, other) = (b as usize, self.rejoin[b as usize] as usize);
            let more = self.gain[other] + self.with[a];
            let delta = self.key[a] + more;
            if !(more > 0.0 || self.t.m.mandatory) || delta < best.0 {
                continue;
            }
            if delta > need || self.held.fine[a] + self.held.fine[other] == 0.0 {
                ties = if delta > best.0 { 1 } else { ties + 1 };
                if ties == 1 || self.random.below(ties) == 0 {
                    *best = (delta, b);
                }
            }
        }
    }

    /// Removes `a` if it is chosen; else inserts it, ejects what it conflicts with, and lets rejoin what gains by that.
    fn apply(&mut self, a: usize) {
        let m = self.t.m;
        let tenure = tenure(self.t);
        let (x, y) = (self.at_left[m.left[a] as usize], self.at_right[m.right[a] as usize]);
        let other = self.rejoin[a];
        let joins = other != NONE && (m.mandatory || self.gain[other as usize] + self.with[a] > 0.0);
        for b in [x, if y == x { NONE } else { y }].into_iter().filter(|&b| b != NONE) {
            self.remove(b as usize);
            let moves = tenure + self.random.below(tenure as u64) as usize;
            self.held.hold(b as usize, moves);
        }
        if x != a as u32 {
            for b in [a as u32, if joins { other } else { NONE }].into_iter().filter(|&b| b != NONE) {
                self.insert(b as usize);
                let moves = 2 + self.random.below(tenure as u64 / 2 + 1) as usize;
                self.held.hold(b as usize, moves);
            }
        }
        self.note();
    }

    fn note(&mut self) {
        if self.value > self.peak.0 && self.complete() {
            self.peak.0 = self.value;
            self.peak.1.clear();
            self.peak.1.extend(self.at_left.iter().copied().filter(|&a| a != NONE));
        }
        if self.pool.wants(self.value as i64) && self.complete() {
            self.pool.offer(self.value as i64, self.at_left.iter().copied().filter(|&a| a != NONE));
        }
    }

    fn complete(&self) -> bool {
        !self.t.m.mandatory || self.at_left.iter().all(|&a| a != NONE)
    }
}

/// Moves for which what was ejected is held, at least; at most twice that. Measured: a third more or less doubles the time to the best.
fn tenure(t: &Tables) -> usize {
    4 + t.m.n_left / if t.m.mandatory { 4 } else { 13 }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "sums of integers are exact")]
mod tests {
    use super::super::canonical::Canonical;
    use super::super::model::Model;
    use super::super::problem::Problem;
    use super::super::synthetic::Synthetic;
    use super::*;

    /// The objective from the model's terms alone.
    fn value(m: &Model, set: &[usize]) -> i64 {
        let together = |(n, &a): (usize, &usize)| set[..n].iter().map(|&b| m.pair(a, b)).sum::<i64>() + m.linear[a];
        set.iter().enumerate().map(together).sum()
    }

    fn every_move_changes_the_objective_by_what_it_says(problem: &Problem) {
        let m = Model::plain(&Canonical::new(problem));
        let tables = Tables::new(&m);
        let mut search = Search::new(&tables, 3, 1);
        assert!(search.construct());
        for _ in 0..60 {
            search.shake(1);
            let set: Vec<usize> = search.at_left.iter().filter(|&&a| a != NONE).map(|&a| a as usize).collect();
            let before = value(&m, &set);
            assert_eq!(search.value, before as f64);
            for a in 0..m.left.len() {
                let mut after: Vec<usize> =
                    set.iter().copied().filter(|&b| m.left[b] != m.left[a] && m.right[b] != m.right[a]).collect();
                if !set.contains(&a) {
                    after.push(a);
                }
                assert_eq!(search.key[a], (value(&m, &after) - before) as f64);
                if search.rejoin[a] != NONE {
                    let other = search.rejoin[a] as usize;
                    after.push(other);
                    assert!(
                        after.iter().all(|&b| b == other || m.left[b] != m.left[other] && m.right[b] != m.right[other])
                    );
                    let change = search.key[a] + search.gain[other] + search.with[a];
                    assert_eq!(change, (value(&m, &after) - before) as f64);
                }
                assert_eq!(search.joining.contains(&(a as u32)), search.rejoin[a] != NONE);
            }
        }
    }

    #[test]
    fn moves_are_kept_up_to_date() {
        for shift in [0.0, 0.3] {
            let synthetic = Synthetic { shift, right: 9, ..Synthetic::none(12, 3) };
            every_move_changes_the_objective_by_what_it_says(&synthetic.build().unwrap().0);
        }
        let matrix = |f: fn(usize) -> usize| (0..36).map(|e| (f(e) % 11) as f64).collect::<Vec<_>>();
        let qap = Problem::from_qaplib(6, &matrix(|e| 7 * e), &matrix(|e| e * e)).unwrap();
        every_move_changes_the_objective_by_what_it_says(&qap);
    }
}
