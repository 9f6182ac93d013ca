//! A priority queue of numbered items by non-negative distance, lowest number first among equals.

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

/// Buckets of a [`Calendar`]; a power of two.
const BUCKETS: usize = 64;

/// The same order from a heap of what comes next and a ring of unsorted buckets of what comes later: most pushes only append, and
/// the heap holds a few items. For items pushed at most a known step beyond the last one popped.
#[derive(Debug, Clone, Default)]
pub(super) struct Calendar {
    next: Queue,
    later: Vec<Vec<(f64, u32)>>,
    waiting: usize,
    current: u64,
    /// Buckets per unit of distance.
    density: f64,
}

impl Calendar {
    /// Empties it, for steps of so much on average and at most.
    pub(super) fn start(&mut self, mean: f64, most: f64) {
        self.next.clear();
        self.later.resize_with(BUCKETS, Vec::new);
        if self.waiting > 0 {
            self.later.iter_mut().for_each(Vec::clear);
        }
        (self.waiting, self.current) = (0, 0);
        let width = (mean / 8.0).max(most / (BUCKETS - 2) as f64);
        // Without lengths everything is in the first bucket, and that is the heap.
        self.density = if width > 0.0 && (1.0 / width).is_finite() { 1.0 / width } else { 0.0 };
    }

    /// Adds an item. The distance must be finite, and neither negative nor -0.0.
    pub(super) fn push(&mut self, distance: f64, item: u32) {
        let bucket = (distance * self.density) as u64;
        if bucket <= self.current {
            self.next.push(distance, item);
        } else {
            self.later[bucket as usize % BUCKETS].push((distance, item));
            self.waiting += 1;
        }
    }

    /// Visits all items, in no particular order.
    pub(super) fn for_each(&self, mut visit: impl FnMut(f64, u32)) {
        self.next.0.iter().map(|&entry| unpacked(entry)).for_each(|(distance, item)| visit(distance, item));
        self.later.iter().flatten().for_each(|&(distance, item)| visit(distance, item));
    }

    /// Removes and returns the nearest item.
    pub(super) fn pop(&mut self) -> Option<(f64, u32)> {
        if let Some(item) = self.next.pop() {
            return Some(item);
        }
        while self.waiting > 0 {
            self.current += 1;
            let bucket = &mut self.later[self.current as usize % BUCKETS];
            if !bucket.is_empty() {
                self.waiting -= bucket.len();
                bucket.drain(..).for_each(|(distance, item)| self.next.push(distance, item));
                return self.next.pop();
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calendar_is_a_queue() {
        // Steps of very different lengths, none and the longest included, beyond the last item popped.
        let (mut calendar, mut queue, mut state, mut last) = (Calendar::default(), Queue::default(), 1u32, 0.0);
        for (mean, most) in [(0.5, 1.0), (0.01, 100.0), (0.0, 0.0)] {
            calendar.start(mean, most);
            queue.clear();
            last *= 0.0;
            for round in 0..5000u32 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let step = most * (f64::from(state >> 8) / f64::from(1 << 24)).powi(1 + (state >> 4 & 7) as i32);
                calendar.push(last + step, round);
                queue.push(last + step, round);
                if round % 2 == 1 {
                    let found = calendar.pop();
                    assert_eq!(found, queue.pop());
                    last = found.map_or(last, |e| e.0);
                }
            }
            while let Some(item) = queue.pop() {
                assert_eq!(calendar.pop(), Some(item));
            }
            assert_eq!(calendar.pop(), None);
        }
    }

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
