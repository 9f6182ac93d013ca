//! Priority queues of numbered items by non-negative distance: one in exact order, lowest number first among equals, and one in buckets.

/// A heap with four children to a node: half the levels of a binary one, and the four keys compared lie in one cache line.
///
/// Non-negative doubles order as their bits do, so that an entry is one integer: distance above, item below.
#[derive(Debug, Clone, Default)]
pub(super) struct Queue(Vec<u128>);

const CHILDREN: usize = 4;

impl Queue {
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Adds an item. The distance must not be negative (nor -0.0) or NaN.
    pub(super) fn push(&mut self, distance: f64, item: u32) {
        let entry = u128::from(distance.to_bits()) << 32 | u128::from(item);
        let mut hole = self.0.len();
        self.0.push(entry);
        while hole > 0 {
            let parent = (hole - 1) / CHILDREN;
            if self.0[parent] <= entry {
                break;
            }
            self.0[hole] = self.0[parent];
            hole = parent;
        }
        self.0[hole] = entry;
    }

    /// Removes and returns the nearest item.
    pub(super) fn pop(&mut self) -> Option<(f64, u32)> {
        let last = self.0.pop()?;
        let Some(&top) = self.0.first() else { return Some(unpacked(last)) };
        let heap = self.0.as_mut_slice();
        let mut hole = 0;
        loop {
            let first = hole * CHILDREN + 1;
            let (child, least) = if let Some(four) = heap.get(first..first + CHILDREN) {
                let (a, b) = (usize::from(four[1] < four[0]), 2 + usize::from(four[3] < four[2]));
                let least = if four[b] < four[a] { b } else { a };
                (first + least, four[least])
            } else {
                let rest = heap.get(first..).unwrap_or_default().iter().copied().enumerate();
                let Some((least, entry)) = rest.min_by_key(|e| e.1) else { break };
                (first + least, entry)
            };
            if last <= least {
                break;
            }
            heap[hole] = least;
            hole = child;
        }
        heap[hole] = last;
        Some(unpacked(top))
    }
}

fn unpacked(entry: u128) -> (f64, u32) {
    (f64::from_bits((entry >> 32) as u64), entry as u32)
}

/// A vertex and its distance.
pub(super) type Waiting = (u32, f64);

/// Buckets of a [`Front`], a bit of a word to each.
const BUCKETS: usize = 64;
/// Added to a number that is not negative and below it, this puts the nearest integer into the low bits.
const ROUND: f64 = (1u64 << 52) as f64;

/// Vertices waiting in a ring of unsorted buckets, each a short interval of distances: for items pushed at most a known step beyond the
/// bucket that is worked on.
#[derive(Debug, Clone)]
pub(super) struct Front {
    buckets: [Vec<Waiting>; BUCKETS],
    /// Bit i: bucket i is not empty.
    occupied: u64,
    at: usize,
    /// Buckets per unit of distance.
    density: f64,
    /// What [`Front::take`] exchanges a bucket for: its memory.
    pub(super) spare: Vec<Waiting>,
}

impl Default for Front {
    fn default() -> Self {
        let buckets = [const { Vec::new() }; BUCKETS];
        Self { buckets, occupied: 0, at: 0, density: 0.0, spare: Vec::new() }
    }
}

impl Front {
    /// Empties it, for steps of so much on average and at most.
    pub(super) fn start(&mut self, mean: f64, most: f64) {
        while self.advance() {
            self.buckets[self.at].clear();
            self.occupied &= !(1 << self.at);
        }
        self.at = 0;
        let width = (mean / 4.0).max(most / (BUCKETS - 2) as f64);
        // Without lengths everything is in the first bucket.
        self.density = if width > 0.0 && (1.0 / width).is_finite() { 1.0 / width } else { 0.0 };
    }

    /// Empty since its start, it goes on from this distance.
    pub(super) fn resume(&mut self, distance: f64) {
        self.at = self.bucket(distance);
    }

    #[inline(always)]
    fn bucket(&self, distance: f64) -> usize {
        (distance * self.density + ROUND).to_bits() as usize % BUCKETS
    }

    /// Adds a vertex. The distance must be finite and not negative.
    #[inline(always)]
    pub(super) fn push(&mut self, distance: f64, vertex: u32) {
        let bucket = self.bucket(distance);
        self.occupied |= 1 << bucket;
        self.buckets[bucket].push((vertex, distance));
    }

    /// Moves on to the next bucket with vertices; false if there is none.
    pub(super) fn advance(&mut self) -> bool {
        self.at = (self.at + self.occupied.rotate_right(self.at as u32).trailing_zeros() as usize) % BUCKETS;
        self.occupied != 0
    }

    /// Visits all that wait.
    pub(super) fn for_each(&self, mut visit: impl FnMut(u32)) {
        let mut left = self.occupied;
        while left != 0 {
            self.buckets[left.trailing_zeros() as usize].iter().for_each(|e| visit(e.0));
            left &= left - 1;
        }
    }

    /// Exchanges the present bucket for an empty list; false if there was nothing in it.
    #[inline(always)]
    pub(super) fn take(&mut self, round: &mut Vec<Waiting>) -> bool {
        round.clear();
        std::mem::swap(round, &mut self.buckets[self.at]);
        self.occupied &= !(1 << self.at);
        !round.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_leave_in_order() {
        let (mut queue, mut expected, mut state) = (Queue::default(), Vec::new(), 7u32);
        for round in 0..2000u32 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let distance = f64::from(state >> 24) * 0.37;
            queue.push(distance, round);
            expected.push((distance, round));
            if round % 3 == 2 {
                expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                assert_eq!(queue.pop(), Some(expected.remove(0)));
            }
        }
        expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let rest: Vec<_> = std::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(rest, expected);
    }
}
