//! A priority queue of integers.

/// A heap with four children to a node, the least on top: half the levels of a binary one, and the four keys compared lie in one cache line.
#[derive(Debug, Clone, Default)]
pub(crate) struct Heap(Vec<u128>);

const CHILDREN: usize = 4;

impl Heap {
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    pub(crate) fn push(&mut self, entry: u128) {
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

    /// Removes and returns the least entry.
    pub(crate) fn pop(&mut self) -> Option<u128> {
        let last = self.0.pop()?;
        let Some(&top) = self.0.first() else { return Some(last) };
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
        Some(top)
    }
}
