//! LDL' factorisations laid out for solves with small panels.

use super::problem::Problem;
use crate::multifrontal::{Eliminated, Fronts, Keep, Supernode};

/// Rows of a factor that go through a solve together.
pub(super) const TOGETHER: usize = 4;

/// L and D^-1, laid out for solves.
#[derive(Default)]
pub(super) struct Factor {
    /// Per supernode and group of up to [`TOGETHER`] columns: the rows from the group's first column on, as many entries to a row as the
    /// group has columns. In the rows of the columns themselves only what is below the diagonal counts.
    pub values: Vec<f64>,
    pub inverse_pivots: Vec<f64>,
}

impl Factor {
    /// Numbers that it has memory for.
    pub fn capacity(&self) -> usize {
        self.values.capacity() + self.inverse_pivots.capacity()
    }

    /// Factors A - shift I; the number of eigenvalues below the shift, or `None` if it breaks down.
    pub fn compute(&mut self, problem: &Problem, shift: f64, fronts: &mut Fronts) -> Option<usize> {
        self.values.clear();
        self.values.reserve(problem.symbolic.nodes.iter().map(kept).sum());
        let below = fronts.factor(&problem.shifted(shift), &mut Groups(&mut self.values))?;
        self.inverse_pivots.clear();
        self.inverse_pivots.extend(fronts.pivots.iter().map(|p| 1.0 / p));
        Some(below)
    }
}

/// How many numbers are kept of a supernode.
fn kept(node: &Supernode) -> usize {
    let (width, height) = (node.width(), node.height());
    // Groups of two and one are the last.
    let rest = [(width % TOGETHER) / 2 * 2, width % 2];
    let last = rest[0] * (height - width + rest[0] + rest[1]) + rest[1] * (height - width + 1);
    (0..width / TOGETHER).map(|group| TOGETHER * (height - group * TOGETHER)).sum::<usize>() + last
}

/// Appends columns in the order of solves.
struct Groups<'a>(&'a mut Vec<f64>);

impl Keep for Groups<'_> {
    #[inline(always)]
    fn keep(&mut self, front: &Eliminated<'_>) {
        let (width, height, pitch) = (front.node.width(), front.node.height(), front.pitch);
        let mut c = 0;
        while c < width {
            let columns = &front.columns[c * pitch + c..];
            c += match width - c {
                TOGETHER.. => interleave::<TOGETHER>(columns, pitch, height - c, self.0),
                2.. => interleave::<2>(columns, pitch, height - c, self.0),
                _ => interleave::<1>(columns, pitch, height - c, self.0),
            };
        }
    }
}

/// Appends C columns of this height row by row; C.
#[inline(always)]
fn interleave<const C: usize>(columns: &[f64], pitch: usize, height: usize, values: &mut Vec<f64>) -> usize {
    let from = values.len();
    values.resize(from + C * height, 0.0);
    let columns: [&[f64]; C] = std::array::from_fn(|i| &columns[i * pitch..][..height]);
    for (r, row) in values[from..].as_chunks_mut::<C>().0.iter_mut().enumerate() {
        for i in 0..C {
            row[i] = columns[i][r];
        }
    }
    C
}
