//! What passes over a basis do with the runs of a part.

use super::basis::{Along, Near, Null};
use super::panel::{Block, Row, ZERO, add, transposed};
use super::pool::Panel;
use super::rows::{Run, add_products, add_scaled, multiply_right, next, subtract_from_run};
use pulp::{Simd, WithSimd};

/// A run, and the one after it.
fn with_next(panel: &mut Panel, run: usize) -> (&mut Run, Option<&Run>) {
    let (begin, end) = panel.split_at_mut(run + 1);
    (&mut begin[run], end.first())
}

/// Adds the products of panels with the last one, if it is given, and with w.
pub(super) struct Products<'a> {
    pub panels: &'a [&'a Panel],
    pub last: Option<&'a Panel>,
    pub work: &'a Panel,
    /// Number of the first run of `work`.
    pub first: usize,
    pub sums: &'a mut [[Block; 2]],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (run, w) in (self.first..).zip(self.work) {
            for (p, ([g, h], panel)) in self.sums.iter_mut().zip(self.panels).enumerate() {
                let ahead = next(self.panels, p, run);
                if let Some(last) = self.last {
                    add_products(simd, &panel[run], [&last[run], w], [g, h], ahead);
                } else {
                    add_products(simd, &panel[run], [w], [h], ahead);
                }
            }
        }
    }
}

/// A step of the recurrence: w -= V_j a + V_(j-1) b'.
pub(super) struct Step<'a> {
    pub diagonal: &'a Block,
    pub before: Option<&'a Block>,
    /// V_(j-1) joins the sketch after that, its columns times these.
    pub signs: Row,
}

/// Makes a step, if there is one, and adds the products of w with what is nearest to it.
pub(super) struct Nearest<'a> {
    pub step: Option<&'a Step<'a>>,
    /// The last panel and the one before.
    pub newest: &'a [&'a Panel],
    pub locked: &'a [&'a Panel],
    pub null: &'a Null,
    pub work: &'a mut Panel,
    pub sketch: &'a mut Panel,
    /// Number of the first run of `work`.
    pub first: usize,
    pub near: &'a mut Near,
}

impl WithSimd for Nearest<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { step, newest, locked, null, work, sketch, first, near } = self;
        // Of w' x, as x' w would load entries of every x.
        let mut sums = vec![ZERO; newest.len() + locked.len() + 2];
        for i in 0..work.len() {
            let run = first + i;
            let ((w, _), (sketch, sketch_ahead)) = (with_next(work, i), with_next(sketch, i));
            if let Some(step) = step {
                subtract_from_run(simd, [w], &newest[0][run], [step.diagonal], newest[0].get(run + 1));
                if let (Some(before), Some(b)) = (newest.get(1), step.before) {
                    subtract_from_run(simd, [w], &before[run], [b], before.get(run + 1));
                }
            }
            null.add_product(run, w, &mut near.null);
            let x = |p: usize| {
                let panel = newest.get(p).or_else(|| locked.get(p - newest.len()));
                panel.map_or(if p == newest.len() + locked.len() { &*sketch } else { &*w }, |panel| &panel[run])
            };
            for (t, sums) in sums.chunks_mut(3).enumerate() {
                let (p, ahead) = (3 * t, locked.get(t).and_then(|panel| panel.get(run + 1)));
                match sums {
                    [a, b, c] => add_products(simd, w, [x(p), x(p + 1), x(p + 2)], [a, b, c], ahead),
                    [a, b] => add_products(simd, w, [x(p), x(p + 1)], [a, b], ahead),
                    [a] => add_products(simd, w, [x(p)], [a], ahead),
                    _ => {}
                }
            }
            if let (Some(step), Some(before)) = (step, newest.get(1)) {
                add_scaled(simd, sketch, &before[run], &step.signs, sketch_ahead);
            }
        }
        let targets = near.last.iter_mut().take(newest.len()).chain(&mut near.locked);
        let targets = targets.chain([&mut near.sketch, &mut near.gram]);
        targets.zip(&sums).for_each(|(h, sum)| add(h, &transposed(sum)));
    }
}

/// Removes what was found from w, and from the last panel if something was found there; then w <- w h, and w' w is added.
pub(super) struct Removal<'a> {
    pub near: &'a Near,
    pub along: &'a Along,
    /// The panels before the last, and it.
    pub older: &'a [&'a Panel],
    pub last: &'a mut Panel,
    pub locked: &'a [&'a Panel],
    pub null: &'a Null,
    pub work: &'a mut Panel,
    /// Number of the first run of `work`.
    pub first: usize,
    pub h: Option<&'a Block>,
    pub gram: &'a mut Block,
}

impl WithSimd for Removal<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { near, along, older, last, locked, null, work, first, h, gram } = self;
        let paired = along.is_paired();
        for (i, w) in work.iter_mut().enumerate() {
            let run = first + i;
            null.remove(run, w, &near.null);
            // What was found along all panels holds what is along these.
            if along.panels.is_empty() {
                for (h, panel) in near.locked.iter().zip(locked) {
                    subtract_from_run(simd, [w], &panel[run], [h], panel.get(run + 1));
                }
            }
            if let Some(before) = older.last() {
                subtract_from_run(simd, [w], &before[run], [&near.last[1]], before.get(run + 1));
            }
            // There is none at first.
            if i < last.len() {
                let (last, ahead) = with_next(last, i);
                subtract_from_run(simd, [w], last, [&near.last[0]], ahead);
                let older = &older[..along.panels.len()];
                for (p, ([g, h], panel)) in along.panels.iter().zip(older).enumerate() {
                    let ahead = next(older, p, run);
                    if paired {
                        subtract_from_run(simd, [last, w], &panel[run], [g, h], ahead);
                    } else {
                        subtract_from_run(simd, [w], &panel[run], [h], ahead);
                    }
                }
            }
            if let Some(h) = h {
                multiply_right(simd, w, h);
            }
            add_products(simd, w, [w], [gram], None);
        }
    }
}

/// w <- w h, and w' w is added.
pub(super) struct Product<'a> {
    pub work: &'a mut Panel,
    pub h: &'a Block,
    pub gram: &'a mut Block,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for w in self.work {
            multiply_right(simd, w, self.h);
            add_products(simd, w, [w], [self.gram], None);
        }
    }
}

/// Removes what was found from w; then w <- w h, which is copied.
pub(super) struct Appending<'a> {
    /// Null vectors, and the products with them.
    pub null: Option<(&'a Null, &'a [Row])>,
    /// Panels, and the products with them.
    pub found: &'a [(&'a Panel, &'a Block)],
    pub work: &'a mut Panel,
    /// Number of the first run of `work`.
    pub first: usize,
    pub h: &'a Block,
    pub copy: &'a mut Panel,
}

impl WithSimd for Appending<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { null, found, work, first, h, copy } = self;
        for (run, (w, copy)) in (first..).zip(work.iter_mut().zip(copy)) {
            if let Some((null, products)) = null {
                null.remove(run, w, products);
            }
            for (panel, found) in found {
                subtract_from_run(simd, [w], &panel[run], [found], panel.get(run + 1));
            }
            multiply_right(simd, w, h);
            *copy = *w;
        }
    }
}
