//! Which parts of a factor can be worked on at once: subtrees of its elimination tree do not touch each other, only the top above them all.

use crate::multifrontal::{Supernode, Symbolic};
use std::ops::Range;

/// Groups of subtrees, from so many entries on: a solve takes two passes over them, and lends threads for each. Measured on two threads: three of like size take as
/// long as four, and four take longer than two up to 43,000 vertices, as more is in the top; at 100,000, what a group of four works on stays in the cache.
const GROUPS: [(usize, usize); 2] = [(4, 1 << 22), (2, 1 << 17)];

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
    /// The rows below each supernode, ascending: first those within its segment, by their place there, then those of the top, by theirs. Nothing, as in
    /// `inner`, if all is top.
    rows: Vec<u32>,
    /// How many of a supernode's rows are within its segment.
    inner: Vec<u32>,
}

impl Tree {
    /// The tree of a factor.
    pub fn new(symbolic: &Symbolic) -> Self {
        let entries: usize = symbolic.nodes.iter().map(cost).sum();
        Self::with_groups(symbolic, GROUPS.iter().find(|(_, from)| entries >= *from).map_or(0, |(groups, _)| *groups))
    }

    /// The same with so many groups, however small. All is top if that does not pay.
    pub fn with_groups(symbolic: &Symbolic, groups: usize) -> Self {
        let (nodes, columns) = (symbolic.nodes.len(), symbolic.nodes.last().map_or(0, |node| node.end));
        let whole = Segment { nodes: 0..nodes, columns: 0..columns, place: 0, owner: 0 };
        let cut = if groups < 2 { None } else { Self::cut(symbolic, groups) };
        cut.unwrap_or_else(|| Self { groups: 0, segments: vec![whole], rows: Vec::new(), inner: Vec::new() })
    }

    fn cut(symbolic: &Symbolic, groups: usize) -> Option<Self> {
        let nodes = &symbolic.nodes;
        let mut segments = Vec::new();
        // In the top, columns follow each other.
        let (mut places, mut end) = (vec![NONE; nodes.last()?.end], 0);
        for (range, owner) in Subtrees::new(symbolic).dealt(groups)? {
            let columns = nodes[range.start].begin..nodes[range.end - 1].end;
            let place = if owner == groups { end } else { 0 };
            if owner == groups {
                places[columns.clone()].iter_mut().zip(end..).for_each(|(at, place)| *at = place as u32);
                end += columns.len();
            }
            segments.push(Segment { nodes: range, columns, place, owner });
        }
        let (mut placed, mut inner) = (Vec::with_capacity(symbolic.rows.len()), Vec::with_capacity(nodes.len()));
        for segment in &segments {
            for node in &nodes[segment.nodes.clone()] {
                let rows = &symbolic.rows[node.below()];
                let end = if segment.owner == groups { 0 } else { segment.columns.end };
                let (within, above) = rows.split_at(rows.partition_point(|row| (*row as usize) < end));
                placed.extend(within.iter().map(|row| row - segment.columns.start as u32));
                placed.extend(above.iter().map(|row| places[*row as usize]));
                inner.push(if segment.owner == groups { rows.len() } else { within.len() } as u32);
            }
        }
        (!placed.contains(&NONE)).then_some(Self { groups, segments, rows: placed, inner })
    }

    /// The rows below a supernode: those within its segment, and those of the top.
    #[inline(always)]
    pub fn rows<'a>(&'a self, symbolic: &'a Symbolic, node: usize) -> (&'a [u32], &'a [u32]) {
        let below = symbolic.nodes[node].below();
        match self.inner.get(node) {
            Some(&inner) => self.rows[below].split_at(inner as usize),
            None => (&symbolic.rows[below], &[]),
        }
    }
}

/// What a supernode costs, in entries.
fn cost(node: &Supernode) -> usize {
    node.width() * (node.width() / 2 + node.below().len() + COLUMN)
}

/// Supernodes with their subtrees.
struct Subtrees {
    roots: Vec<usize>,
    /// The first supernode of each subtree, which ends with its root.
    first: Vec<usize>,
    own: Vec<usize>,
    /// What each subtree costs.
    cost: Vec<usize>,
}

impl Subtrees {
    fn new(symbolic: &Symbolic) -> Self {
        let own: Vec<usize> = symbolic.nodes.iter().map(cost).collect();
        let (mut roots, mut first, mut cost) = (Vec::<usize>::new(), Vec::<usize>::new(), own.clone());
        for (s, node) in symbolic.nodes.iter().enumerate() {
            let children = roots.len() - node.children..;
            first.push(roots[children.clone()].first().map_or(s, |&child| first[child]));
            for child in roots.drain(children) {
                cost[s] += cost[child];
            }
            roots.push(s);
        }
        Self { roots, first, own, cost }
    }

    /// The children of a supernode, from the last: each ends where the one after it begins.
    fn children(&self, s: usize) -> impl Iterator<Item = usize> + '_ {
        let before = move |end: usize| (end > self.first[s]).then(|| end - 1);
        std::iter::successors(before(s), move |&child| before(self.first[child]))
    }

    /// Runs of supernodes, ascending, and the group of each, or the number of groups for the top: so that the top and the largest group together cost
    /// least.
    fn dealt(&self, groups: usize) -> Option<Vec<(Range<usize>, usize)>> {
        let (mut subtrees, mut top) = (self.roots.clone(), 0);
        let (mut least, mut best) = (self.own.iter().sum(), None);
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
            subtrees.extend(self.children(root));
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

    /// The group of each, and what the largest one costs. Groups are cut from the subtrees in their order, so that all rows of a group are neighbours: passes over
    /// rows in parts then have about the same rows on a thread as solves have.
    fn shared_out(&self, subtrees: &[usize], groups: usize) -> (Vec<usize>, usize) {
        let mut order: Vec<usize> = (0..subtrees.len()).collect();
        order.sort_unstable_by_key(|&i| subtrees[i]);
        let all: usize = subtrees.iter().map(|&s| self.cost[s]).sum();
        let (mut owners, mut loads, mut before) = (vec![0; subtrees.len()], vec![0; groups], 0);
        for i in order {
            let cost = self.cost[subtrees[i]];
            owners[i] = ((before + cost / 2) * groups / all.max(1)).min(groups - 1);
            loads[owners[i]] += cost;
            before += cost;
        }
        (owners, loads.into_iter().max().unwrap_or(0))
    }
}
