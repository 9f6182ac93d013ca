//! Products of panels in explicit SIMD instructions: loops over arrays of arrays are not turned into the widest ones. Every entry is
//! summed in the same order whatever the width of a register.

use super::panel::{Block, Row, WIDTH, ZERO};
use super::pool::{Panel, RUN};
use super::rows::{TILE, add_products, next, subtract_from_tile};
use crate::simd::prefetch;
use faer::{ColRef, MatRef};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;
use std::slice::from_ref;

/// Panels whose runs stay in the second-level cache while all others go by.
const GROUP: usize = 8;

/// Registers in a row of a panel.
#[inline(always)]
pub(super) fn parts<S: Simd>() -> usize {
    WIDTH / S::F64_LANES
}

/// The registers of rows, row by row.
#[inline(always)]
pub(super) fn registers<S: Simd>(rows: &[Row]) -> &[S::f64s] {
    S::as_simd_f64s(rows.as_flattened()).0
}

#[inline(always)]
pub(super) fn registers_mut<S: Simd>(rows: &mut [Row]) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(rows.as_flattened_mut()).0
}

/// The lower triangle of a symmetric matrix of blocks, row by row.
#[derive(Clone)]
pub(super) struct Triangle(Vec<Block>);

impl Triangle {
    pub fn zeros(panels: usize) -> Self {
        Self(vec![ZERO; panels * (panels + 1) / 2])
    }

    /// The entries of a row by column, up to the diagonal; both count vectors.
    pub fn row(&self, i: usize) -> impl Fn(usize) -> f64 {
        let row = i / WIDTH;
        let blocks = &self.0[row * (row + 1) / 2..][..=row];
        move |j| blocks[j / WIDTH][i % WIDTH][j % WIDTH]
    }

    pub fn add(&mut self, other: &Self) {
        for (x, y) in self.0.as_flattened_mut().as_flattened_mut().iter_mut().zip(other.0.as_flattened().as_flattened())
        {
            *x += y;
        }
    }

    /// Adds Y' Y over some runs.
    pub fn add_gram(&mut self, panels: &[&Panel], runs: Range<usize>) {
        Arch::new().dispatch(Gram { panels, runs, sums: &mut self.0 });
    }
}

struct Gram<'a> {
    panels: &'a [&'a Panel],
    runs: Range<usize>,
    sums: &'a mut [Block],
}

impl WithSimd for Gram<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let count = self.panels.len();
        for run in self.runs {
            for group in (0..count).step_by(GROUP) {
                for row in group..count {
                    let columns = group..(row + 1).min(group + GROUP);
                    let begin = row * (row + 1) / 2;
                    let sums = &mut self.sums[begin + columns.start..begin + columns.end];
                    let x = &self.panels[row][run];
                    // What comes next, mostly.
                    let mut ahead = next(self.panels, row, run);
                    let (pairs, single) = sums.as_chunks_mut::<2>();
                    for ([g, h], column) in pairs.iter_mut().zip(columns.clone().step_by(2)) {
                        let y = [&self.panels[column][run], &self.panels[column + 1][run]];
                        add_products(simd, x, y, [g, h], ahead.take());
                    }
                    for sum in single {
                        add_products(simd, x, [&self.panels[columns.end - 1][run]], [sum], ahead.take());
                    }
                }
            }
        }
    }
}

/// In every run, in the order given: panel `to` -= panel `from` times the block for each (to, from, block), or panel `to` is multiplied by one minus the block if
/// both are the same.
pub(super) fn subtract_products(panels: &mut [&mut Panel], steps: &[(usize, usize, Block)]) {
    let runs = panels.first().map_or(0, |panel| panel.len());
    Arch::new().dispatch(Subtraction { panels, steps, runs });
}

struct Subtraction<'a, 'b> {
    panels: &'a mut [&'b mut Panel],
    steps: &'a [(usize, usize, Block)],
    runs: usize,
}

impl WithSimd for Subtraction<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for run in 0..self.runs {
            for (s, (to, from, block)) in self.steps.iter().enumerate() {
                let (next, next_run) = self.steps.get(s + 1).map_or((&self.steps[0], run + 1), |next| (next, run));
                for tile in 0..RUN / TILE {
                    for panel in [next.0, next.1].into_iter().filter(|panel| panel != to) {
                        let rows = self.panels[panel].get(next_run).map(|rows| &rows.as_chunks::<TILE>().0[tile]);
                        rows.into_iter().flatten().for_each(prefetch);
                    }
                    // Read before it is written: both may be the same.
                    let x = self.panels[*from][run].as_chunks().0[tile];
                    subtract_from_tile(simd, [&mut self.panels[*to][run].as_chunks_mut().0[tile]], &x, [block]);
                }
            }
        }
    }
}

/// Panels of columns of the factor that are multiplied at once: with the rows of a tile as many products as registers hold, and few loads for each.
const SLAB: usize = 3;

/// Rows of all panels that stay in the second-level cache while the factor goes by.
const PIECE: usize = 32;

/// Aligned to cache lines: rows that lie across two are slow to load.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Aligned<T>(T);

/// Puts V c in place of the first panels of V.
pub(super) fn replace_by_product(panels: &mut [&mut Panel], c: &Combination) {
    Arch::new().dispatch(Replacement { panels, slabs: &c.0 });
}

/// A matrix with eight rows for each panel that it multiplies, and panels of columns, which are together with those that end where they do: zeros
/// at the end are left out.
pub(super) struct Combination(Vec<Slab>);

/// Up to three panels of columns.
struct Slab {
    columns: Vec<usize>,
    /// Row by row, eight for each panel that is multiplied.
    rows: Vec<Aligned<Row>>,
}

impl Slab {
    /// Panels that are multiplied.
    fn depth(&self) -> usize {
        self.rows.len() / (WIDTH * self.columns.len())
    }
}

impl Combination {
    pub fn new(c: MatRef<'_, f64>) -> Self {
        let filled = |column: ColRef<'_, f64>| (0..c.nrows()).rev().find(|&i| column[i] != 0.0).map_or(0, |i| i + 1);
        let depth = |p: usize| c.subcols(p * WIDTH, WIDTH).col_iter().map(filled).max().unwrap_or(0).div_ceil(WIDTH);
        let mut panels: Vec<_> = (0..c.ncols() / WIDTH).map(|p| (depth(p), p)).collect();
        panels.sort_unstable();
        let (mut slabs, mut rest) = (Vec::new(), &panels[..]);
        while let Some(&(depth, _)) = rest.last() {
            // Two and two rather than three and one.
            let width = if rest.len() == SLAB + 1 { 2 } else { SLAB.min(rest.len()) };
            let (others, slab) = rest.split_at(rest.len() - width);
            let mut rows = vec![Aligned([0.0; WIDTH]); depth * WIDTH * width];
            for (i, (_, p)) in slab.iter().enumerate() {
                for (q, column) in c.subcols(p * WIDTH, WIDTH).col_iter().enumerate() {
                    let rows = rows.iter_mut().skip(i).step_by(width);
                    rows.zip(column.iter()).for_each(|(row, x)| row.0[q] = *x);
                }
            }
            slabs.push(Slab { columns: slab.iter().map(|panel| panel.1).collect(), rows });
            rest = others;
        }
        Self(slabs)
    }
}

struct Replacement<'a, 'b> {
    panels: &'a mut [&'b mut Panel],
    slabs: &'a [Slab],
}

impl WithSimd for Replacement<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (count, length) = (self.panels.len(), self.panels.first().map_or(0, |panel| panel.len() * RUN));
        let mut rows = vec![Aligned([[0.0; WIDTH]; TILE]); count * PIECE / TILE];
        let steps = self.slabs.iter().map(Slab::depth).sum::<usize>() * (PIECE / TILE);
        let share = (count * PIECE).div_ceil(steps.max(1));
        for begin in (0..length).step_by(PIECE) {
            for (p, panel) in self.panels.iter().enumerate() {
                for (g, tile) in panel.as_flattened()[begin..begin + PIECE].as_chunks().0.iter().enumerate() {
                    rows[g * count + p].0 = *tile;
                }
            }
            let mut ahead = Ahead { begin: begin + PIECE, row: 0, share };
            for slab in self.slabs {
                for (at, x) in (begin..).step_by(TILE).zip(rows.chunks_exact(count)) {
                    match slab.columns.len() {
                        3 => multiply::<S, 3>(simd, x, slab, self.panels, at, ahead),
                        2 => multiply::<S, 2>(simd, x, slab, self.panels, at, ahead),
                        _ => multiply::<S, 1>(simd, x, slab, self.panels, at, ahead),
                    }
                    ahead.row += share * slab.depth();
                }
            }
        }
    }
}

/// Rows of all panels that will be copied next, from memory that is slower than the products are.
#[derive(Clone, Copy)]
struct Ahead {
    begin: usize,
    /// The next of them to be asked for, panel by panel.
    row: usize,
    /// So many at once.
    share: usize,
}

impl Ahead {
    /// Asks for the share of a step.
    #[inline(always)]
    fn prefetch(self, panels: &[&mut Panel], step: usize) {
        let first = self.row + step * self.share;
        for row in first..first + self.share {
            if let Some(row) = panels.get(row / PIECE).and_then(|p| p.as_flattened().get(self.begin + row % PIECE)) {
                prefetch(row);
            }
        }
    }
}

/// Eight rows, from `at`, of C panels of the product.
#[inline(always)]
fn multiply<S: Simd, const C: usize>(
    simd: S,
    x: &[Aligned<[Row; TILE]>],
    slab: &Slab,
    panels: &mut [&mut Panel],
    at: usize,
    ahead: Ahead,
) {
    let (parts, factors) = (parts::<S>(), slab.rows.as_chunks::<C>().0);
    let store = |panels: &mut [&mut Panel], first: usize, part: usize, sums: &[[S::f64s; C]]| {
        for (r, row) in sums.iter().enumerate() {
            for (panel, sum) in slab.columns.iter().zip(row) {
                registers_mut::<S>(&mut panels[*panel].as_flattened_mut()[at + first + r..][..1])[part] = *sum;
            }
        }
    };
    if parts == 1 {
        let sums = tile::<S, TILE, C>(simd, x, factors, 0, 0, |p| ahead.prefetch(panels, p));
        store(panels, 0, 0, &sums);
        return;
    }
    // Fewer and shorter registers.
    for (first, part) in [0, TILE / 2].into_iter().flat_map(|first| (0..parts).map(move |part| (first, part))) {
        let sums = tile::<S, { TILE / 2 }, C>(simd, x, factors, first, part, |_| ());
        store(panels, first, part, &sums);
    }
}

/// Products of R rows with one register of each of C panels; something else may be done at each step.
#[inline(always)]
fn tile<S: Simd, const R: usize, const C: usize>(
    simd: S,
    x: &[Aligned<[Row; TILE]>],
    factors: &[[Aligned<Row>; C]],
    first: usize,
    part: usize,
    aside: impl Fn(usize),
) -> [[S::f64s; C]; R] {
    let mut sums = [[simd.splat_f64s(0.0); C]; R];
    for (step, (rows, factors)) in x.iter().zip(factors.as_chunks::<WIDTH>().0).enumerate() {
        aside(step);
        for (i, factors) in factors.iter().enumerate() {
            let factors: [S::f64s; C] = std::array::from_fn(|c| registers::<S>(from_ref(&factors[c].0))[part]);
            for r in 0..R {
                let entry = simd.splat_f64s(rows.0[first + r][i]);
                for c in 0..C {
                    sums[r][c] = simd.mul_add_f64s(entry, factors[c], sums[r][c]);
                }
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use faer::Mat;

    const RUNS: usize = 2;

    fn random_panels(count: usize) -> Vec<Vec<[Row; RUN]>> {
        let mut random = Random::from_state(11);
        let mut row = || std::array::from_fn(|_| random.signed());
        (0..count).map(|_| (0..RUNS).map(|_| std::array::from_fn(|_| row())).collect()).collect()
    }

    /// Column by column.
    fn dense(panels: &[Vec<[Row; RUN]>]) -> Mat<f64> {
        let entry = |i: usize, j: usize| panels[j / WIDTH][i / RUN][i % RUN][j % WIDTH];
        Mat::from_fn(RUNS * RUN, panels.len() * WIDTH, entry)
    }

    fn distance(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
        (a - b).norm_max()
    }

    #[test]
    fn a_gram_matrix_in_two_parts_is_that_of_faer() {
        for count in [1, 2, GROUP + 3] {
            let panels = random_panels(count);
            let views: Vec<&Panel> = panels.iter().map(Vec::as_slice).collect();
            let mut parts = [Triangle::zeros(count), Triangle::zeros(count)];
            parts[0].add_gram(&views, 0..1);
            parts[1].add_gram(&views, 1..RUNS);
            let [mut sum, part] = parts;
            sum.add(&part);
            let y = dense(&panels);
            let found = Mat::from_fn(y.ncols(), y.ncols(), |i, j| sum.row(i.max(j))(i.min(j)));
            assert!(distance(&found, &(y.transpose() * &y)) < 1e-12);
        }
    }

    #[test]
    fn products_are_subtracted_downwards_from_what_was() {
        let mut panels = random_panels(4);
        let before = dense(&panels);
        let mut random = Random::from_state(5);
        let mut steps = Vec::new();
        let mut factors = Mat::<f64>::identity(4 * WIDTH, 4 * WIDTH);
        for (to, from) in [(3, 3), (3, 1), (2, 1), (1, 1), (1, 0)] {
            let block: Block = std::array::from_fn(|_| std::array::from_fn(|_| random.signed()));
            for (i, row) in block.iter().enumerate() {
                for (j, x) in row.iter().enumerate() {
                    factors[(from * WIDTH + i, to * WIDTH + j)] -= x;
                }
            }
            steps.push((to, from, block));
        }
        let mut views: Vec<&mut Panel> = panels.iter_mut().map(Vec::as_mut_slice).collect();
        subtract_products(&mut views, &steps);
        assert!(distance(&dense(&panels), &(before * factors)) < 1e-12);
    }

    #[test]
    fn the_product_takes_the_place_of_the_first_panels() {
        for (count, columns) in [(9, 5), (9, 4), (4, 3), (3, 1), (2, 2)] {
            let mut panels = random_panels(count);
            let before = dense(&panels);
            let mut random = Random::from_state(6);
            // Columns end at different rows, and those of every third panel are zeros.
            let end = |j: usize| if j / WIDTH % 3 == 2 { 0 } else { count * WIDTH - j / WIDTH * 5 };
            let c = Mat::from_fn(count * WIDTH, columns * WIDTH, |i, j| if i < end(j) { random.signed() } else { 0.0 });
            let mut views: Vec<&mut Panel> = panels.iter_mut().map(Vec::as_mut_slice).collect();
            replace_by_product(&mut views, &Combination::new(c.as_ref()));
            assert!(distance(&dense(&panels[..columns]), &(before * c)) < 1e-12);
        }
    }

    #[test]
    fn the_width_of_registers_changes_no_bit() {
        fn results<S: Simd>(simd: S) -> (Vec<Block>, Vec<Vec<[Row; RUN]>>) {
            let mut panels = random_panels(5);
            let views: Vec<&Panel> = panels.iter().map(Vec::as_slice).collect();
            let mut sums = Triangle::zeros(5).0;
            Gram { panels: &views, runs: 0..RUNS, sums: &mut sums }.with_simd(simd);
            let block = sums[3].map(|row| row.map(|x| 0.01 * x));
            let factors = [3, 2, 1].map(|columns| {
                let entry = |i: usize, j: usize| panels[1][0][i + 40 * (j / WIDTH)][j % WIDTH];
                Combination::new(Mat::from_fn(5 * WIDTH, columns * WIDTH, entry).as_ref())
            });
            let mut views: Vec<&mut Panel> = panels.iter_mut().map(Vec::as_mut_slice).collect();
            Subtraction { panels: &mut views, steps: &[(4, 4, block), (4, 2, block)], runs: RUNS }.with_simd(simd);
            for Combination(slabs) in &factors {
                Replacement { panels: &mut views, slabs }.with_simd(simd);
            }
            (sums, panels)
        }
        let widest = results(pulp::Scalar512b);
        assert!(results(pulp::Scalar256b) == widest && results(pulp::Scalar) == widest);
        let mut sums = Triangle::zeros(5);
        let panels = random_panels(5);
        sums.add_gram(&panels.iter().map(Vec::as_slice).collect::<Vec<_>>(), 0..RUNS);
        assert!(sums.0 == widest.0);
    }
}
