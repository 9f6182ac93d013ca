//! Which parts of a factor can be worked on at once: subtrees of its elimination tree do not touch each other, only the top above them all.

use crate::multifrontal::Symbolic;
use std::ops::Range;

/// Most groups of subtrees, and the entries that make another one worth a thread: a solve takes two passes over them, and lends threads for each.
const GROUPS: usize = 4;
const GRAIN: usize = 1 << 17;

/// So many subtrees are cut at most. Measured on meshes of 1,000 to 170,000 vertices: 13 cuts leave a seventh of the entries to the top, or less.
const CUTS: usize = 64;

/// What a column costs besides its entries, in entries.
const COLUMN: usize = 20;

/// Not in the top.
const NONE: u32 = u32::MAX;

/// Supernodes one after the other, all of one group or of the top.
pub(super) struct Segment {
    pub nodes: Range<usize>,
    pub columns: Range<usize>,
    /// Where the first of its columns is: among the top's columns, or else among its own.
    pub place: usize,
    /// The group; the number of groups for the top.
    pub owner: usize,
}

/// Groups of subtrees that cost about the same, and the top.
pub(super) struct Tree {
    pub groups: usize,
    /// All supernodes, ascending.
    pub segments: Vec<Segment>,
    /// The rows below each supernode, ascending: first those within its segment, by their place there, then those of the top, by theirs.
    pub rows: Vec<u32>,
    /// How many of a supernode's rows are within its segment; nothing if all is top.
    inner: Vec<u32>,
}

impl Tree {
    /// The tree of a factor.
    pub fn new(symbolic: &Symbolic) -> Self {
        let (columns, row_starts) = starts(symbolic);
        let subtrees = Subtrees::new(&columns, &row_starts, &symbolic.rows);
        let groups = (subtrees.entries() / GRAIN).min(GROUPS);
        Self::in_groups(&columns, &row_starts, &symbolic.rows, &subtrees, groups)
    }

    fn in_groups(columns: &[u32], row_starts: &[usize], rows: &[u32], subtrees: &Subtrees, groups: usize) -> Self {
        let cut = Self::cut(columns, row_starts, rows, subtrees, groups);
        cut.unwrap_or_else(|| Self::whole(columns, rows.to_vec()))
    }

    /// The same with so many groups, however small.
    #[cfg(test)]
    pub fn with_groups(symbolic: &Symbolic, groups: usize) -> Self {
        let (columns, row_starts) = starts(symbolic);
        let subtrees = Subtrees::new(&columns, &row_starts, &symbolic.rows);
        Self::in_groups(&columns, &row_starts, &symbolic.rows, &subtrees, groups)
    }

    /// All is top.
    fn whole(columns: &[u32], rows: Vec<u32>) -> Self {
        let nodes = columns.len() - 1;
        let segment = Segment { nodes: 0..nodes, columns: 0..columns[nodes] as usize, place: 0, owner: 0 };
        Self { groups: 0, segments: vec![segment], rows, inner: Vec::new() }
    }

    /// So many groups; nothing if that does not pay, or subtrees are not contiguous.
    fn cut(columns: &[u32], row_starts: &[usize], rows: &[u32], subtrees: &Subtrees, groups: usize) -> Option<Self> {
        let mut segments = Vec::new();
        // In the top, columns follow each other.
        let (mut places, mut end) = (vec![NONE; columns[columns.len() - 1] as usize], 0);
        for (nodes, owner) in subtrees.dealt(groups)? {
            let columns = columns[nodes.start] as usize..columns[nodes.end] as usize;
            let place = if owner == groups { end } else { 0 };
            if owner == groups {
                places[columns.clone()].iter_mut().zip(end..).for_each(|(at, place)| *at = place as u32);
                end += columns.len();
            }
            segments.push(Segment { nodes, columns, place, owner });
        }
        let (mut placed, mut inner) = (Vec::with_capacity(rows.len()), Vec::with_capacity(columns.len()));
        for segment in &segments {
            for s in segment.nodes.clone() {
                let rows = &rows[row_starts[s]..row_starts[s + 1]];
                let own = if segment.owner == groups {
                    rows.len()
                } else {
                    rows.partition_point(|row| (*row as usize) < segment.columns.end)
                };
                inner.push(own as u32);
                let within = |row: &u32| {
                    if segment.owner == groups { places[*row as usize] } else { row - segment.columns.start as u32 }
                };
                placed.extend(rows[..own].iter().map(within));
                placed.extend(rows[own..].iter().map(|row| places[*row as usize]));
            }
        }
        (!placed.contains(&NONE)).then_some(Self { groups, segments, rows: placed, inner })
    }

    /// How many of a supernode's rows, of which there are so many, are within its segment.
    #[inline(always)]
    pub fn inner(&self, node: usize, rows: usize) -> usize {
        self.inner.get(node).map_or(rows, |inner| *inner as usize)
    }
}

/// The first column of each supernode, then n; and where the rows below each begin, and their end.
fn starts(symbolic: &Symbolic) -> (Vec<u32>, Vec<usize>) {
    let end = symbolic.nodes.last().map_or(0, |node| node.end);
    let columns = symbolic.nodes.iter().map(|node| node.begin).chain([end]).map(|column| column as u32);
    let row_starts = symbolic.nodes.iter().map(|node| node.below().start).chain([symbolic.rows.len()]);
    (columns.collect(), row_starts.collect())
}

/// Supernodes with their subtrees.
struct Subtrees {
    children: Vec<Vec<usize>>,
    roots: Vec<usize>,
    /// The first supernode of each subtree.
    first: Vec<usize>,
    own: Vec<usize>,
    /// What each subtree costs.
    cost: Vec<usize>,
    contiguous: bool,
}

impl Subtrees {
    fn new(columns: &[u32], row_starts: &[usize], rows: &[u32]) -> Self {
        let count = columns.len() - 1;
        let own = |s: usize| {
            let width = (columns[s + 1] - columns[s]) as usize;
            width * (width / 2 + row_starts[s + 1] - row_starts[s] + COLUMN)
        };
        let own: Vec<usize> = (0..count).map(own).collect();
        let (mut cost, mut first, mut sizes) = (own.clone(), (0..count).collect::<Vec<_>>(), vec![1; count]);
        let (mut children, mut roots) = (vec![Vec::new(); count], Vec::new());
        for s in 0..count {
            let Some(row) = rows[row_starts[s]..row_starts[s + 1]].first() else {
                roots.push(s);
                continue;
            };
            let parent = columns.partition_point(|column| column <= row) - 1;
            children[parent].push(s);
            cost[parent] += cost[s];
            sizes[parent] += sizes[s];
            first[parent] = first[parent].min(first[s]);
        }
        let contiguous = (0..count).all(|s| first[s] + sizes[s] == s + 1);
        Self { children, roots, first, own, cost, contiguous }
    }

    fn entries(&self) -> usize {
        self.own.iter().sum()
    }

    /// Runs of supernodes, ascending, and the group of each, or the number of groups for the top: so that the top and the largest group together cost
    /// least.
    fn dealt(&self, groups: usize) -> Option<Vec<(Range<usize>, usize)>> {
        if groups < 2 || !self.contiguous {
            return None;
        }
        let (mut subtrees, mut top) = (self.roots.clone(), 0);
        let (mut least, mut best) = (self.entries(), None);
        for _ in 0..CUTS {
            subtrees.sort_by_key(|&s| (usize::MAX - self.cost[s], s));
            let (owners, largest) = self.shared_out(&subtrees, groups);
            if top + largest < least {
                least = top + largest;
                best = Some(subtrees.iter().copied().zip(owners).collect::<Vec<_>>());
            }
            // The root of the largest one joins the top.
            let Some(root) = subtrees.first().copied() else { break };
            subtrees.swap_remove(0);
            subtrees.extend(&self.children[root]);
            top += self.own[root];
        }
        let mut runs = Vec::new();
        let mut end = 0;
        let mut best = best?;
        best.sort_unstable();
        for (root, owner) in best {
            runs.extend([(end..self.first[root], groups), (self.first[root]..root + 1, owner)]);
            end = root + 1;
        }
        runs.push((end..self.own.len(), groups));
        runs.retain(|(nodes, _)| !nodes.is_empty());
        Some(runs)
    }

    /// Each to the group that has least so far: the groups, and what the largest one costs.
    fn shared_out(&self, subtrees: &[usize], groups: usize) -> (Vec<usize>, usize) {
        let mut loads = vec![0; groups];
        let mut owners = Vec::with_capacity(subtrees.len());
        for &s in subtrees {
            let owner = (0..groups).min_by_key(|&group| loads[group]).unwrap_or(0);
            loads[owner] += self.cost[s];
            owners.push(owner);
        }
        (owners, loads.into_iter().max().unwrap_or(0))
    }
}
