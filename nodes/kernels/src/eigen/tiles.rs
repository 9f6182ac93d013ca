//! Products of panels in explicit SIMD instructions: loops over arrays of arrays are not turned into the widest ones. Every entry is
//! summed in the same order whatever the width of a register.

use super::panel::{Block, Row, WIDTH, ZERO};
use super::pool::{Panel, RUN};
use faer::MatRef;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

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

    /// Row and column count vectors.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        let (i, j) = (i.max(j), i.min(j));
        let (row, column) = (i / WIDTH, j / WIDTH);
        self.0[row * (row + 1) / 2 + column][i % WIDTH][j % WIDTH]
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
                    let (pairs, single) = sums.as_chunks_mut::<2>();
                    for (pair, column) in pairs.iter_mut().zip(columns.clone().step_by(2)) {
                        add_products(simd, pair, x, &self.panels[column][run], &self.panels[column + 1][run]);
                    }
                    for sum in single {
                        add_product(simd, sum, x, &self.panels[columns.end - 1][run]);
                    }
                }
            }
        }
    }
}

/// h += x' y.
#[inline(always)]
fn add_product<S: Simd>(simd: S, h: &mut Block, x: &[Row], y: &[Row]) {
    let parts = parts::<S>();
    for part in 0..parts {
        let mut sums = [simd.splat_f64s(0.0); WIDTH];
        for (x, y) in x.iter().zip(registers::<S>(y).chunks_exact(parts)) {
            for i in 0..WIDTH {
                sums[i] = simd.mul_add_f64s(simd.splat_f64s(x[i]), y[part], sums[i]);
            }
        }
        add_sums(simd, h, &sums, part);
    }
}

/// Both at once, so that entries of x are loaded once for two products.
#[inline(always)]
fn add_products<S: Simd>(simd: S, h: &mut [Block; 2], x: &[Row], y: &[Row], z: &[Row]) {
    let parts = parts::<S>();
    if parts > 1 {
        // Too few registers for that.
        add_product(simd, &mut h[0], x, y);
        add_product(simd, &mut h[1], x, z);
        return;
    }
    let mut sums = [[simd.splat_f64s(0.0); WIDTH]; 2];
    for ((x, y), z) in x.iter().zip(registers::<S>(y)).zip(registers::<S>(z)) {
        for i in 0..WIDTH {
            let factor = simd.splat_f64s(x[i]);
            sums[0][i] = simd.mul_add_f64s(factor, *y, sums[0][i]);
            sums[1][i] = simd.mul_add_f64s(factor, *z, sums[1][i]);
        }
    }
    add_sums(simd, &mut h[0], &sums[0], 0);
    add_sums(simd, &mut h[1], &sums[1], 0);
}

#[inline(always)]
fn add_sums<S: Simd>(simd: S, h: &mut Block, sums: &[S::f64s; WIDTH], part: usize) {
    for (row, sum) in registers_mut::<S>(h).chunks_exact_mut(parts::<S>()).zip(sums) {
        row[part] = simd.add_f64s(row[part], *sum);
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
            for (to, from, block) in self.steps {
                if to == from {
                    // Rows are read before they are written.
                    for rows in self.panels[*to][run].as_chunks_mut::<8>().0 {
                        let x = *rows;
                        subtract_product(simd, rows, &x, block);
                    }
                } else if let Ok([y, x]) = self.panels.get_disjoint_mut([*to, *from]) {
                    for (y, x) in y[run].as_chunks_mut::<8>().0.iter_mut().zip(x[run].as_chunks::<8>().0) {
                        subtract_product(simd, y, x, block);
                    }
                }
            }
        }
    }
}

/// y -= x h for eight rows, so that products do not wait for each other.
#[inline(always)]
fn subtract_product<S: Simd>(simd: S, y: &mut [Row; 8], x: &[Row; 8], h: &Block) {
    let parts = parts::<S>();
    let (y, h) = (registers_mut::<S>(y), registers::<S>(h));
    for part in 0..parts {
        let mut rows: [S::f64s; 8] = std::array::from_fn(|r| y[r * parts + part]);
        for i in 0..WIDTH {
            for r in 0..8 {
                rows[r] = simd.negate_mul_add_f64s(simd.splat_f64s(x[r][i]), h[i * parts + part], rows[r]);
            }
        }
        for r in 0..8 {
            y[r * parts + part] = rows[r];
        }
    }
}

/// Rows that are multiplied at once, and columns of the factor: as many products as registers hold, with few loads for each.
const TILE: usize = 8;
const SLAB: usize = 3;

/// Rows of all panels that stay in the second-level cache while the factor goes by.
const PIECE: usize = 64;

/// Puts V c in place of the first panels of V; c has eight rows per panel, and panels of columns.
pub(super) fn replace_by_product(panels: &mut [&mut Panel], c: MatRef<'_, f64>) {
    let slab = |first: usize| {
        let columns = (c.ncols() / WIDTH - first).min(SLAB);
        let row = |k: usize, p: usize| std::array::from_fn(|q| c[(k, (first + p) * WIDTH + q)]);
        (0..c.nrows()).flat_map(|k| (0..columns).map(move |p| (k, p))).map(|(k, p)| row(k, p)).collect()
    };
    let slabs: Vec<Vec<Row>> = (0..c.ncols() / WIDTH).step_by(SLAB).map(slab).collect();
    Arch::new().dispatch(Replacement { panels, slabs: &slabs });
}

struct Replacement<'a, 'b> {
    panels: &'a mut [&'b mut Panel],
    /// Up to three panels of columns each, row by row.
    slabs: &'a [Vec<Row>],
}

impl WithSimd for Replacement<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (count, runs) = (self.panels.len(), self.panels.first().map_or(0, |panel| panel.len()));
        let mut rows = vec![[[0.0; WIDTH]; TILE]; count * PIECE / TILE];
        for (run, begin) in (0..runs).flat_map(|run| (0..RUN).step_by(PIECE).map(move |begin| (run, begin))) {
            for (p, panel) in self.panels.iter().enumerate() {
                for (g, tile) in panel[run][begin..begin + PIECE].as_chunks().0.iter().enumerate() {
                    rows[g * count + p] = *tile;
                }
            }
            for (target, slab) in self.panels.chunks_mut(SLAB).zip(self.slabs) {
                for (g, x) in rows.chunks_exact(count).enumerate() {
                    let at = begin + g * TILE..begin + (g + 1) * TILE;
                    match slab.len() / (WIDTH * count) {
                        3 => multiply::<S, 3>(simd, x, slab, target, run, at),
                        2 => multiply::<S, 2>(simd, x, slab, target, run, at),
                        _ => multiply::<S, 1>(simd, x, slab, target, run, at),
                    }
                }
            }
        }
    }
}

/// Eight rows of C panels of the product.
#[inline(always)]
fn multiply<S: Simd, const C: usize>(
    simd: S,
    x: &[[Row; TILE]],
    slab: &[Row],
    target: &mut [&mut Panel],
    run: usize,
    at: Range<usize>,
) {
    let parts = parts::<S>();
    let factors = slab.as_chunks::<C>().0;
    let mut store = |first: usize, part: usize, sums: &[[S::f64s; C]]| {
        for (r, row) in sums.iter().enumerate() {
            for (panel, sum) in target.iter_mut().zip(row) {
                registers_mut::<S>(&mut panel[run][at.start + first + r..][..1])[part] = *sum;
            }
        }
    };
    if parts == 1 {
        store(0, 0, &tile::<S, TILE, C>(simd, x, factors, 0, 0));
        return;
    }
    // Fewer and shorter registers.
    for (first, part) in [0, TILE / 2].into_iter().flat_map(|first| (0..parts).map(move |part| (first, part))) {
        store(first, part, &tile::<S, { TILE / 2 }, C>(simd, x, factors, first, part));
    }
}

/// Products of R rows with one register of each of C panels.
#[inline(always)]
fn tile<S: Simd, const R: usize, const C: usize>(
    simd: S,
    x: &[[Row; TILE]],
    factors: &[[Row; C]],
    first: usize,
    part: usize,
) -> [[S::f64s; C]; R] {
    let parts = parts::<S>();
    let mut sums = [[simd.splat_f64s(0.0); C]; R];
    for (rows, factors) in x.iter().zip(factors.as_chunks::<WIDTH>().0) {
        for i in 0..WIDTH {
            let factors = registers::<S>(&factors[i]);
            for r in 0..R {
                let entry = simd.splat_f64s(rows[first + r][i]);
                for c in 0..C {
                    sums[r][c] = simd.mul_add_f64s(entry, factors[c * parts + part], sums[r][c]);
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
            let found = Mat::from_fn(y.ncols(), y.ncols(), |i, j| sum.get(i, j));
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
        for (count, columns) in [(9, 5), (4, 3), (3, 1), (2, 2)] {
            let mut panels = random_panels(count);
            let before = dense(&panels);
            let mut random = Random::from_state(6);
            let c = Mat::from_fn(count * WIDTH, columns * WIDTH, |_, _| random.signed());
            let mut views: Vec<&mut Panel> = panels.iter_mut().map(Vec::as_mut_slice).collect();
            replace_by_product(&mut views, c.as_ref());
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
            let slabs = [3, 1].map(|columns| (0..5 * WIDTH * columns).map(|i| panels[1][0][i]).collect());
            let mut views: Vec<&mut Panel> = panels.iter_mut().map(Vec::as_mut_slice).collect();
            Subtraction { panels: &mut views, steps: &[(4, 4, block), (4, 2, block)], runs: RUNS }.with_simd(simd);
            Replacement { panels: &mut views, slabs: &slabs }.with_simd(simd);
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
