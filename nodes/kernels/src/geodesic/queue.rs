//! Priority queues of numbered items by non-negative distance: one in exact order, lowest number first among equals, and one in buckets.

use crate::heap::Heap;

/// A heap of items by distance. Non-negative doubles order as their bits do, so that an entry is one integer: distance above, item below.
#[derive(Debug, Clone, Default)]
pub(super) struct Queue(Heap);

impl Queue {
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Adds an item. The distance must not be negative (nor -0.0) or NaN.
    pub(super) fn push(&mut self, distance: f64, item: u32) {
        self.0.push(u128::from(distance.to_bits()) << 32 | u128::from(item));
    }

    /// Removes and returns the nearest item.
    pub(super) fn pop(&mut self) -> Option<(f64, u32)> {
        self.0.pop().map(|entry| (f64::from_bits((entry >> 32) as u64), entry as u32))
    }
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
    /// The buckets one after the other, each with room for `room` vertices.
    slots: Vec<Waiting>,
    room: usize,
    lengths: [usize; BUCKETS],
    /// Bit i: bucket i is not empty.
    occupied: u64,
    at: usize,
    /// Buckets per unit of distance.
    density: f64,
    /// What [`Front::take`] writes into: its memory.
    pub(super) spare: Vec<Waiting>,
    /// Vertices that are going to wait: so many, and room behind them.
    noted: Vec<Waiting>,
    count: usize,
}

/// From one bucket to the next in memory there are so many slots more than a power of two, or all would begin in the same sets of the cache.
const SKEW: usize = 4;

impl Default for Front {
    fn default() -> Self {
        let [slots, spare, noted] = [Vec::new(), Vec::new(), Vec::new()];
        Self { slots, room: 0, lengths: [0; BUCKETS], occupied: 0, at: 0, density: 0.0, spare, noted, count: 0 }
    }
}

impl Front {
    /// Empties it, for steps of so much on average and at most.
    pub(super) fn start(&mut self, mean: f64, most: f64) {
        self.lengths = [0; BUCKETS];
        self.occupied = 0;
        self.at = 0;
        let width = (mean / 4.0).max(most / (BUCKETS - 2) as f64);
        // Without lengths everything is in the first bucket.
        self.density = if width > 0.0 && (1.0 / width).is_finite() { 1.0 / width } else { 0.0 };
        if self.room == 0 {
            self.grow();
        }
    }

    /// Empty since its start, it goes on from this distance.
    pub(super) fn resume(&mut self, distance: f64) {
        self.at = bucket(distance, self.density);
    }

    #[cold]
    fn grow(&mut self) {
        let (old, room) = (self.room + SKEW, (2 * self.room).max(32));
        let slots = std::mem::replace(&mut self.slots, vec![(0, 0.0); BUCKETS * (room + SKEW)]);
        self.room = room;
        for (bucket, &length) in self.lengths.iter().enumerate().filter(|b| *b.1 > 0) {
            self.slots[bucket * (room + SKEW)..][..length].copy_from_slice(&slots[bucket * old..][..length]);
        }
    }

    /// Adds a vertex. The distance must be finite and not negative.
    #[inline(always)]
    pub(super) fn push(&mut self, distance: f64, vertex: u32) {
        let bucket = bucket(distance, self.density);
        if self.lengths[bucket] == self.room {
            self.grow();
        }
        self.slots[bucket * (self.room + SKEW) + self.lengths[bucket]] = (vertex, distance);
        self.lengths[bucket] += 1;
        self.occupied |= 1 << bucket;
    }

    /// Notes those of so many vertices, after their distances, that are marked, for [`Front::push_noted`]. All are written down, and the mark moves the end:
    /// half of the branches would be guessed wrong.
    #[inline(always)]
    pub(super) fn note(&mut self, count: usize, vertices: impl Iterator<Item = (f64, u32, bool)>) {
        if self.noted.len() < self.count + count {
            self.noted.resize(2 * (self.count + count), (0, 0.0));
        }
        let (noted, mut end) = (self.noted.as_mut_slice(), self.count);
        for (distance, vertex, wanted) in vertices {
            noted[end] = (vertex, distance);
            end += usize::from(wanted);
        }
        self.count = end;
    }

    /// Adds what was noted: few of those that are looked at, so that buckets are found for few.
    #[inline(always)]
    pub(super) fn push_noted(&mut self) {
        let noted = std::mem::take(&mut self.noted);
        for &(vertex, distance) in &noted[..self.count] {
            self.push(distance, vertex);
        }
        (self.noted, self.count) = (noted, 0);
    }

    /// Moves on to the next bucket with vertices; false if there is none.
    pub(super) fn advance(&mut self) -> bool {
        self.at = (self.at + self.occupied.rotate_right(self.at as u32).trailing_zeros() as usize) % BUCKETS;
        self.occupied != 0
    }

    fn waiting(&self, bucket: usize) -> &[Waiting] {
        &self.slots[bucket * (self.room + SKEW)..][..self.lengths[bucket]]
    }

    /// Visits all that wait.
    pub(super) fn for_each(&self, mut visit: impl FnMut(u32)) {
        let mut left = self.occupied;
        while left != 0 {
            self.waiting(left.trailing_zeros() as usize).iter().for_each(|e| visit(e.0));
            left &= left - 1;
        }
    }

    /// Empties the present bucket, and lists those of it that are still as far as when they were pushed; false if nothing was in it.
    #[inline(always)]
    pub(super) fn take(&mut self, distance: &[f64], list: &mut Vec<Waiting>) -> bool {
        let bucket = self.waiting(self.at);
        let (any, mut end) = (!bucket.is_empty(), 0);
        list.resize(bucket.len(), (0, 0.0));
        for &entry in bucket {
            list[end] = entry;
            end += usize::from(entry.1 == distance[entry.0 as usize]);
        }
        list.truncate(end);
        self.lengths[self.at] = 0;
        self.occupied &= !(1 << self.at);
        any
    }
}

#[inline(always)]
fn bucket(distance: f64, density: f64) -> usize {
    (distance * density + ROUND).to_bits() as usize % BUCKETS
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
