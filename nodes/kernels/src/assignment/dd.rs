//! The `.dd` text format of graph matching problems (Torresani, Kolmogorov & Rother 2008; used by most public instances).
//!
//! ```text
//! c comment
//! p 2 3 4 1        left features, right features, assignments (candidates), edges (pair terms)
//! a 0 0 2 -1.5     index, left, right, cost
//! e 0 3 -0.25      two assignments, cost of choosing both
//! ```
//!
//! The format minimises cost; features may stay unmatched, at no cost. A [`Problem`] maximises, so that its objective is **minus**
//! the cost. Lines `i0`, `i1` (positions) and `n0`, `n1` (neighbours), which some files have, do not enter the cost and are skipped.

use std::fmt::Write as _;

use super::problem::{Problem, ProblemBuilder};
use super::text::ReadError;

/// A problem as `.dd` text; see [`write()`].
#[derive(Clone, Debug, PartialEq)]
pub struct DdText {
    /// The file.
    pub text: String,
    /// The objective of an assignment is this minus its cost in the file.
    pub offset: f64,
}

/// Reads a problem. An edge between assignments that share a feature can never count and is left out, since public files have such.
pub fn read(text: &str) -> Result<Problem, ReadError> {
    let mut state: Option<Reader> = None;
    for (at, line) in text.lines().enumerate() {
        let line_number = at + 1;
        let mut words = line.split_whitespace();
        let Some(kind) = words.next() else { continue };
        let fields: Vec<&str> = words.collect();
        match (kind, &mut state) {
            ("c" | "i0" | "i1" | "n0" | "n1", _) => {}
            ("p", None) => state = Some(Reader::new(line_number, &fields)?),
            ("p", Some(_)) => return Err(ReadError::new(line_number, "a second `p` line")),
            (_, None) => {
                return Err(ReadError::new(line_number, "the `p` line must come before all others but comments"));
            }
            ("a", Some(reader)) => reader.assignment(line_number, &fields)?,
            ("e", Some(reader)) => reader.edge(line_number, &fields)?,
            (other, _) => {
                return Err(ReadError::new(line_number, format!("`{other}` is none of c, p, a, e, i0, i1, n0, n1")));
            }
        }
    }
    let last = text.lines().count();
    state.ok_or_else(|| ReadError::new(last, "there is no `p` line"))?.finish(last)
}

struct Reader {
    n: [usize; 2],
    /// Line, left, right and cost of each assignment, by its index.
    assignments: Vec<Option<(usize, usize, usize, f64)>>,
    n_assignments: usize,
    seen: usize,
    n_edges: usize,
    /// Line and the rest; assignments may follow.
    edges: Vec<(usize, usize, usize, f64)>,
}

/// More than this many assignments or edges are refused before memory is asked for.
const LARGEST: usize = 1 << 30;

impl Reader {
    fn new(line: usize, fields: &[&str]) -> Result<Self, ReadError> {
        let [left, right, assignments, edges] = *fields else {
            return Err(ReadError::new(line, format!("`p` needs 4 numbers, found {}", fields.len())));
        };
        let number = |word| ReadError::integer(line, word);
        let (n, n_assignments, n_edges) = ([number(left)?, number(right)?], number(assignments)?, number(edges)?);
        if n.into_iter().chain([n_assignments, n_edges]).any(|v| v > LARGEST) {
            return Err(ReadError::new(line, format!("sizes above {LARGEST} are not supported")));
        }
        Ok(Self { n, assignments: Vec::new(), n_assignments, seen: 0, n_edges, edges: Vec::new() })
    }

    fn assignment(&mut self, line: usize, fields: &[&str]) -> Result<(), ReadError> {
        let [index, left, right, cost] = *fields else {
            return Err(ReadError::new(line, format!("`a` needs 4 numbers, found {}", fields.len())));
        };
        let (index, left) = (ReadError::integer(line, index)?, ReadError::integer(line, left)?);
        let (right, cost) = (ReadError::integer(line, right)?, ReadError::finite(line, cost)?);
        if index >= self.n_assignments {
            let of = self.n_assignments;
            return Err(ReadError::new(line, format!("assignment {index}, but the `p` line promises {of}")));
        }
        for (side, value, n) in [("left", left, self.n[0]), ("right", right, self.n[1])] {
            if value >= n {
                return Err(ReadError::new(line, format!("{side} feature {value}, but the `p` line promises {n}")));
            }
        }
        if self.assignments.len() <= index {
            self.assignments.resize(index + 1, None);
        }
        if let Some(before) = self.assignments[index].replace((line, left, right, cost)) {
            return Err(ReadError::new(line, format!("assignment {index} was given in line {}", before.0)));
        }
        self.seen += 1;
        Ok(())
    }

    fn edge(&mut self, line: usize, fields: &[&str]) -> Result<(), ReadError> {
        let [a, b, cost] = *fields else {
            return Err(ReadError::new(line, format!("`e` needs 3 numbers, found {}", fields.len())));
        };
        let (a, b) = (ReadError::integer(line, a)?, ReadError::integer(line, b)?);
        for index in [a, b] {
            if index >= self.n_assignments {
                let of = self.n_assignments;
                return Err(ReadError::new(line, format!("assignment {index}, but the `p` line promises {of}")));
            }
        }
        self.edges.push((line, a, b, ReadError::finite(line, cost)?));
        Ok(())
    }

    fn finish(self, last: usize) -> Result<Problem, ReadError> {
        for (what, found, promised) in
            [("assignments", self.seen, self.n_assignments), ("edges", self.edges.len(), self.n_edges)]
        {
            if found != promised {
                return Err(ReadError::new(last, format!("{found} {what}, but the `p` line promises {promised}")));
            }
        }
        let mut builder = ProblemBuilder::new(self.n[0], self.n[1]);
        let mut places = std::collections::BTreeMap::new();
        let assignments: Vec<_> = self.assignments.into_iter().flatten().collect();
        for &(line, left, right, cost) in &assignments {
            if let Some(before) = places.insert((left, right), line) {
                return Err(ReadError::new(line, format!("the same features were assigned in line {before}")));
            }
            builder.candidate(left, right, -cost).map_err(|e| ReadError::new(line, e.to_string()))?;
        }
        let mut pairs = std::collections::BTreeMap::new();
        for &(line, a, b, cost) in &self.edges {
            if let Some(before) = pairs.insert((a.min(b), a.max(b)), line) {
                return Err(ReadError::new(line, format!("edge {a} {b} was given in line {before}")));
            }
            let shares = assignments[a].1 == assignments[b].1 || assignments[a].2 == assignments[b].2;
            if a == b || !shares {
                builder.pair(a, b, -cost).map_err(|e| ReadError::new(line, e.to_string()))?;
            }
        }
        builder.build().map_err(|e| ReadError::new(last, e.to_string()))
    }
}

/// Writes a problem, candidates in their own order. Unmatched costs become part of the candidates' costs and of the offset (rounded once);
/// `None` if the problem demands that all be matched, which the format cannot say.
#[must_use]
pub fn write(problem: &Problem) -> Option<DdText> {
    if problem.must_match_all {
        return None;
    }
    let p = problem;
    let mut text = format!("p {} {} {} {}\n", p.n_left, p.n_right, p.candidates.len(), p.val.len() / 2);
    for (a, &(i, j)) in p.candidates.iter().enumerate() {
        let cost = 0.0 - (p.linear[a] + p.left_cost[i] + p.right_cost[j]);
        let _ = writeln!(text, "a {a} {i} {j} {cost}");
    }
    for a in 0..p.candidates.len() {
        for e in p.row[a]..p.row[a + 1] {
            if p.col[e] as usize > a {
                let _ = writeln!(text, "e {a} {} {}", p.col[e], -p.val[e]);
            }
        }
    }
    Some(DdText { text, offset: 0.0 - p.left_cost.iter().chain(&p.right_cost).sum::<f64>() })
}
