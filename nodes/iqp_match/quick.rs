//! A good match in little time, without bound or proof: for ranking, where there are very many pairs.
//!
//! Spectral matching (Leordeanu & Hebert 2005) gives the order in which candidates are tried, and local search improves what
//! came of it: candidates are put in, with those that they exclude taken out, and taken out, as long as the objective grows.

use super::Earned;
use super::model::Model;

/// Products with the matrix of scores for its leading eigenvector.
const PRODUCTS: usize = 15;

/// The matches, in the order of the model's candidates.
pub(super) fn best(model: &Model, passes: usize) -> Vec<Earned> {
    let mut search = Search::new(model);
    for a in search.order() {
        if search.gain[a] > 0.0 && search.excluded(a).is_empty() {
            search.put(a);
        }
    }
    for _ in 0..passes {
        if !search.improve() {
            break;
        }
    }
    let earned = |a: usize| {
        let (c, alone) = (&model.candidates[a], search.alone[a]);
        // `gain` has each pair at both ends.
        Earned { left: c.left, right: c.right, distance: c.distance, alone, together: 0.5 * (search.gain[a] - alone) }
    };
    (0..search.chosen.len()).filter(|a| search.chosen[*a]).map(earned).collect()
}

struct Search {
    ends: Vec<[usize; 2]>,
    alone: Vec<f64>,
    /// What two candidates earn together, row by row.
    together: Vec<f64>,
    chosen: Vec<bool>,
    /// What each candidate earns, or would earn, with those chosen.
    gain: Vec<f64>,
    /// The chosen candidate of each feature, on either side.
    at: [Vec<Option<usize>>; 2],
}

impl Search {
    fn new(model: &Model) -> Self {
        let c = &model.candidates;
        let m = c.len();
        let mut together = vec![0.0; m * m];
        for i in 0..m {
            for j in i + 1..m {
                let value = model.together(&c[i], &c[j]);
                (together[i * m + j], together[j * m + i]) = (value, value);
            }
        }
        let count =
            |side: fn(&[usize; 2]) -> usize, ends: &[[usize; 2]]| ends.iter().map(side).max().map_or(0, |n| n + 1);
        let ends: Vec<[usize; 2]> = c.iter().map(|c| [c.left, c.right]).collect();
        let at = [vec![None; count(|e| e[0], &ends)], vec![None; count(|e| e[1], &ends)]];
        let alone: Vec<f64> = c.iter().map(|c| model.alone(c)).collect();
        Self { gain: alone.clone(), chosen: vec![false; m], ends, alone, together, at }
    }

    fn row(&self, a: usize) -> &[f64] {
        let m = self.ends.len();
        &self.together[a * m..(a + 1) * m]
    }

    /// Candidates by the leading eigenvector of the positive scores, the greatest first.
    fn order(&self) -> Vec<usize> {
        let m = self.ends.len();
        let mut x = vec![1.0; m];
        for _ in 0..PRODUCTS {
            let product =
                |a: usize| self.alone[a] * x[a] + self.row(a).iter().zip(&x).map(|(h, x)| h.max(0.0) * x).sum::<f64>();
            let next: Vec<f64> = (0..m).map(product).collect();
            let largest = next.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            x = next.into_iter().map(|v| v / largest).collect();
        }
        let mut order: Vec<usize> = (0..m).collect();
        order.sort_by(|a, b| x[*b].total_cmp(&x[*a]).then(a.cmp(b)));
        order
    }

    /// The chosen candidates, at most two, that share a feature with this one.
    fn excluded(&self, a: usize) -> Vec<usize> {
        let [left, right] = self.ends[a];
        let mut found: Vec<usize> = [self.at[0][left], self.at[1][right]].into_iter().flatten().collect();
        found.dedup();
        found
    }

    fn put(&mut self, a: usize) {
        self.change(a, 1.0);
        let [left, right] = self.ends[a];
        (self.at[0][left], self.at[1][right]) = (Some(a), Some(a));
    }

    fn take(&mut self, a: usize) {
        self.change(a, -1.0);
        let [left, right] = self.ends[a];
        (self.at[0][left], self.at[1][right]) = (None, None);
    }

    fn change(&mut self, a: usize, sign: f64) {
        self.chosen[a] = sign > 0.0;
        let m = self.ends.len();
        let row = &self.together[a * m..(a + 1) * m];
        self.gain.iter_mut().zip(row).for_each(|(g, h)| *g += sign * h);
    }

    /// One look at every candidate; whether anything changed.
    fn improve(&mut self) -> bool {
        // Less than this is rounding.
        const LEAST: f64 = 1e-9;
        let mut changed = false;
        for a in 0..self.ends.len() {
            if self.chosen[a] {
                if self.gain[a] < -LEAST {
                    self.take(a);
                    changed = true;
                }
                continue;
            }
            let out = self.excluded(a);
            let mut lost: f64 = out.iter().map(|b| self.gain[*b]).sum();
            if let [b, c] = out[..] {
                lost -= self.row(b)[c];
            }
            // Candidates that share a feature earn nothing together, so the gain of `a` is already without those.
            if self.gain[a] > lost + LEAST {
                for b in out {
                    self.take(b);
                }
                self.put(a);
                changed = true;
            }
        }
        changed
    }
}
