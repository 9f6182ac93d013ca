//! Which targets each query was compared with, where not all were. Not a node: part of what `shortlist` and all that follows it make.

use std::ops::Range;

use salient_sdk::{Decoder, Encoder, FormatError};

/// Of each query the targets on its list, as the rows of a sparse matrix: memory grows with what is on the lists, not with all pairs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lists {
    /// Where each query's list begins, and the last one ends.
    starts: Vec<usize>,
    /// Indices of targets, ascending in each list.
    targets: Vec<u32>,
}

impl Lists {
    /// Of the targets of each query, in any order.
    #[must_use]
    pub fn new(lists: impl IntoIterator<Item = Vec<u32>>) -> Self {
        let mut all = Self { starts: vec![0], targets: Vec::new() };
        for mut list in lists {
            list.sort_unstable();
            list.dedup();
            all.targets.extend(list);
            all.starts.push(all.targets.len());
        }
        all
    }

    /// Number of queries.
    #[must_use]
    pub fn queries(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of pairs on all lists.
    #[must_use]
    pub fn pairs(&self) -> usize {
        self.targets.len()
    }

    /// The targets of a query, ascending.
    #[must_use]
    pub fn of(&self, query: usize) -> &[u32] {
        &self.targets[self.span(query)]
    }

    /// Where the pairs of a query are among all.
    #[must_use]
    pub fn span(&self, query: usize) -> Range<usize> {
        self.starts[query]..self.starts[query + 1]
    }
}

/// The order in which the values of pairs are kept: all pairs row by row, or those on lists.
#[derive(Clone, Copy)]
pub struct Order<'a> {
    /// Number of targets.
    pub targets: usize,
    /// The lists, if not all pairs were compared.
    pub lists: Option<&'a Lists>,
}

impl<'a> Order<'a> {
    /// Where the values of a query are.
    #[must_use]
    pub fn span(&self, query: usize) -> Range<usize> {
        self.lists.map_or(query * self.targets..(query + 1) * self.targets, |lists| lists.span(query))
    }

    /// The target of the `i`-th value of a query.
    #[must_use]
    pub fn target(&self, query: usize, i: usize) -> usize {
        self.lists.map_or(i, |lists| lists.of(query)[i] as usize)
    }

    /// The targets of a query's values, ascending.
    pub fn row(&self, query: usize) -> impl Iterator<Item = usize> + use<'a> {
        let order = *self;
        (0..self.span(query).len()).map(move |i| order.target(query, i))
    }

    /// Where the value of a pair is, if it was compared.
    #[must_use]
    pub fn find(&self, query: usize, target: usize) -> Option<usize> {
        let Some(lists) = self.lists else { return Some(query * self.targets + target) };
        let at = lists.of(query).binary_search(&(target as u32)).ok()?;
        Some(lists.span(query).start + at)
    }

    /// How many values there are for so many queries.
    #[must_use]
    pub fn pairs(&self, queries: usize) -> usize {
        self.lists.map_or(queries * self.targets, Lists::pairs)
    }

    /// The shape of the arrays of values.
    #[must_use]
    pub fn shape(&self, queries: usize) -> Vec<usize> {
        self.lists.map_or_else(|| vec![queries, self.targets], |lists| vec![lists.pairs()])
    }

    /// A line of a summary: how many pairs were compared.
    #[must_use]
    pub fn line(&self, queries: usize) -> (&'static str, String) {
        ("compared", format!("{} of {} pairs", self.pairs(queries), queries * self.targets))
    }
}

/// Writes lists as `lengths` \[queries\] and `listed`, one list after the other.
pub fn encode(lists: Option<&Lists>, out: &mut Encoder) {
    if let Some(lists) = lists {
        let lengths: Vec<u32> = (0..lists.queries()).map(|q| lists.of(q).len() as u32).collect();
        out.u32("lengths", &lengths, &[lengths.len()]);
        out.u32("listed", &lists.targets, &[lists.pairs()]);
    }
}

/// Reads what [`encode`] wrote; refuses lists that are not of so many queries and targets.
pub fn decode(from: &Decoder, queries: usize, targets: usize) -> Result<Option<Lists>, FormatError> {
    if !from.has("lengths") {
        return Ok(None);
    }
    let (lengths, _) = from.u32("lengths")?;
    let (listed, _) = from.u32("listed")?;
    let mut starts = vec![0];
    for length in &lengths {
        starts.push(starts[starts.len() - 1] + *length as usize);
    }
    let fits = lengths.len() == queries && starts.last() == Some(&listed.len());
    let lists = Lists { starts, targets: listed };
    let sorted = |q: usize| {
        let list = lists.of(q);
        list.is_sorted_by(|a, b| a < b) && list.last().is_none_or(|t| (*t as usize) < targets)
    };
    if fits && (0..queries).all(sorted) {
        Ok(Some(lists))
    } else {
        Err(FormatError(format!("the lists are not of {queries} queries and {targets} targets")))
    }
}
