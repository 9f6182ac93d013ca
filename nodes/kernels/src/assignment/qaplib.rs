//! The text format of QAPLIB (Burkard, Karisch & Rendl 1997): `n`, then two `n` x `n` matrices, blanks and line breaks alike.

use std::fmt::Write as _;

use super::problem::{Problem, ProblemError};
use super::text::ReadError;

/// A quadratic assignment problem: minimise `sum_ij A[i][j] B[p(i)][p(j)]` over permutations `p`.
#[derive(Clone, Debug, PartialEq)]
pub struct Qap {
    /// Size.
    pub n: usize,
    /// First matrix, in row order.
    pub a: Vec<f64>,
    /// Second matrix, in row order.
    pub b: Vec<f64>,
}

/// A permutation with its cost, from a `.sln` file: `n`, the cost, then `n` values counted from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct QapSolution {
    /// Its cost.
    pub cost: f64,
    /// `p(i)`, counted from 0.
    pub permutation: Vec<usize>,
}

/// Larger instances are refused before memory is asked for: the problem has `n^4 / 2` terms.
const LARGEST: usize = 10_000;

impl Qap {
    /// Reads an instance.
    pub fn read(text: &str) -> Result<Self, ReadError> {
        let mut words = Words::new(text);
        let n = words.size()?;
        let mut matrix = |name: &str| -> Result<Vec<f64>, ReadError> {
            let mut values = Vec::new();
            for e in 0..n * n {
                let what = || format!("entry ({}, {}) of the {name} matrix", e / n + 1, e % n + 1);
                values.push(words.number(&what)?);
            }
            Ok(values)
        };
        let (a, b) = (matrix("first")?, matrix("second")?);
        words.end()?;
        Ok(Self { n, a, b })
    }

    /// The instance as text.
    #[must_use]
    pub fn write(&self) -> String {
        let mut text = format!("{}\n", self.n);
        for matrix in [&self.a, &self.b] {
            for row in matrix.chunks(self.n.max(1)) {
                text.push('\n');
                for (k, value) in row.iter().enumerate() {
                    let _ = write!(text, "{}{value}", if k == 0 { "" } else { " " });
                }
            }
            text.push('\n');
        }
        text
    }

    /// The problem; its objective is minus the cost.
    pub fn problem(&self) -> Result<Problem, ProblemError> {
        Problem::from_qaplib(self.n, &self.a, &self.b)
    }

    /// The cost of a permutation; `None` if it is none of `n`.
    #[must_use]
    pub fn cost(&self, permutation: &[usize]) -> Option<f64> {
        let mut sorted = permutation.to_vec();
        sorted.sort_unstable();
        if !sorted.into_iter().eq(0..self.n) {
            return None;
        }
        let of = |i: usize, j: usize| self.a[i * self.n + j] * self.b[permutation[i] * self.n + permutation[j]];
        Some((0..self.n).flat_map(|i| (0..self.n).map(move |j| (i, j))).map(|(i, j)| of(i, j)).sum())
    }
}

impl QapSolution {
    /// Reads a solution. Commas between the values, which some files have, are blanks.
    pub fn read(text: &str) -> Result<Self, ReadError> {
        let text = text.replace(',', " ");
        let mut words = Words::new(&text);
        let n = words.size()?;
        let cost = words.number(&|| "the cost".into())?;
        let mut permutation = Vec::new();
        for i in 0..n {
            let (line, word) = words.next(&|| format!("value {} of the permutation", i + 1))?;
            let value = ReadError::integer(line, word)?;
            if value == 0 || value > n || permutation.contains(&(value - 1)) {
                return Err(ReadError::new(line, format!("`{word}` makes this no permutation of 1 to {n}")));
            }
            permutation.push(value - 1);
        }
        words.end()?;
        Ok(Self { cost, permutation })
    }

    /// The solution as text.
    #[must_use]
    pub fn write(&self) -> String {
        let values: Vec<String> = self.permutation.iter().map(|p| (p + 1).to_string()).collect();
        format!("{} {}\n{}\n", self.permutation.len(), self.cost, values.join(" "))
    }
}

/// The words of a text with their lines.
struct Words<'a> {
    rest: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    last: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        let words = text.lines().enumerate().flat_map(|(k, line)| line.split_whitespace().map(move |w| (k + 1, w)));
        Self { rest: Box::new(words), last: text.lines().count() }
    }

    fn next(&mut self, what: &dyn Fn() -> String) -> Result<(usize, &'a str), ReadError> {
        self.rest.next().ok_or_else(|| ReadError::new(self.last, format!("the file ends before {}", what())))
    }

    fn number(&mut self, what: &dyn Fn() -> String) -> Result<f64, ReadError> {
        let (line, word) = self.next(what)?;
        ReadError::finite(line, word)
    }

    fn size(&mut self) -> Result<usize, ReadError> {
        let (line, word) = self.next(&|| "the size".into())?;
        let n = ReadError::integer(line, word)?;
        if n > LARGEST {
            return Err(ReadError::new(line, format!("size {n} is above {LARGEST}")));
        }
        Ok(n)
    }

    fn end(&mut self) -> Result<(), ReadError> {
        match self.rest.next() {
            None => Ok(()),
            Some((line, word)) => Err(ReadError::new(line, format!("`{word}` follows the last value"))),
        }
    }
}
