//! Supernodes: runs of columns of the factor with the same pattern, or nearly so, and how their fronts fit into each other.

use super::order::{Elimination, Entries, NONE};
use std::ops::Range;

/// A supernode: columns `begin..end` of the factor, and its rows below them.
#[derive(Clone, Copy)]
pub(crate) struct Supernode {
    pub begin: usize,
    pub end: usize,
    /// Where its rows begin and end in [`Symbolic::rows`].
    rows: (usize, usize),
    /// How many supernodes just finished are its children.
    pub children: usize,
}

impl Supernode {
    pub fn width(&self) -> usize {
        self.end - self.begin
    }

    /// The places of its rows.
    pub fn below(&self) -> Range<usize> {
        self.rows.0..self.rows.1
    }

    /// Columns and rows below.
    pub fn height(&self) -> usize {
        self.end - self.begin + self.rows.1 - self.rows.0
    }
}

/// The pattern of a factor.
#[derive(Clone)]
pub(crate) struct Symbolic {
    pub nodes: Vec<Supernode>,
    /// The rows below each supernode, ascending.
    pub rows: Vec<u32>,
    /// For each of these rows its place in the front of the parent: that of the supernode that has the first of them as a column.
    pub in_parent: Vec<u32>,
    /// For each entry of the matrix below the diagonal its place in the front of its column.
    pub in_front: Vec<u32>,
    /// The most that waits on the stack of fronts, in numbers.
    pub stack: usize,
}

impl Symbolic {
    /// The pattern of the factor in this order.
    ///
    /// Runs of columns are merged with the one after them as long as at most a share of the merged one is zero, `relaxed` by the largest number of
    /// columns: zeros cost arithmetic, small supernodes cost everything else.
    pub fn new(elimination: &Elimination, relaxed: &[(usize, f64)]) -> Self {
        let mut nodes = Vec::new();
        let mut node_of = vec![0u32; elimination.parents.len()];
        let mut rows = 0;
        for (s, run) in merged(elimination, relaxed).into_iter().rev().enumerate() {
            let below = run.height - (run.end - run.begin);
            node_of[run.begin..run.end].fill(s as u32);
            nodes.push(Supernode { begin: run.begin, end: run.end, rows: (rows, rows + below), children: 0 });
            rows += below;
        }
        let parent = |node: &Supernode| node_of.get(elimination.parents[node.end - 1] as usize).copied();
        let parents: Vec<u32> = nodes.iter().map(|node| parent(node).unwrap_or(NONE)).collect();
        for &parent in parents.iter().filter(|p| **p != NONE) {
            nodes[parent as usize].children += 1;
        }
        let rows = fill(&elimination.entries, &nodes, &node_of, &parents);
        let (in_parent, in_front) = (vec![0; rows.len()], vec![0; elimination.entries.rows.len()]);
        let mut symbolic = Self { nodes, rows, in_parent, in_front, stack: 0 };
        symbolic.place(&elimination.entries);
        symbolic
    }

    /// Runs of supernodes that do not depend on what is not in them: whole subtrees of the elimination tree, each with at most this share of all
    /// work, and none of them if all of it is less than `least`, in nanoseconds as measured.
    pub fn branches(&self, share: f64, least: f64) -> Vec<Range<usize>> {
        // The work of each subtree, and its first supernode.
        let mut subtrees: Vec<(f64, usize)> = Vec::with_capacity(self.nodes.len());
        let mut waiting: Vec<usize> = Vec::new();
        for (s, node) in self.nodes.iter().enumerate() {
            let children = waiting.drain(waiting.len() - node.children..).map(|child| subtrees[child]);
            let subtree = children.fold((work(node), s), |sum, child| (sum.0 + child.0, sum.1.min(child.1)));
            subtrees.push(subtree);
            waiting.push(s);
        }
        let total: f64 = waiting.iter().map(|&root| subtrees[root].0).sum();
        let mut branches: Vec<(f64, Range<usize>)> = Vec::new();
        let mut end = if total < least { 0 } else { self.nodes.len() };
        while end > 0 {
            let (work, begin) = subtrees[end - 1];
            if work > share * total {
                end -= 1;
                continue;
            }
            match branches.last_mut() {
                Some(next) if next.1.start == end && next.0 + work <= share * total => {
                    *next = (next.0 + work, begin..next.1.end);
                }
                _ => branches.push((work, begin..end)),
            }
            end = begin;
        }
        // Small ones are not worth the hand-over.
        branches.into_iter().rev().filter(|b| b.0 > 0.05 * share * total).map(|b| b.1).collect()
    }

    /// Finds the places in fronts, and the size of the stack.
    fn place(&mut self, entries: &Entries) {
        let mut place = vec![0u32; entries.diagonal.len()];
        let mut waiting: Vec<usize> = Vec::new();
        let mut stack = 0;
        for (s, node) in self.nodes.iter().enumerate() {
            let rows = (node.begin as u32..node.end as u32).chain(self.rows[node.below()].iter().copied());
            for (row, at) in rows.zip(0..) {
                place[row as usize] = at;
            }
            let own = entries.column(node.begin).start..entries.column(node.end - 1).end;
            for (at, &row) in self.in_front[own.clone()].iter_mut().zip(&entries.rows[own]) {
                *at = place[row as usize];
            }
            for child in waiting.drain(waiting.len() - node.children..) {
                for at in self.nodes[child].below() {
                    self.in_parent[at] = place[self.rows[at] as usize];
                }
                stack -= triangle(self.nodes[child].below().len());
            }
            stack += triangle(node.below().len());
            self.stack = self.stack.max(stack);
            waiting.push(s);
        }
    }
}

/// About how many nanoseconds a supernode takes: arithmetic, what is handed to the parent, and the rest.
fn work(node: &Supernode) -> f64 {
    let squares = (0..node.width()).map(|c| ((node.height() - c) * (node.height() - c)) as f64);
    0.02 * squares.sum::<f64>() + 0.8 * triangle(node.below().len()) as f64 + 120.0
}

/// Entries of a lower triangle.
pub(super) fn triangle(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

/// The rows below each supernode: row i is in those on the paths from the entries of the matrix's row up to that of column i.
fn fill(entries: &Entries, nodes: &[Supernode], node_of: &[u32], parents: &[u32]) -> Vec<u32> {
    let mut rows = vec![0; nodes.last().map_or(0, |node| node.rows.1)];
    let mut next: Vec<usize> = nodes.iter().map(|node| node.rows.0).collect();
    let mut met = vec![NONE; nodes.len()];
    for i in 0..node_of.len() as u32 {
        for &j in entries.row(i) {
            let mut s = node_of[j as usize];
            while s < node_of[i as usize] && met[s as usize] != i {
                met[s as usize] = i;
                rows[next[s as usize]] = i;
                next[s as usize] += 1;
                s = parents[s as usize];
            }
        }
    }
    rows
}

/// A run with the height of its first column and the zeros stored in it.
struct Run {
    begin: usize,
    end: usize,
    height: usize,
    zeros: usize,
}

/// Runs of columns, merged, from the last.
fn merged(elimination: &Elimination, relaxed: &[(usize, f64)]) -> Vec<Run> {
    let Elimination { parents, counts, .. } = elimination;
    let stored = |width: usize, height: usize| width * height - width * (width - 1) / 2;
    // From the last: a run can take in the one before it if that one's parent is in it.
    let mut runs: Vec<Run> = Vec::new();
    let mut end = parents.len();
    while end > 0 {
        let mut begin = end - 1;
        while begin > 0 && parents[begin - 1] as usize == begin && counts[begin - 1] == counts[begin] + 1 {
            begin -= 1;
        }
        let run = Run { begin, end, height: counts[begin] as usize, zeros: 0 };
        end = begin;
        if let Some(next) = runs.last_mut().filter(|next| (parents[run.end - 1] as usize) < next.end) {
            let (width, height) = (next.end - run.begin, next.height + run.end - run.begin);
            let full = stored(width, height);
            let real = stored(run.end - run.begin, run.height) + stored(next.end - next.begin, next.height);
            let zeros = next.zeros + full - real;
            let share = zeros as f64 / full as f64;
            if relaxed.iter().any(|&(columns, most)| width <= columns && share <= most) {
                *next = Run { begin: run.begin, end: next.end, height, zeros };
                continue;
            }
        }
        runs.push(run);
    }
    runs
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::random::Random;
    use crate::sparse::SymmetricCsr;

    /// A weighted graph with components, isolated rows, a grid and chords across it, its rows in random order.
    pub fn matrix(grid: usize, chords: usize, isolated: usize) -> SymmetricCsr {
        let mut random = Random::new(&[grid as u64, chords as u64]);
        let n = grid * grid + 3 + isolated;
        let names = random.permutation(n);
        let at = |i: usize, j: usize| names[i * grid + j];
        // A path of three rows is another component.
        let mut ends =
            vec![(names[grid * grid], names[grid * grid + 1]), (names[grid * grid + 1], names[grid * grid + 2])];
        for (i, j) in (0..grid).flat_map(|i| (0..grid).map(move |j| (i, j))) {
            ends.extend((i + 1 < grid).then(|| (at(i, j), at(i + 1, j))));
            ends.extend((j + 1 < grid).then(|| (at(i, j), at(i, j + 1))));
        }
        for _ in 0..chords {
            let mut any = || names[(random.unit() * (grid * grid) as f64) as usize];
            ends.push((any(), any()));
        }
        let weights: Vec<f64> = ends.iter().map(|_| 0.5 + random.unit()).collect();
        SymmetricCsr::graph_laplacian(n, ends.into_iter(), &weights)
    }

    /// The pattern of the factor, by elimination of one row after the other.
    fn pattern(matrix: &SymmetricCsr, elimination: &Elimination) -> Vec<Vec<bool>> {
        let n = elimination.order.len();
        let mut columns = vec![vec![false; n]; n];
        for (j, &row) in elimination.order.iter().enumerate() {
            for (column, _) in matrix.row(row as usize) {
                if elimination.position[column] != NONE {
                    columns[j][elimination.position[column] as usize] = true;
                }
            }
        }
        for j in 0..n {
            let below: Vec<usize> = (j + 1..n).filter(|&i| columns[j][i]).collect();
            for &k in &below {
                below.iter().filter(|&&i| i > k).for_each(|&i| columns[k][i] = true);
            }
            columns[j][..j].fill(false);
        }
        columns
    }

    fn check(matrix: &SymmetricCsr, elimination: &Elimination, relaxed: &[(usize, f64)]) {
        let (n, columns) = (elimination.order.len(), pattern(matrix, elimination));
        for (j, column) in columns.iter().enumerate() {
            assert_eq!(elimination.counts[j] as usize, column.iter().filter(|x| **x).count(), "column {j}");
            let parent = (j + 1..n).find(|&i| column[i]).map_or(NONE, |i| i as u32);
            assert_eq!(elimination.parents[j], parent);
        }
        let symbolic = Symbolic::new(elimination, relaxed);
        let rows = |s: usize| {
            let node = &symbolic.nodes[s];
            (node.begin as u32..node.end as u32)
                .chain(symbolic.rows[node.below()].iter().copied())
                .collect::<Vec<u32>>()
        };
        let (mut waiting, mut end) = (Vec::<usize>::new(), 0);
        for (s, node) in symbolic.nodes.iter().enumerate() {
            assert_eq!((node.begin, node.height()), (end, rows(s).len()));
            end = node.end;
            assert!(rows(s).is_sorted());
            let (mut zeros, mut stored) = (0, 0);
            for j in node.begin..node.end {
                let later: Vec<u32> = rows(s).into_iter().filter(|&i| i as usize >= j).collect();
                let real: Vec<u32> = (j as u32..n as u32).filter(|&i| columns[j][i as usize]).collect();
                assert!(real.iter().all(|i| later.contains(i)), "column {j}");
                (zeros, stored) = (zeros + later.len() - real.len(), stored + later.len());
                for entry in elimination.entries.column(j) {
                    let at = symbolic.in_front[entry] as usize;
                    assert_eq!(rows(s)[at], elimination.entries.rows[entry]);
                }
            }
            let share = zeros as f64 / stored as f64;
            assert!(
                zeros == 0 || relaxed.iter().any(|r| node.width() <= r.0 && share <= r.1),
                "{share} of supernode {s}"
            );
            for child in waiting.split_off(waiting.len() - node.children) {
                let below = symbolic.nodes[child].below();
                for (&row, &at) in symbolic.rows[below.clone()].iter().zip(&symbolic.in_parent[below]) {
                    assert_eq!(rows(s)[at as usize], row);
                }
            }
            waiting.push(s);
        }
        assert!(end == n && waiting.iter().all(|&s| symbolic.nodes[s].below().is_empty()), "roots are left");
    }

    #[test]
    fn patterns_are_those_of_elimination() {
        for (grid, chords, isolated) in [(1, 0, 0), (3, 0, 2), (9, 0, 1), (12, 30, 3)] {
            let matrix = matrix(grid, chords, isolated);
            let all = Elimination::minimum_degree(&matrix).expect("memory");
            let mut left_out = vec![false; matrix.n()];
            (0..matrix.n()).step_by(5).for_each(|row| left_out[row] = true);
            for elimination in [&all, &all.without(&matrix, &left_out)] {
                check(&matrix, elimination, &[]);
                check(&matrix, elimination, &[(4, 0.5), (16, 0.2), (usize::MAX, 0.05)]);
            }
        }
    }
}
