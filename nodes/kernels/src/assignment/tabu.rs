//! Primal heuristics: greedy construction, then tabu search over insertions that eject what they conflict with. Seeded, deterministic.

use super::lap::Lap;
use super::model::Model;
use super::pool::Pool;
use crate::random::Random;
use crate::stop::Stop;

const NONE: u32 = u32::MAX;

/// An assignment under construction, with the gain of every variable.
pub(super) struct Search<'a> {
    m: &'a Model,
    /// First variable of each left.
    start: Vec<usize>,
    at_left: Vec<u32>,
    at_right: Vec<u32>,
    /// `c_a + sum of h_ab over the chosen b`, for chosen and unchosen `a` alike.
    gain: Vec<i64>,
    value: i64,
    tabu: Vec<u64>,
    clock: u64,
    random: Random,
    pool: Pool,
    quick: Option<Quick>,
}

/// Tables that answer at once what a search asks again and again.
struct Quick {
    /// The pair term of every two variables.
    pairs: Vec<i64>,
    /// The variable of every left and right, `NONE` where there is none.
    variable: Vec<u32>,
}

/// Above this many entries there are no tables: 8 MB would not stay in the processor's cache.
const MOST: usize = 1 << 20;

impl Quick {
    fn new(m: &Model) -> Option<Self> {
        let n = m.left.len();
        if n * n > MOST || m.n_left * m.n_right > MOST {
            return None;
        }
        let (mut pairs, mut variable) = (vec![0; n * n], vec![NONE; m.n_left * m.n_right]);
        for a in 0..n {
            variable[m.left[a] as usize * m.n_right + m.right[a] as usize] = a as u32;
            for e in m.row[a]..m.row[a + 1] {
                pairs[a * n + m.col[e] as usize] = m.val[e];
            }
        }
        Some(Self { pairs, variable })
    }
}

/// The change that a move makes: variable in, up to two out, and the pair of freed features matched to each other where possible.
#[derive(Clone, Copy)]
struct Move {
    delta: i64,
    /// `NONE` for a plain removal.
    insert: u32,
    eject: [u32; 2],
    rejoin: u32,
}

impl<'a> Search<'a> {
    pub fn new(m: &'a Model, seed: u64, keep: usize) -> Self {
        let mut start = vec![0; m.n_left + 1];
        m.left.iter().for_each(|&k| start[k as usize + 1] += 1);
        (0..m.n_left).for_each(|k| start[k + 1] += start[k]);
        Self {
            m,
            start,
            at_left: vec![NONE; m.n_left],
            at_right: vec![NONE; m.n_right],
            gain: m.linear.clone(),
            value: 0,
            tabu: vec![0; m.left.len()],
            clock: 0,
            random: Random::from_state(seed),
            pool: Pool::new(keep),
            quick: Quick::new(m),
        }
    }

    /// What has been found; empty before anything, and where not every left that must be matched can be.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    fn best(&self) -> i64 {
        self.pool.best().map_or(i64::MIN, |b| b.0)
    }

    /// Run number `round`: from the greedy assignment if it is 0, else from the best one, disturbed. Ends after `idle` moves without improvement.
    /// False if there is nothing to search.
    pub fn run(&mut self, round: usize, idle: usize, stop: Stop) -> bool {
        if self.m.left.is_empty() && (self.m.n_left == 0 || !self.m.mandatory) {
            self.load(&[]);
            return false;
        }
        if round == 0 {
            if !self.construct() {
                return false;
            }
        } else {
            let Some(set) = self.pool.best().map(|b| b.1.to_vec()) else { return false };
            self.load(&set);
            self.disturb(round);
        }
        self.tabu.fill(0);
        let (mut waited, mut best) = (0, self.value);
        while waited < idle && !(self.clock.is_multiple_of(64) && stop()) && self.step() {
            waited += 1;
            if self.value > best {
                (best, waited) = (self.value, 0);
            }
        }
        true
    }

    /// Improves a given assignment by a short search.
    pub fn polish(&mut self, set: &[u32], iterations: usize, stop: Stop) {
        self.load(set);
        self.tabu.fill(0);
        for _ in 0..iterations {
            if self.clock.is_multiple_of(64) && stop() || !self.step() {
                break;
            }
        }
    }

    /// The greedy assignment; false if not every left that must be matched can be.
    pub fn construct(&mut self) -> bool {
        if self.m.mandatory {
            // Any assignment that serves every left: the best by linear scores.
            let start: Vec<u32> = self.start.iter().map(|&v| v as u32).collect();
            let mut lap = Lap::default();
            if lap.solve(&start, &self.m.right, &self.m.linear, self.m.n_right, false, usize::MAX).is_none() {
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

    /// Greedy insertion into the present assignment, by gain plus an estimate of what the candidate will still earn.
    fn grow(&mut self) {
        let m = self.m;
        let share = 2 * m.n_left as i64;
        let potential: Vec<i64> =
            (0..m.left.len()).map(|a| m.val[m.row[a]..m.row[a + 1]].iter().map(|&h| h.max(0) / share).sum()).collect();
        loop {
            let free =
                |a: &usize| self.at_left[m.left[*a] as usize] == NONE && self.at_right[m.right[*a] as usize] == NONE;
            let score = |a: usize| self.gain[a] + potential[a];
            let Some(a) = (0..m.left.len()).filter(free).max_by_key(|&a| (score(a), std::cmp::Reverse(a))) else {
                break;
            };
            if score(a) <= 0 {
                break;
            }
            self.insert(a);
            self.note();
        }
    }

    /// Takes this assignment.
    pub fn load(&mut self, set: &[u32]) {
        self.at_left.fill(NONE);
        self.at_right.fill(NONE);
        self.gain.clone_from(&self.m.linear);
        self.value = 0;
        for &a in set {
            self.insert(a as usize);
        }
        self.note();
    }

    /// A new start from the best: a random share of it is dropped and grown again about two random candidates. Where all must be matched: a few
    /// random moves, or in even rounds as many as there are lefts.
    fn disturb(&mut self, round: usize) {
        let mut moves = 2;
        if self.m.mandatory {
            moves += if round.is_multiple_of(2) { self.m.n_left } else { self.m.n_left / 8 };
        } else {
            let dropped = 10 + self.random.below(80);
            for left in 0..self.m.n_left {
                let chosen = self.at_left[left];
                if chosen != NONE && self.random.below(100) < dropped {
                    self.remove(chosen as usize);
                }
            }
        }
        let n = self.m.left.len() as u64;
        for _ in 0..moves {
            let a = self.random.below(n) as usize;
            if let Some(change) = self.evaluate(a) {
                self.apply(change);
            }
        }
        if !self.m.mandatory {
            self.grow();
        }
    }

    fn insert(&mut self, a: usize) {
        self.value += self.gain[a];
        self.at_left[self.m.left[a] as usize] = a as u32;
        self.at_right[self.m.right[a] as usize] = a as u32;
        for e in self.m.row[a]..self.m.row[a + 1] {
            self.gain[self.m.col[e] as usize] += self.m.val[e];
        }
    }

    fn remove(&mut self, a: usize) {
        self.value -= self.gain[a];
        self.at_left[self.m.left[a] as usize] = NONE;
        self.at_right[self.m.right[a] as usize] = NONE;
        for e in self.m.row[a]..self.m.row[a + 1] {
            self.gain[self.m.col[e] as usize] -= self.m.val[e];
        }
    }

    fn chosen(&self, a: usize) -> bool {
        self.at_left[self.m.left[a] as usize] == a as u32
    }

    /// The move that inserts `a`, or removes it if it is chosen; `None` if that would leave a left unmatched that must not be.
    fn evaluate(&self, a: usize) -> Option<Move> {
        let m = self.m;
        if self.chosen(a) {
            return (!m.mandatory).then_some(Move {
                delta: -self.gain[a],
                insert: NONE,
                eject: [a as u32, NONE],
                rejoin: NONE,
            });
        }
        let eject = [self.at_left[m.left[a] as usize], self.at_right[m.right[a] as usize]];
        let mut delta = self.gain[a];
        for b in eject.into_iter().filter(|&b| b != NONE) {
            delta -= self.gain[b as usize];
        }
        let mut rejoin = NONE;
        if eject[0] != NONE && eject[1] != NONE {
            delta += self.pair(eject[0] as usize, eject[1] as usize);
            // a = (i, j) ejects (i, j') and (i', j): i' and j' are free now.
            if let Some(other) = self.find(m.left[eject[1] as usize], m.right[eject[0] as usize]) {
                let more = self.gain[other] + self.pair(a, other);
                if more > 0 || m.mandatory {
                    delta += more;
                    rejoin = other as u32;
                }
            }
        }
        if m.mandatory && eject[1] != NONE && rejoin == NONE {
            return None;
        }
        Some(Move { delta, insert: a as u32, eject, rejoin })
    }

    /// The pair term of two variables.
    fn pair(&self, a: usize, b: usize) -> i64 {
        self.quick.as_ref().map_or_else(|| self.m.pair(a, b), |quick| quick.pairs[a * self.m.left.len() + b])
    }

    fn find(&self, left: u32, right: u32) -> Option<usize> {
        let m = self.m;
        if let Some(quick) = &self.quick {
            let found = quick.variable[left as usize * m.n_right + right as usize];
            return (found != NONE).then_some(found as usize);
        }
        let (from, to) = (self.start[left as usize], self.start[left as usize + 1]);
        m.right[from..to].binary_search(&right).ok().map(|at| from + at)
    }

    /// The best admissible move; false if there is none.
    fn step(&mut self) -> bool {
        self.clock += 1;
        let known_best = self.best();
        let mut best: Option<Move> = None;
        let mut ties = 0;
        for a in 0..self.m.left.len() {
            let Some(change) = self.evaluate(a) else {
                continue;
            };
            let held = |b: u32| b != NONE && self.tabu[b as usize] > self.clock;
            let tabu = held(change.insert) || held(change.rejoin) || change.insert == NONE && held(change.eject[0]);
            if tabu && self.value + change.delta <= known_best {
                continue;
            }
            match best {
                Some(known) if change.delta < known.delta => {}
                Some(known) if change.delta == known.delta => {
                    ties += 1;
                    if self.random.below(ties + 1) == 0 {
                        best = Some(change);
                    }
                }
                _ => (best, ties) = (Some(change), 0),
            }
        }
        let Some(change) = best else { return false };
        self.apply(change);
        true
    }

    fn apply(&mut self, change: Move) {
        let tenure = 4 + self.m.n_left as u64 / if self.m.mandatory { 4 } else { 7 };
        for b in change.eject.into_iter().filter(|&b| b != NONE) {
            self.remove(b as usize);
            self.tabu[b as usize] = self.clock + tenure + self.random.below(tenure);
        }
        for a in [change.insert, change.rejoin].into_iter().filter(|&a| a != NONE) {
            self.insert(a as usize);
            self.tabu[a as usize] = self.clock + 2 + self.random.below(tenure / 2 + 1);
        }
        self.note();
    }

    fn note(&mut self) {
        let complete = !self.m.mandatory || self.at_left.iter().all(|&a| a != NONE);
        if complete && self.pool.wants(self.value) {
            self.pool.offer(self.value, self.at_left.iter().copied().filter(|&a| a != NONE));
        }
    }
}
