//! Sparse linear assignment in integers: maximum weight, by shortest augmenting paths.

/// Marks an entry that must not be used.
pub(super) const FORBIDDEN: i64 = i64::MIN;
const NONE: u32 = u32::MAX;

/// Working memory and result of [`Lap::solve`]. Duals: `u[left] + v[right] >= w` on every usable entry, `v >= 0` and 0 on free
/// rights, and (if optional) `u >= 0`; their sum is the optimum.
#[derive(Default)]
pub(super) struct Lap {
    pub u: Vec<i64>,
    pub v: Vec<i64>,
    /// Entry (index into the arrays given) that each left uses, `u32::MAX` for none.
    pub used: Vec<u32>,
    owner: Vec<u32>,
    dist: Vec<i64>,
    via: Vec<u32>,
    open: Vec<u32>,
    done: Vec<u32>,
    tree: Vec<(u32, i64)>,
    free: Vec<u32>,
}

impl Lap {
    /// Left `k` chooses among entries `start[k]..start[k + 1]`, of weight `w[e]` and right feature `right[e]`, or nothing (weight 0)
    /// if `optional`, no two the same right. Left `skip` takes no part. `None`: not every left can be served.
    pub fn solve(
        &mut self,
        start: &[u32],
        right: &[u32],
        w: &[i64],
        n_right: usize,
        optional: bool,
        skip: usize,
    ) -> Option<i64> {
        let n = start.len() - 1;
        refill(&mut self.u, n, 0);
        refill(&mut self.used, n, NONE);
        self.reset(right, n_right);
        for k in (0..n).filter(|&k| k != skip) {
            let mut best = if optional { 0 } else { FORBIDDEN };
            let mut at = NONE;
            for e in start[k]..start[k + 1] {
                if w[e as usize] > best {
                    (best, at) = (w[e as usize], e);
                }
            }
            if at == NONE {
                if !optional {
                    return None;
                }
                continue;
            }
            self.u[k] = best;
            let r = right[at as usize] as usize;
            if self.owner[r] == NONE {
                self.owner[r] = k as u32;
                self.used[k] = at;
            } else {
                self.free.push(k as u32);
            }
        }
        for f in 0..self.free.len() {
            if !self.augment(self.free[f], start, right, w, optional) {
                return None;
            }
        }
        // Only matched rights have a dual above 0.
        let matched = self.used.iter().filter(|&&e| e != NONE).map(|&e| self.v[right[e as usize] as usize]);
        Some(self.u.iter().sum::<i64>() + matched.sum::<i64>())
    }

    /// Of the rights only those that occur: most problems are small parts of a larger one. The duals of others are left as they were.
    fn reset(&mut self, right: &[u32], n_right: usize) {
        if self.v.len() < n_right {
            self.v.resize(n_right, 0);
            self.owner.resize(n_right, NONE);
            self.dist.resize(n_right, i64::MAX);
            self.via.resize(n_right, NONE);
        }
        for &r in right {
            (self.v[r as usize], self.owner[r as usize]) = (0, NONE);
        }
        self.free.clear();
    }

    /// Forgets all duals.
    pub fn clear(&mut self) {
        self.v.fill(0);
    }

    /// Dijkstra over reduced costs from left `root` to a free right, or to a left that had better stay unmatched.
    fn augment(&mut self, root: u32, start: &[u32], right: &[u32], w: &[i64], optional: bool) -> bool {
        self.tree.clear();
        self.open.clear();
        self.done.clear();
        let (mut left, mut base) = (root, 0);
        // Shortest way out through a left that gives up its right.
        let (mut quit, mut quit_left) = (i64::MAX, NONE);
        let end = loop {
            self.tree.push((left, base));
            let u = self.u[left as usize];
            if optional && base + u < quit {
                (quit, quit_left) = (base + u, left);
            }
            for e in start[left as usize]..start[left as usize + 1] {
                let (r, weight) = (right[e as usize] as usize, w[e as usize]);
                if weight == FORBIDDEN || e == self.used[left as usize] {
                    continue;
                }
                let d = base + u + self.v[r] - weight;
                if d < self.dist[r] && d < quit {
                    if self.dist[r] == i64::MAX {
                        self.open.push(r as u32);
                    }
                    self.dist[r] = d;
                    self.via[r] = e;
                }
            }
            let Some((at, r)) = self.nearest() else {
                break NONE;
            };
            if self.dist[r as usize] >= quit {
                break NONE;
            }
            self.open.swap_remove(at);
            self.done.push(r);
            let owner = self.owner[r as usize];
            if owner == NONE {
                break r;
            }
            (left, base) = (owner, self.dist[r as usize]);
        };
        let found = end != NONE || quit_left != NONE;
        if found {
            let length = if end == NONE { quit } else { self.dist[end as usize] };
            self.update_duals(length);
            self.flip(root, end, quit_left, start, right);
        }
        for r in self.open.drain(..).chain(self.done.drain(..)) {
            self.dist[r as usize] = i64::MAX;
            self.via[r as usize] = NONE;
        }
        found
    }

    /// The open right at the least distance; a free one first among equals, then the lowest index.
    fn nearest(&self) -> Option<(usize, u32)> {
        let key = |r: u32| (self.dist[r as usize], self.owner[r as usize] != NONE, r);
        self.open.iter().copied().enumerate().min_by_key(|&(_, r)| key(r))
    }

    fn update_duals(&mut self, length: i64) {
        for &(left, base) in &self.tree {
            self.u[left as usize] -= length - base;
        }
        for &r in &self.done {
            self.v[r as usize] += length - self.dist[r as usize];
        }
    }

    /// Changes the matching along the path back from the free right `end`, or from the left that gives up its right.
    fn flip(&mut self, root: u32, end: u32, quit_left: u32, start: &[u32], right: &[u32]) {
        let mut r = end;
        if end == NONE {
            if quit_left == root {
                return;
            }
            let entry = self.used[quit_left as usize];
            self.used[quit_left as usize] = NONE;
            r = right[entry as usize];
        }
        loop {
            let entry = self.via[r as usize];
            // The left that owns the entry, among those of the search tree.
            let left = self
                .tree
                .iter()
                .map(|t| t.0)
                .find(|&k| (start[k as usize]..start[k as usize + 1]).contains(&entry))
                .expect("an entry on the path was reached from a left of the tree");
            let before = std::mem::replace(&mut self.used[left as usize], entry);
            self.owner[r as usize] = left;
            if left == root {
                return;
            }
            r = right[before as usize];
        }
    }
}

fn refill<T: Copy>(v: &mut Vec<T>, n: usize, value: T) {
    v.clear();
    v.resize(n, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brute(k: usize, taken: u32, rows: &[Vec<(u32, i64)>], optional: bool) -> Option<i64> {
        if k == rows.len() {
            return Some(0);
        }
        let skip = if optional { brute(k + 1, taken, rows, optional) } else { None };
        let choices = rows[k].iter().filter(|(r, w)| taken >> r & 1 == 0 && *w != FORBIDDEN);
        choices.filter_map(|&(r, w)| Some(w + brute(k + 1, taken | 1 << r, rows, optional)?)).chain(skip).max()
    }

    #[test]
    fn equals_enumeration_and_duals_certify_it() {
        let mut seed = 7_u64;
        let mut next = |n: u64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) % n
        };
        let mut lap = Lap::default();
        let (mut solved, mut infeasible) = (0, 0);
        for case in 0..4000 {
            let (n, m, optional) = (next(6) as usize, 1 + next(6) as u32, case % 2 == 0);
            let rows: Vec<Vec<(u32, i64)>> = (0..n)
                .map(|_| {
                    let list = (0..m).map(|r| (r, next(20) as i64 - 8)).filter(|e| e.1 % 4 != 0);
                    list.map(|(r, w)| if w == 3 { (r, FORBIDDEN) } else { (r, w) }).collect()
                })
                .collect();
            let mut start = vec![0_u32];
            for row in &rows {
                start.push(start[start.len() - 1] + row.len() as u32);
            }
            let right: Vec<u32> = rows.iter().flatten().map(|e| e.0).collect();
            let w: Vec<i64> = rows.iter().flatten().map(|e| e.1).collect();
            let got = lap.solve(&start, &right, &w, m as usize, optional, usize::MAX);
            assert_eq!(got, brute(0, 0, &rows, optional), "{rows:?} {optional}");
            let Some(value) = got else {
                infeasible += 1;
                continue;
            };
            solved += 1;
            let mut primal = 0;
            for k in 0..n {
                assert!(!optional || lap.u[k] >= 0);
                if lap.used[k] != NONE {
                    primal += w[lap.used[k] as usize];
                }
                for e in start[k] as usize..start[k + 1] as usize {
                    assert!(w[e] == FORBIDDEN || lap.u[k] + lap.v[right[e] as usize] >= w[e]);
                }
            }
            assert!(lap.v.iter().all(|&v| v >= 0));
            assert_eq!(primal, value);
        }
        assert!(solved > 1000 && infeasible > 100, "{solved} {infeasible}");
    }
}
