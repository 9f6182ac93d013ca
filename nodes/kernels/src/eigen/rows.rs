//! Products of the rows of runs in explicit SIMD instructions: of plain loops over rows the compiler makes gathers.
//!
//! Every entry is summed in the same order whatever the width of a register. The run `ahead`, if there is one, is fetched row by row meanwhile, so that
//! memory arrives while there is something to compute.

use super::panel::{Block, Row, WIDTH};
use super::pool::{Panel, RUN};
use super::tiles::{parts, registers, registers_mut};
use crate::simd::prefetch;
use pulp::Simd;

pub(super) type Run = [Row; RUN];

/// Rows that are worked on at once, so that products do not wait for each other.
pub(super) const TILE: usize = 8;

/// The run that comes after panel p's when all panels go by run by run.
#[inline(always)]
pub(super) fn next<'p>(panels: &[&'p Panel], p: usize, run: usize) -> Option<&'p Run> {
    panels.get(p + 1).map_or_else(|| panels[0].get(run + 1), |panel| panel.get(run))
}

/// h_c += x' y_c: entries of x are loaded once for all c.
#[inline(always)]
pub(super) fn add_products<S: Simd, const C: usize>(
    simd: S,
    x: &Run,
    y: [&Run; C],
    h: [&mut Block; C],
    ahead: Option<&Run>,
) {
    let parts = parts::<S>();
    if C > 1 && parts > 1 {
        // Too few registers for that.
        y.into_iter().zip(h).for_each(|(y, h)| add_products(simd, x, [y], [h], ahead));
        return;
    }
    let ahead = ahead.unwrap_or(x);
    let (zero, y) = (simd.splat_f64s(0.0), y.map(|y| registers::<S>(y)));
    let mut h = h.map(|h| registers_mut::<S>(h));
    for part in 0..parts {
        let mut sums = [[zero; WIDTH]; C];
        for (r, x) in x.iter().enumerate() {
            prefetch(&ahead[r]);
            let y = y.map(|y| y[r * parts + part]);
            for i in 0..WIDTH {
                let entry = simd.splat_f64s(x[i]);
                for c in 0..C {
                    sums[c][i] = simd.mul_add_f64s(entry, y[c], sums[c][i]);
                }
            }
        }
        for (h, sums) in h.iter_mut().zip(&sums) {
            for (row, sum) in h.chunks_exact_mut(parts).zip(sums) {
                row[part] = simd.add_f64s(row[part], *sum);
            }
        }
    }
}

/// y_c -= x h_c: entries of x are loaded once for all c.
#[inline(always)]
pub(super) fn subtract_from_run<S: Simd, const C: usize>(
    simd: S,
    mut y: [&mut Run; C],
    x: &Run,
    h: [&Block; C],
    ahead: Option<&Run>,
) {
    let ahead = ahead.unwrap_or(x).as_chunks::<TILE>().0;
    for (tile, (x, ahead)) in x.as_chunks::<TILE>().0.iter().zip(ahead).enumerate() {
        ahead.iter().for_each(prefetch);
        subtract_from_tile(simd, y.each_mut().map(|y| &mut y.as_chunks_mut::<TILE>().0[tile]), x, h);
    }
}

/// The same for some rows.
#[inline(always)]
pub(super) fn subtract_from_tile<S: Simd, const C: usize>(
    simd: S,
    y: [&mut [Row; TILE]; C],
    x: &[Row; TILE],
    h: [&Block; C],
) {
    let parts = parts::<S>();
    if C > 1 && parts > 1 {
        y.into_iter().zip(h).for_each(|(y, h)| subtract_from_tile(simd, [y], x, [h]));
        return;
    }
    let (mut y, h) = (y.map(|y| registers_mut::<S>(y)), h.map(|h| registers::<S>(h)));
    for part in 0..parts {
        let mut rows: [[S::f64s; TILE]; C] = std::array::from_fn(|c| std::array::from_fn(|r| y[c][r * parts + part]));
        for i in 0..WIDTH {
            for r in 0..TILE {
                let entry = simd.splat_f64s(x[r][i]);
                for c in 0..C {
                    rows[c][r] = simd.negate_mul_add_f64s(entry, h[c][i * parts + part], rows[c][r]);
                }
            }
        }
        for (y, rows) in y.iter_mut().zip(rows) {
            for (r, row) in rows.into_iter().enumerate() {
                y[r * parts + part] = row;
            }
        }
    }
}

/// y += x, columns of x times these factors.
#[inline(always)]
pub(super) fn add_scaled<S: Simd>(simd: S, y: &mut Run, x: &Run, factors: &Row, ahead: Option<&Run>) {
    let (ahead, factors) = (ahead.unwrap_or(x), registers::<S>(std::slice::from_ref(factors)));
    let rows = registers_mut::<S>(y).chunks_exact_mut(factors.len()).zip(registers::<S>(x).chunks_exact(factors.len()));
    for ((y, x), ahead) in rows.zip(ahead) {
        prefetch(ahead);
        for (part, factor) in factors.iter().enumerate() {
            y[part] = simd.mul_add_f64s(x[part], *factor, y[part]);
        }
    }
}

/// w <- w h.
#[inline(always)]
pub(super) fn multiply_right<S: Simd>(simd: S, w: &mut Run, h: &Block) {
    let (parts, h) = (parts::<S>(), registers::<S>(h));
    for rows in w.as_chunks_mut::<TILE>().0 {
        let x = *rows;
        let rows = registers_mut::<S>(rows);
        for part in 0..parts {
            let mut sums = [simd.splat_f64s(0.0); TILE];
            for i in 0..WIDTH {
                for r in 0..TILE {
                    sums[r] = simd.mul_add_f64s(simd.splat_f64s(x[r][i]), h[i * parts + part], sums[r]);
                }
            }
            for (row, sum) in rows.chunks_exact_mut(parts).zip(sums) {
                row[part] = sum;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use pulp::WithSimd;

    /// Everything once: products of the first run with the others, then these without them, then the last one times a block.
    struct All<'a> {
        runs: &'a mut [Run],
        sums: &'a mut [Block; 3],
    }

    impl WithSimd for All<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            let (first, others) = self.runs.split_at_mut(1);
            let [a, b, c] = self.sums;
            let [x, y, z] = others else { panic!("three") };
            add_products(simd, &first[0], [x, y], [a, b], Some(z));
            add_products(simd, &first[0], [z], [c], None);
            subtract_from_run(simd, [x, y], &first[0], [a, b], None);
            subtract_from_run(simd, [z], &first[0], [c], Some(x));
            multiply_right(simd, z, a);
            add_scaled(simd, y, x, &a[0], None);
        }
    }

    fn random_runs() -> Vec<Run> {
        let mut random = Random::from_state(17);
        let mut runs = vec![[[0.0; WIDTH]; RUN]; 4];
        runs.as_flattened_mut().as_flattened_mut().fill_with(|| random.signed() / (RUN as f64).sqrt());
        runs
    }

    /// x' y.
    fn gram(x: &Run, y: &Run) -> Block {
        let entry = |i: usize, q: usize| x.iter().zip(y).map(|(x, y)| x[i] * y[q]).sum();
        std::array::from_fn(|i| std::array::from_fn(|q| entry(i, q)))
    }

    /// x h.
    fn times(x: &Row, h: &Block) -> Row {
        std::array::from_fn(|q| (0..WIDTH).map(|i| x[i] * h[i][q]).sum())
    }

    fn distance(a: &[Row], b: &[Row]) -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).fold(0.0, |m, (x, y)| m.max((x - y).abs()))
    }

    #[test]
    fn products_are_those_of_plain_loops() {
        let (mut runs, before, mut sums) = (random_runs(), random_runs(), [[[1.0; WIDTH]; WIDTH]; 3]);
        pulp::Arch::new().dispatch(All { runs: &mut runs, sums: &mut sums });
        for (c, sum) in sums.iter().enumerate() {
            let expected = gram(&before[0], &before[c + 1]).map(|row| row.map(|x| x + 1.0));
            assert!(distance(sum, &expected) < 1e-14);
            let rest: Vec<Row> = before[0]
                .iter()
                .zip(&before[c + 1])
                .zip(&runs[1])
                .map(|((x, y), z)| {
                    let (product, scaled) = (times(x, sum), if c == 1 { sums[0][0] } else { [0.0; WIDTH] });
                    std::array::from_fn(|q| y[q] - product[q] + z[q] * scaled[q])
                })
                .map(|row| if c == 2 { times(&row, &sums[0]) } else { row })
                .collect();
            assert!(distance(&runs[c + 1], &rest) < 1e-13);
        }
        assert!(runs[0] == before[0]);
    }

    #[test]
    fn the_width_of_registers_changes_no_bit() {
        fn results<S: Simd>(simd: S) -> (Vec<Run>, [Block; 3]) {
            let (mut runs, mut sums) = (random_runs(), [[[0.5; WIDTH]; WIDTH]; 3]);
            All { runs: &mut runs, sums: &mut sums }.with_simd(simd);
            (runs, sums)
        }
        let widest = results(pulp::Scalar512b);
        assert!(results(pulp::Scalar256b) == widest && results(pulp::Scalar) == widest);
        let (mut runs, mut sums) = (random_runs(), [[[0.5; WIDTH]; WIDTH]; 3]);
        pulp::Arch::new().dispatch(All { runs: &mut runs, sums: &mut sums });
        assert!((runs, sums) == widest);
    }
}
