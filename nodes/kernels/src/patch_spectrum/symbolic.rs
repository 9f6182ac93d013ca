//! Supernodes: runs of columns of the factor with the same pattern, or nearly so, and how their fronts fit into each other.

use super::factor::TOGETHER;
use super::order::NONE;
use super::problem::Problem;

/// Runs of columns are merged with the one after them as long as at most this share of the merged one is zero, by the number of columns: zeros
/// cost arithmetic, small supernodes cost everything else.
const RELAXED: [(usize, f64); 3] = [(4, 0.5), (16, 0.2), (48, 0.05)];

/// A supernode: columns `begin..end` of the factor, and its rows below them.
#[derive(Clone, Copy)]
pub(super) struct Supernode {
    pub begin: usize,
    pub end: usize,
    /// Where its rows begin in [`Symbolic::rows`].
    pub rows: usize,
    /// How many supernodes just finished are its children.
    pub children: usize,
}

impl Supernode {
    pub fn width(&self) -> usize {
        self.end - self.begin
    }
}

/// The pattern of a problem's factor.
pub(super) struct Symbolic {
    pub nodes: Vec<Supernode>,
    /// The rows below each supernode, ascending.
    pub rows: Vec<u32>,
    /// For each of these rows its place in the front of the parent: that of the supernode that has the first of them as a column.
    pub in_parent: Vec<u32>,
    /// For each entry of the matrix below the diagonal its place in the front of its column.
    pub in_front: Vec<u32>,
    /// Entries of the largest front: columns and rows below, padded as [`padded`] says.
    pub largest: usize,
    /// The factor keeps at most so many numbers.
    pub values: usize,
}

/// Columns of fronts begin at multiples of this many entries.
pub(super) const CHUNK: usize = 8;

/// Entries from one column of a front of this height to the next.
pub(super) fn padded(height: usize) -> usize {
    height.next_multiple_of(CHUNK)
}

impl Symbolic {
    pub fn new(problem: &Problem) -> Self {
        let runs = merged(problem);
        let n = problem.n();
        let mut symbolic = Self {
            nodes: Vec::with_capacity(runs.len()),
            rows: Vec::with_capacity(4 * n),
            in_parent: Vec::with_capacity(4 * n),
            in_front: vec![0; problem.rows.len()],
            largest: 0,
            values: 0,
        };
        // Places in the present front, and the last supernode that met a row.
        let (mut place, mut met) = (vec![0u32; n], vec![NONE; n]);
        let mut waiting: Vec<usize> = Vec::new();
        for (s, &(begin, end)) in runs.iter().enumerate() {
            let children = symbolic.add(problem, begin, end, &waiting, &mut met, s as u32);
            symbolic.place(problem, s, &mut place);
            for child in waiting.split_off(waiting.len() - children) {
                for at in symbolic.range(child) {
                    symbolic.in_parent[at] = place[symbolic.rows[at] as usize];
                }
            }
            waiting.push(s);
        }
        symbolic
    }

    /// The places of a supernode's rows.
    pub fn range(&self, s: usize) -> std::ops::Range<usize> {
        self.nodes[s].rows..self.nodes.get(s + 1).map_or(self.rows.len(), |next| next.rows)
    }

    /// Columns and rows below.
    pub fn height(&self, s: usize) -> usize {
        self.nodes[s].width() + self.range(s).len()
    }

    /// Adds a supernode with the rows of its columns and those of its children, the last of those waiting: how many these are.
    fn add(
        &mut self,
        problem: &Problem,
        begin: usize,
        end: usize,
        waiting: &[usize],
        met: &mut [u32],
        s: u32,
    ) -> usize {
        let from = self.rows.len();
        let is_child = |child: &&usize| self.range(**child).next().is_some_and(|at| (self.rows[at] as usize) < end);
        let children = waiting.iter().rev().take_while(is_child).count();
        let entries = problem.starts[begin] as usize..problem.starts[end] as usize;
        let below = |row: &u32| *row as usize >= end;
        for &row in problem.rows[entries].iter().filter(|r| below(r)) {
            if std::mem::replace(&mut met[row as usize], s) != s {
                self.rows.push(row);
            }
        }
        for &child in &waiting[waiting.len() - children..] {
            let after = self.nodes.get(child + 1).map_or(from, |next| next.rows);
            for at in self.nodes[child].rows..after {
                let row = self.rows[at];
                if below(&row) && std::mem::replace(&mut met[row as usize], s) != s {
                    self.rows.push(row);
                }
            }
        }
        self.rows[from..].sort_unstable();
        self.nodes.push(Supernode { begin, end, rows: from, children });
        self.in_parent.resize(self.rows.len(), 0);
        children
    }

    /// Notes the places of a supernode's rows in its front, and where the entries of its columns go.
    fn place(&mut self, problem: &Problem, s: usize, place: &mut [u32]) {
        let Supernode { begin, end, .. } = self.nodes[s];
        let rows = (begin as u32..end as u32).chain(self.rows[self.range(s)].iter().copied());
        for (row, at) in rows.zip(0..) {
            place[row as usize] = at;
        }
        for entry in problem.starts[begin] as usize..problem.starts[end] as usize {
            self.in_front[entry] = place[problem.rows[entry] as usize];
        }
        let height = self.height(s);
        let groups = (0..end - begin).step_by(TOGETHER);
        self.values += groups.map(|c| TOGETHER.min(end - begin - c) * (height - c)).sum::<usize>();
        self.largest = self.largest.max(height * padded(height));
    }
}

/// A run with the height of its first column and the zeros stored in it.
struct Run {
    begin: usize,
    end: usize,
    height: usize,
    zeros: usize,
}

/// Runs of columns, merged.
fn merged(problem: &Problem) -> Vec<(usize, usize)> {
    let (n, parents, counts) = (problem.n(), &problem.parents, &problem.counts);
    let stored = |width: usize, height: usize| width * height - width * (width - 1) / 2;
    // From the last: a run can take in the one before it if that one's parent is in it.
    let mut runs: Vec<Run> = Vec::new();
    let mut end = n;
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
            if RELAXED.iter().any(|&(columns, most)| width <= columns && share <= most) {
                *next = Run { begin: run.begin, end: next.end, height, zeros };
                continue;
            }
        }
        runs.push(run);
    }
    runs.iter().rev().map(|run| (run.begin, run.end)).collect()
}
