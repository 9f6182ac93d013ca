//! Row-major panels: n rows of B lanes, so that one pass over a factor or a basis serves B vectors.

use crate::simd::vectorised;

/// One row of a panel.
pub(super) type Row<const B: usize> = [f64; B];
/// Coefficients between two panels: entry (i, l) between vector i of the one and vector l of the other.
pub(super) type Block<const B: usize> = [[f64; B]; B];

/// sum + x y for a number x.
#[inline(always)]
pub(super) fn add_multiple<const B: usize>(sum: &mut Row<B>, x: f64, y: &Row<B>) {
    for l in 0..B {
        sum[l] = x.mul_add(y[l], sum[l]);
    }
}

/// q' w.
pub(super) fn inner<const B: usize>(q: &[Row<B>], w: &[Row<B>]) -> Block<B> {
    vectorised(
        #[inline(always)]
        || {
            // Four sums of every fourth row hide the latency of the additions, and round less than one.
            let mut sums = [[[0.0; B]; B]; 4];
            let (q4, q_rest) = q.as_chunks::<4>();
            let (w4, w_rest) = w.as_chunks::<4>();
            for (q, w) in q4.iter().zip(w4) {
                for r in 0..4 {
                    for i in 0..B {
                        add_multiple(&mut sums[r][i], q[r][i], &w[r]);
                    }
                }
            }
            for (q, w) in q_rest.iter().zip(w_rest) {
                for i in 0..B {
                    add_multiple(&mut sums[0][i], q[i], w);
                }
            }
            std::array::from_fn(|i| {
                std::array::from_fn(|l| (sums[0][i][l] + sums[1][i][l]) + (sums[2][i][l] + sums[3][i][l]))
            })
        },
    )
}

/// w - q c.
pub(super) fn subtract<const B: usize>(w: &mut [Row<B>], q: &[Row<B>], c: &Block<B>) {
    vectorised(
        #[inline(always)]
        || {
            for (w, q) in w.iter_mut().zip(q) {
                for i in 0..B {
                    add_multiple(w, -q[i], &c[i]);
                }
            }
        },
    );
}

/// w c, in place.
pub(super) fn multiply<const B: usize>(w: &mut [Row<B>], c: &Block<B>) {
    vectorised(
        #[inline(always)]
        || {
            for w in w {
                let old = *w;
                *w = [0.0; B];
                for i in 0..B {
                    add_multiple(w, old[i], &c[i]);
                }
            }
        },
    );
}
