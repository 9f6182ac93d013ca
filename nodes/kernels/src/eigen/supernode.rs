//! What a solve does at one supernode, for eight right-hand sides.

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
    /// Subtracts the columns from x.
    #[inline(always)]
    fn subtract<S: Simd<f64s = T>>(&mut self, simd: S, part: usize, own: &[T], width: usize) {
        let (fours, rest) = self.rows.as_chunks::<4>();
        let (twos, ones) = rest.as_chunks::<2>();
        let mut entries = self.entries;
        for rows in fours {
            entries = self.scatter(simd, part, own, width, rows, entries);
        }
        for rows in twos {
            entries = self.scatter(simd, part, own, width, rows, entries);
        }
        for &row in ones {
            entries = self.scatter(simd, part, own, width, &[row], entries);
        }
    }

    /// The same for R rows, in R sums that do not wait for each other. Returns the entries of the rows after those.
    #[inline(always)]
    fn scatter<'e, S: Simd<f64s = T>, const R: usize>(
        &mut self,
        simd: S,
        part: usize,
        own: &[T],
        width: usize,
        rows: &[u32; R],
        entries: &'e [f64],
    ) -> &'e [f64] {
        let parts = parts::<S>();
        let (now, later) = entries.split_at(R * width);
        let l: [&[f64]; R] = std::array::from_fn(|r| &now[r * width..][..width]);
        let at = rows.map(|row| (row as usize - self.begin) * parts + part);
        let mut sums = at.map(|i| self.x[i]);
        for (c, y) in own.chunks_exact(parts).enumerate().take(width) {
            let y = simd.neg_f64s(y[part]);
            for r in 0..R {
                sums[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][c]), y, sums[r]);
            }
        }
        for r in 0..R {
            self.x[at[r]] = sums[r];
        }
        later
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
        let (entries, last) = self.entries.split_at(groups.len() * U * width);
        for (&r, l) in rest.iter().zip(last.chunks_exact(width)).rev() {
            add_multiples(simd, &mut sums[0], &l[begin..], row(r));
        }
        for (group, now) in groups.iter().zip(entries.chunks_exact(U * width)).rev() {
            for u in (0..U).rev() {
                add_multiples(simd, &mut sums[u], &now[u * width + begin..], row(group[u]));
            }
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
                4.. => self.eliminate::<S, 4>(simd, part, begin),
                2.. => self.eliminate::<S, 2>(simd, part, begin),
                _ => self.eliminate::<S, 1>(simd, part, begin),
            };
        }
        self.near.subtract(simd, part, self.own, self.width);
        if !self.far.rows.is_empty() {
            self.far.subtract(simd, part, self.own, self.width);
        }
    }

    /// Solves for R rows of the triangle from `begin` on, once those before are known. Returns R.
    #[inline(always)]
    fn eliminate<S: Simd<f64s = T>, const R: usize>(&mut self, simd: S, part: usize, begin: usize) -> usize {
        let (parts, width) = (parts::<S>(), self.width);
        let l: [&[f64]; R] = std::array::from_fn(|r| &self.square[(begin + r) * width..][..begin + R]);
        let (done, rest) = self.own.split_at_mut(begin * parts);
        let mut sums: [T; R] = std::array::from_fn(|r| rest[r * parts + part]);
        for (c, y) in done.chunks_exact(parts).enumerate() {
            let y = simd.neg_f64s(y[part]);
            for r in 0..R {
                sums[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][c]), y, sums[r]);
            }
        }
        for c in 0..R {
            let y = simd.neg_f64s(sums[c]);
            for r in c + 1..R {
                sums[r] = simd.mul_add_f64s(simd.splat_f64s(l[r][begin + c]), y, sums[r]);
            }
        }
        for r in 0..R {
            rest[r * parts + part] = sums[r];
        }
        R
    }

    #[inline(always)]
    pub fn backward<S: Simd<f64s = T>>(&mut self, simd: S, part: usize) {
        for (y, p) in self.own.chunks_exact_mut(parts::<S>()).zip(self.pivots) {
            y[part] = simd.mul_f64s(y[part], simd.splat_f64s(*p));
        }
        let mut end = self.width;
        while end > 0 {
            end -= match end {
                8.. => self.gather::<S, 8, 1>(simd, part, end),
                4.. => self.gather::<S, 4, 2>(simd, part, end),
                2.. => self.gather::<S, 2, 4>(simd, part, end),
                _ => self.gather::<S, 1, 4>(simd, part, end),
            };
        }
    }

    /// Solves for C columns before `end`, once those after are known: C products for each row loaded, of which U are in flight. Returns C.
    #[inline(always)]
    fn gather<S: Simd<f64s = T>, const C: usize, const U: usize>(&mut self, simd: S, part: usize, end: usize) -> usize {
        let (parts, width, begin) = (parts::<S>(), self.width, end - C);
        let mut sums = [[simd.splat_f64s(0.0); C]; U];
        if !self.far.rows.is_empty() {
            self.far.add_products(simd, part, width, begin, &mut sums);
        }
        self.near.add_products(simd, part, width, begin, &mut sums);
        let known = self.own[end * parts..].chunks_exact(parts).zip(self.square[end * width..].chunks_exact(width));
        for (y, l) in known.rev() {
            add_multiples(simd, &mut sums[0], &l[begin..], y[part]);
        }
        let mut own: [T; C] = std::array::from_fn(|c| {
            let sum = (1..U).fold(sums[0][c], |sum, u| simd.add_f64s(sum, sums[u][c]));
            simd.sub_f64s(self.own[(begin + c) * parts + part], sum)
        });
        for j in (0..C).rev() {
            let (l, y) = (&self.square[(begin + j) * width + begin..][..C], simd.neg_f64s(own[j]));
            for c in 0..j {
                own[c] = simd.mul_add_f64s(simd.splat_f64s(l[c]), y, own[c]);
            }
        }
        for c in 0..C {
            self.own[(begin + c) * parts + part] = own[c];
        }
        C
    }
}

/// sums + y l, for the first entries of l.
#[inline(always)]
fn add_multiples<S: Simd, const C: usize>(simd: S, sums: &mut [S::f64s; C], l: &[f64], y: S::f64s) {
    let l = &l[..C];
    for c in 0..C {
        sums[c] = simd.mul_add_f64s(simd.splat_f64s(l[c]), y, sums[c]);
    }
}
