//! Many short searches that learn from each other: the primal heuristic of [`super::solve()`].
//!
//! An *island* keeps a few good assignments. A round takes two of them, keeps what they have in common and a random share of the rest, grows
//! that greedily, and improves it by tabu search; what comes out takes the place of the worst, if it is better and new. Once
//! rounds bring nothing any more, the island begins anew from random assignments. Islands know nothing of each other, so that they may run
//! side by side, and each makes the same rounds on any number of threads.

use std::sync::Mutex;

use super::solve::Spread;
use super::tables::Tables;
use super::tabu::Search;
use crate::stop::{NEVER, Stop};

/// Assignments on an island: few, so that they become alike soon, and there is time to begin again.
const ELITE: usize = 6;
/// Rounds without a better best after which an island begins anew. Measured; 30 is worse by half, 100 no better.
const PATIENCE: usize = 80;
/// How many there are: fixed, so that the result does not depend on threads.
const ISLANDS: usize = 2;
/// Units of work (about nanoseconds) that may pass before the caller is asked whether to stop.
const SLICE: usize = 4_000_000;

struct Island<'a> {
    search: Search<'a>,
    elite: Vec<(i64, Vec<u32>)>,
    /// Rounds since the best of the island became better.
    waited: usize,
}

impl<'a> Island<'a> {
    fn new(t: &'a Tables<'a>, seed: u64, keep: usize) -> Self {
        Self { search: Search::new(t, seed, keep), elite: Vec::new(), waited: 0 }
    }

    fn round(&mut self, idle: usize) {
        let m = self.search.t.m;
        if m.mandatory {
            self.disturb();
        } else if self.elite.len() < ELITE {
            self.begin();
        } else {
            self.cross();
        }
        self.search.descend(idle, NEVER);
        let (value, set) = self.search.peak();
        self.waited += 1;
        if self.elite.len() < ELITE || self.elite.iter().all(|e| e.0 < value) {
            self.waited = 0;
        }
        let known = self.elite.iter().any(|e| e.0 == value && e.1 == set);
        if !known && self.elite.len() < ELITE {
            self.elite.push((value, set.to_vec()));
        } else if !known && let Some(worst) = self.elite.iter_mut().min_by_key(|e| e.0).filter(|e| e.0 < value) {
            *worst = (value, set.to_vec());
        }
        if self.waited > PATIENCE {
            self.elite.clear();
        }
    }

    /// A start at random: a quarter of the lefts get what comes, the rest is grown.
    fn begin(&mut self) {
        let m = self.search.t.m;
        self.search.load(&[]);
        for _ in 0..m.n_left / 4 {
            let a = self.search.random().below(m.left.len() as u64) as usize;
            self.search.fit(a);
        }
        self.search.grow();
    }

    /// A start between two of the elite.
    fn cross(&mut self) {
        let random = self.search.random();
        let i = random.below(ELITE as u64) as usize;
        let j = (i + 1 + random.below(ELITE as u64 - 1) as usize) % ELITE;
        let share = random.below(100);
        let (one, other) = (&self.elite[i].1, &self.elite[j].1);
        let (mut common, mut rest) = (Vec::new(), Vec::new());
        // Both are in the order of lefts, hence ascending.
        for &a in one {
            if other.binary_search(&a).is_ok() { common.push(a) } else { rest.push(a) }
        }
        rest.extend(other.iter().filter(|a| one.binary_search(a).is_err()));
        for k in (1..rest.len()).rev() {
            rest.swap(k, random.below(k as u64 + 1) as usize);
        }
        self.search.load(&common);
        for a in rest {
            if self.search.random().below(100) < share {
                self.search.fit(a as usize);
            }
        }
        self.search.shake(2);
        self.search.grow();
    }

    /// Where all must be matched: a few random moves from one of the elite, or as many as there are lefts.
    fn disturb(&mut self) {
        let m = self.search.t.m;
        let n = self.elite.len() as u64;
        if n == 0 {
            if !self.search.construct() {
                return;
            }
        } else {
            let at = self.search.random().below(n) as usize;
            self.search.load(&self.elite[at].1);
        }
        let far = self.elite.len() < ELITE || self.search.random().below(2) == 0;
        self.search.shake(2 + if far { m.n_left } else { m.n_left / 8 });
    }
}

/// A search of its own for single assignments, and the islands; all that was found is in the search's pool.
pub(super) struct Evolution<'a> {
    pub search: Search<'a>,
    islands: Vec<Mutex<Island<'a>>>,
    spread: Spread<'a>,
    /// Rounds of all islands so far.
    pub rounds: usize,
}

impl<'a> Evolution<'a> {
    pub fn new(t: &'a Tables<'a>, seed: u64, keep: usize, spread: Spread<'a>) -> Self {
        let island = |k: usize| Mutex::new(Island::new(t, seed ^ ((k as u64 + 1) << 32), keep));
        let islands = (0..ISLANDS).map(island).collect();
        Self { search: Search::new(t, seed, keep), islands, spread, rounds: 0 }
    }

    /// The greedy assignment, improved; false if there is no assignment.
    pub fn first(&mut self, idle: usize, stop: Stop) -> bool {
        let feasible = self.search.construct();
        if feasible && !self.search.t.m.left.is_empty() {
            self.search.descend(idle, stop);
        }
        feasible
    }

    /// At most so many more rounds, as many as may pass without a question whether to stop.
    pub fn advance(&mut self, most: usize, idle: usize) {
        let m = self.search.t.m;
        let n = m.left.len().max(1);
        let work = (n + 6 * m.col.len() / n) * (idle + 50);
        let each = (SLICE / work).clamp(1, most.div_ceil(ISLANDS).max(1));
        let islands = &self.islands;
        (self.spread)(islands.len(), &|k| {
            // A lock is poisoned only by a panic, which ends all.
            if let Ok(mut island) = islands[k].lock() {
                (0..each).for_each(|_| island.round(idle));
            }
        });
        self.rounds += ISLANDS * each;
        for island in &mut self.islands {
            let Ok(island) = island.get_mut() else { continue };
            for (value, set) in island.search.pool().sets() {
                self.search.pool_mut().offer(*value, set.iter().copied());
            }
        }
    }
}
