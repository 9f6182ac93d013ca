//! What a solve does at one supernode, for eight right-hand sides.
//!
//! Columns go in chunks of at most eight, so that their part of x stays in registers while the rows below go by.

use super::tiles::parts;
use pulp::Simd;

/// A supernode, and x in registers, of which a row has several where they are short.
pub(super) struct Node<'a, T> {
    pub width: usize,
    pub own: &'a mut [T],
    pub square: &'a [f64],
    pub pivots: &'a [f64],
    /// Rows of the segment.
    pub near: Below<'a, T>,
    /// Rows of the top, for a supernode that is not in it.
    pub far: Below<'a, T>,
}

/// Rows below a supernode, its entries there, and x from row `begin` on.
pub(super) struct Below<'a, T> {
    pub rows: &'a [u32],
    pub entries: &'a [f64],
    pub x: &'a mut [T],
    pub begin: usize,
}

impl<T: Copy> Below<'_, T> {
    /// Adds multiples of C columns, from `begin` of so many on, to x.
    #[inline(always)]
    fn add_columns<S: Simd<f64s = T>, const C: usize>(
        &mut self,
        simd: S,
        part: usize,
        width: usize,
        begin: usize,
        multiples: &[T; C],
    ) {
        let mut entries = self.entries;
        for &row in self.rows {
            let (l, later) = entries.split_at(width);
            let x = &mut self.x[(row as usize - self.begin) * parts::<S>() + part];
            *x = add_product(simd, *x, &l[begin..], multiples);
            entries = later;
        }
    }

    /// Adds the products of C columns from `begin` on with x, U rows in flight so that sums do not wait for each other.
    #[inline(always)]
    fn add_products<S: Simd<f64s = T>, const C: usize, const U: usize>(
        &self,
        simd: S,
        part: usize,
        width: usize,
        begin: usize,
        sums: &mut [[T; C]; U],
    ) {
        let row = |row: u32| self.x[(row as usize - self.begin) * parts::<S>() + part];
        // From the last row to the first, as supernodes go by: memory is then read in one direction.
        let (groups, rest) = self.rows.as_chunks::<U>();
        let mut entries = self.entries;
        for &r in rest.iter().rev() {
            let (before, l) = entries.split_at(entries.len() - width);
            add_multiples(simd, &mut sums[0], &l[begin..], row(r));
            entries = before;
        }
        for group in groups.iter().rev() {
            let (before, now) = entries.split_at(entries.len() - U * width);
            for u in (0..U).rev() {
                add_multiples(simd, &mut sums[u], &now[u * width + begin..], row(group[u]));
            }
            entries = before;
        }
    }
}

impl<T: Copy> Node<'_, T> {
    #[inline(always)]
    pub fn forward<S: Simd<f64s = T>>(&mut self, simd: S, part: usize) {
        let mut begin = 0;
        while begin < self.width {
            begin += match self.width - begin {
                8.. => self.eliminate::<S, 8>(simd, part, begin),
                7 => self.eliminate::<S, 7>(simd, part, begin),
                6 => self.eliminate::<S, 6>(simd, part, begin),
                5 => self.eliminate::<S, 5>(simd, part, begin),
                4 => self.eliminate::<S, 4>(simd, part, begin),
                3 => self.eliminate::<S, 3>(simd, part, begin),
                2 => self.eliminate::<S, 2>(simd, part, begin),
                _ => self.eliminate::<S, 1>(simd, part, begin),
            };
        }
    }

    /// Solves for C rows of the triangle from `begin` on, once those before are removed, and removes them from all below. Returns C.
    #[inline(always)]
    fn eliminate<S: Simd<f64s = T>, const C: usize>(&mut self, simd: S, part: usize, begin: usize) -> usize {
        let (parts, width, end) = (parts::<S>(), self.width, begin + C);
        let l: [&[f64]; C] = std::array::from_fn(|r| &self.square[(begin + r) * width + begin..][..C]);
        let (own, rest) = self.own[begin * parts..].split_at_mut(C * parts);
        let mut y: [T; C] = std::array::from_fn(|c| own[c * parts + part]);
        for c in 0..C {
            own[c * parts + part] = y[c];
            y[c] = simd.neg_f64s(y[c]);
            for r in c + 1..C {
                y[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][c]), y[c], y[r]);
            }
        }
        let mut square = &self.square[end * width..];
        for x in rest.chunks_exact_mut(parts) {
            let (l, later) = square.split_at(width);
            x[part] = add_product(simd, x[part], &l[begin..], &y);
            square = later;
        }
        self.near.add_columns(simd, part, width, begin, &y);
        self.far.add_columns(simd, part, width, begin, &y);
        C
    }

    #[inline(always)]
    pub fn backward<S: Simd<f64s = T>>(&mut self, simd: S, part: usize) {
        let mut end = self.width;
        while end > 0 {
            end -= match end {
                8.. => self.gather::<S, 8, 1>(simd, part, end),
                7 => self.gather::<S, 7, 1>(simd, part, end),
                6 => self.gather::<S, 6, 1>(simd, part, end),
                5 => self.gather::<S, 5, 1>(simd, part, end),
                4 => self.gather::<S, 4, 2>(simd, part, end),
                3 => self.gather::<S, 3, 2>(simd, part, end),
                2 => self.gather::<S, 2, 2>(simd, part, end),
                _ => self.gather::<S, 1, 2>(simd, part, end),
            };
        }
    }

    /// Solves for C columns before `end`, once those after are known: C products for each row loaded, of which U are in flight. Returns C.
    #[inline(always)]
    fn gather<S: Simd<f64s = T>, const C: usize, const U: usize>(&mut self, simd: S, part: usize, end: usize) -> usize {
        let (parts, width, begin) = (parts::<S>(), self.width, end - C);
        let mut sums = [[simd.splat_f64s(0.0); C]; U];
        self.far.add_products(simd, part, width, begin, &mut sums);
        self.near.add_products(simd, part, width, begin, &mut sums);
        let (own, known) = self.own.split_at_mut(end * parts);
        let mut square = &self.square[end * width..];
        for y in known.chunks_exact(parts).rev() {
            let (before, l) = square.split_at(square.len() - width);
            add_multiples(simd, &mut sums[0], &l[begin..], y[part]);
            square = before;
        }
        let (own, pivots) = (&mut own[begin * parts..], &self.pivots[begin..end]);
        let mut y = sums[0];
        // No closures here: of so many some would not be inlined.
        for c in 0..C {
            for more in &sums[1..] {
                y[c] = simd.add_f64s(y[c], more[c]);
            }
            y[c] = simd.sub_f64s(simd.mul_f64s(own[c * parts + part], simd.splat_f64s(pivots[c])), y[c]);
        }
        for j in (0..C).rev() {
            own[j * parts + part] = y[j];
            let (l, known) = (&self.square[(begin + j) * width + begin..][..C], simd.neg_f64s(y[j]));
            for c in 0..j {
                y[c] = simd.mul_add_f64s(simd.splat_f64s(l[c]), known, y[c]);
            }
        }
        C
    }
}

/// sum + l'y, for the first entries of l.
#[inline(always)]
fn add_product<S: Simd, const C: usize>(simd: S, mut sum: S::f64s, l: &[f64], y: &[S::f64s; C]) -> S::f64s {
    let l = &l[..C];
    for c in 0..C {
        sum = simd.mul_add_f64s(simd.splat_f64s(l[c]), y[c], sum);
    }
    sum
}

/// sums + y l, for the first entries of l.
#[inline(always)]
fn add_multiples<S: Simd, const C: usize>(simd: S, sums: &mut [S::f64s; C], l: &[f64], y: S::f64s) {
    let l = &l[..C];
    for c in 0..C {
        sums[c] = simd.mul_add_f64s(simd.splat_f64s(l[c]), y, sums[c]);
    }
}
