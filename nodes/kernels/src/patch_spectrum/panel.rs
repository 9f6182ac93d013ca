//! Row-major panels: n rows of L lanes, so that one pass over a factor or a basis serves L vectors.
//!
//! The lanes are split among the problems that run side by side, B to each. What is computed between two panels is computed within
//! each problem only: coefficients are stored as `[[f64; L]; B]`, entry (i, l) between vector i and lane l of lane l's problem.

use crate::simd::vectorised;

/// One row of a panel.
pub(super) type Row<const L: usize> = [f64; L];
/// Coefficients between two panels.
pub(super) type Block<const L: usize, const B: usize> = [[f64; L]; B];

/// Vector i of every problem, in all lanes of that problem.
#[inline(always)]
fn spread<const L: usize, const B: usize>(row: &Row<L>, i: usize) -> Row<L> {
    std::array::from_fn(|l| row[l / B * B + i])
}

/// sum + x y, lane by lane.
#[inline(always)]
pub(super) fn add_product<const L: usize>(sum: &mut Row<L>, x: &Row<L>, y: &Row<L>) {
    for l in 0..L {
        sum[l] = x[l].mul_add(y[l], sum[l]);
    }
}

/// sum + x y for a number x.
#[inline(always)]
pub(super) fn add_multiple<const L: usize>(sum: &mut Row<L>, x: f64, y: &Row<L>) {
    for l in 0..L {
        sum[l] = x.mul_add(y[l], sum[l]);
    }
}

/// q' w within each problem.
pub(super) fn inner<const L: usize, const B: usize>(q: &[Row<L>], w: &[Row<L>]) -> Block<L, B> {
    vectorised(
        #[inline(always)]
        || {
            // Four sums of every fourth row hide the latency of the additions, and round less than one.
            let mut sums = [[[0.0; L]; B]; 4];
            let (q4, q_rest) = q.as_chunks::<4>();
            let (w4, w_rest) = w.as_chunks::<4>();
            for (q, w) in q4.iter().zip(w4) {
                for r in 0..4 {
                    for i in 0..B {
                        add_product(&mut sums[r][i], &spread::<L, B>(&q[r], i), &w[r]);
                    }
                }
            }
            for (q, w) in q_rest.iter().zip(w_rest) {
                for i in 0..B {
                    add_product(&mut sums[0][i], &spread::<L, B>(q, i), w);
                }
            }
            std::array::from_fn(|i| {
                std::array::from_fn(|l| (sums[0][i][l] + sums[1][i][l]) + (sums[2][i][l] + sums[3][i][l]))
            })
        },
    )
}

/// w - q c within each problem.
pub(super) fn subtract<const L: usize, const B: usize>(w: &mut [Row<L>], q: &[Row<L>], c: &Block<L, B>) {
    vectorised(
        #[inline(always)]
        || {
            let negated: Block<L, B> = c.map(|row| row.map(|x| -x));
            for (w, q) in w.iter_mut().zip(q) {
                for i in 0..B {
                    add_product(w, &spread::<L, B>(q, i), &negated[i]);
                }
            }
        },
    );
}

/// w c within each problem, in place.
pub(super) fn multiply<const L: usize, const B: usize>(w: &mut [Row<L>], c: &Block<L, B>) {
    vectorised(
        #[inline(always)]
        || {
            for w in w {
                let old = *w;
                *w = [0.0; L];
                for i in 0..B {
                    add_product(w, &spread::<L, B>(&old, i), &c[i]);
                }
            }
        },
    );
}
