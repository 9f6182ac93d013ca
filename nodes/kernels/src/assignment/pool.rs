//! The best distinct assignments so far.

/// Keeps the `capacity` best distinct sets, best first; among equal values the first found comes first.
pub(super) struct Pool {
    capacity: usize,
    /// Value, and variables in ascending order.
    sets: Vec<(i64, Vec<u32>)>,
}

impl Pool {
    pub fn new(capacity: usize) -> Self {
        Self { capacity: capacity.max(1), sets: Vec::new() }
    }

    /// Whether a set of this value might be kept.
    pub fn wants(&self, value: i64) -> bool {
        self.sets.len() < self.capacity || self.threshold() < value
    }

    /// Keeps the set if it is good enough and new; true if it is the new best.
    pub fn offer(&mut self, value: i64, set: impl Iterator<Item = u32>) -> bool {
        if !self.wants(value) {
            return false;
        }
        let mut set: Vec<u32> = set.collect();
        set.sort_unstable();
        let at = self.sets.partition_point(|s| s.0 >= value);
        let equals = self.sets[..at].iter().rev().take_while(|s| s.0 == value);
        if equals.into_iter().any(|s| s.1 == set) {
            return false;
        }
        self.sets.insert(at, (value, set));
        self.sets.truncate(self.capacity);
        at == 0
    }

    /// What is not better than this need not be found; far below all values while there is room.
    pub fn threshold(&self) -> i64 {
        if self.sets.len() < self.capacity { i64::MIN / 4 } else { self.sets[self.capacity - 1].0 }
    }

    pub fn best(&self) -> Option<(i64, &[u32])> {
        self.sets.first().map(|s| (s.0, s.1.as_slice()))
    }

    pub fn sets(&self) -> &[(i64, Vec<u32>)] {
        &self.sets
    }
}
