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
pub(crate) struct Symbolic {
    pub nodes: Vec<Supernode>,
    /// The rows below each supernode, ascending.
    pub rows: Vec<u32>,
    /// For each of these rows its place in the front of the parent: that of the supernode that has the first of them as a column.
    pub in_parent: Vec<u32>,
    /// For each entry of the matrix below the diagonal its place in the front of its column.
    pub in_front: Vec<u32>,
    /// Columns and rows of the largest front.
    pub largest: usize,
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
        let largest = nodes.iter().map(Supernode::height).max().unwrap_or(0);
        let rows = fill(&elimination.entries, &nodes, &node_of, &parents);
        let (in_parent, in_front) = (vec![0; rows.len()], vec![0; elimination.entries.rows.len()]);
        let mut symbolic = Self { nodes, rows, in_parent, in_front, largest };
        symbolic.place(&elimination.entries);
        symbolic
    }

    /// Finds the places in fronts.
    fn place(&mut self, entries: &Entries) {
        let mut place = vec![0u32; entries.diagonal.len()];
        let mut waiting: Vec<usize> = Vec::new();
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
            }
            waiting.push(s);
        }
    }
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
