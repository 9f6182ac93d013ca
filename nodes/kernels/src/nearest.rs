//! Nearest vertex of a point set, by a balanced k-d tree.

use crate::vec3::distance2;

/// A balanced k-d tree over fixed points.
///
/// The points of a subtree are a contiguous run of `order`, with its root in the middle: no node records are needed.
#[derive(Debug, Clone)]
pub struct NearestVertex {
    points: Vec<[f64; 3]>,
    order: Vec<u32>,
    axes: Vec<u8>,
}

impl NearestVertex {
    /// Builds the tree in O(n log n). Points that are not finite are left out and never found.
    #[must_use]
    pub fn new(points: &[[f64; 3]]) -> Self {
        let finite = |i: &u32| points[*i as usize].iter().all(|x| x.is_finite());
        let order: Vec<u32> = (0..points.len() as u32).filter(finite).collect();
        let axes = vec![0; order.len()];
        let mut tree = Self {
            points: points.to_vec(),
            order,
            axes,
        };
        tree.build(0, tree.order.len());
        tree
    }

    fn build(&mut self, start: usize, end: usize) {
        if end - start < 2 {
            return;
        }
        let run = &mut self.order[start..end];
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &i in run.iter() {
            for (axis, &x) in self.points[i as usize].iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        let widest = |best: usize, axis: usize| {
            if high[axis] - low[axis] > high[best] - low[best] {
                axis
            } else {
                best
            }
        };
        let axis = (1..3).fold(0, widest);
        let middle = (end - start) / 2;
        let points = &self.points;
        run.select_nth_unstable_by(middle, |&i, &j| {
            points[i as usize][axis]
                .total_cmp(&points[j as usize][axis])
                .then(i.cmp(&j))
        });
        self.axes[start + middle] = axis as u8;
        self.build(start, start + middle);
        self.build(start + middle + 1, end);
    }

    /// The index of the point nearest to `query` and its distance; the lowest index among equally near ones.
    /// `None` when there are no points or the query is not finite.
    #[must_use]
    pub fn nearest(&self, query: [f64; 3]) -> Option<(u32, f64)> {
        if query.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let mut best = (f64::INFINITY, u32::MAX);
        self.search(query, 0, self.order.len(), &mut best);
        (best.1 != u32::MAX).then(|| (best.1, best.0.sqrt()))
    }

    fn search(&self, query: [f64; 3], start: usize, end: usize, best: &mut (f64, u32)) {
        if start == end {
            return;
        }
        let middle = start + (end - start) / 2;
        let index = self.order[middle];
        let point = self.points[index as usize];
        let found = (distance2(query, point), index);
        if found < *best {
            *best = found;
        }
        let axis = usize::from(self.axes[middle]);
        let offset = query[axis] - point[axis];
        let below = (start, middle);
        let above = (middle + 1, end);
        let (near, far) = if offset < 0.0 {
            (below, above)
        } else {
            (above, below)
        };
        self.search(query, near.0, near.1, best);
        // Not strict: a point at the very same distance but of lower index may lie across the plane.
        if offset * offset <= best.0 {
            self.search(query, far.0, far.1, best);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(count: usize, levels: u64) -> Vec<[f64; 3]> {
        let mut state = 7u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % levels) as f64 / levels as f64
        };
        (0..count).map(|_| [next(), next(), next()]).collect()
    }

    fn brute(points: &[[f64; 3]], query: [f64; 3]) -> (u32, f64) {
        let all = points
            .iter()
            .zip(0u32..)
            .map(|(&p, i)| (distance2(query, p), i));
        let (d, i) = all.min_by(|a, b| a.partial_cmp(b).unwrap()).unwrap();
        (i, d.sqrt())
    }

    #[test]
    fn agrees_with_brute_force_even_on_ties() {
        // Four levels per axis: nearly every query has ties and repeated points.
        for levels in [4, 1 << 20] {
            let set = points(700, levels);
            let tree = NearestVertex::new(&set);
            for query in points(900, 8).into_iter().chain(set.iter().copied()) {
                assert_eq!(tree.nearest(query), Some(brute(&set, query)));
            }
        }
    }

    #[test]
    fn empty_and_not_finite() {
        assert_eq!(NearestVertex::new(&[]).nearest([0.0; 3]), None);
        let tree = NearestVertex::new(&[[f64::NAN; 3], [1.0, 0.0, 0.0]]);
        assert_eq!(tree.nearest([0.0; 3]), Some((1, 1.0)));
        assert_eq!(tree.nearest([f64::INFINITY; 3]), None);
    }
}
