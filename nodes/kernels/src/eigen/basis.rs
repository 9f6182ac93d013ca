//! The growing Krylov basis, and the passes over it.
//!
//! Passes go through the vertices in runs of [`RUN`], so that the eight vectors worked on stay in the cache while all panels go by; passes over
//! many panels are bound by memory bandwidth. Large passes are made in parts, on the threads that the hooks lend.

use super::panel::{Block, Row, Rows, WIDTH, ZERO, add, norm, product, subtract_multiple};
use super::parts::Pass;
use super::passes::{Appending, Nearest, Product, Products, Removal, Step};
use super::pool::{Panel, Panels, Place, Pool, RUN, runs, runs_mut};
use super::tiles::{Combination, replace_by_product, subtract_products};
use super::{EigenError, Hooks};
use crate::random::Random;
use faer::MatRef;
use pulp::Arch;

/// Panels that are looked at together.
const GROUP: usize = 8;

/// Seed of the sketch.
const SIGNS: u64 = 0x5167;

/// Products of the last panel below this may stay, and a hundred times that of the next one, in which they have grown: once they are
/// larger, they are removed.
const NEGLIGIBLE: f64 = 1e-11;

/// Products with the last two panels and with locked ones below this may stay too, in the mean of squares: about what rounding errors make anew.
const FAINT: f64 = 1e-12;

/// Known null vectors in elimination order: label and entry of the unit indicator at each row.
pub(super) struct Null {
    pub labels: Vec<u32>,
    pub units: Vec<f64>,
    pub count: usize,
}

impl Null {
    #[inline(always)]
    fn rows(&self, run: usize) -> impl Iterator<Item = (&u32, &f64)> {
        let begin = (run * RUN).min(self.labels.len());
        let end = (begin + RUN).min(self.labels.len());
        self.labels[begin..end].iter().zip(&self.units[begin..end])
    }

    /// Adds the products with w.
    #[inline(always)]
    pub(super) fn add_product(&self, run: usize, w: &[Row], sums: &mut [Row]) {
        let mut rows = self.rows(run).zip(w).peekable();
        // Rows of one component mostly follow each other: their sum stays in a register.
        while let Some(&((&label, _), _)) = rows.peek() {
            let mut sum = sums[label as usize];
            while let Some(((_, &unit), y)) = rows.next_if(|((of, _), _)| **of == label) {
                for q in 0..WIDTH {
                    sum[q] = unit.mul_add(y[q], sum[q]);
                }
            }
            sums[label as usize] = sum;
        }
    }

    /// Removes them.
    #[inline(always)]
    pub(super) fn remove(&self, run: usize, w: &mut [Row], products: &[Row]) {
        for ((&label, &unit), y) in self.rows(run).zip(w) {
            subtract_multiple(y, unit, &products[label as usize]);
        }
    }
}

/// Orthonormal panels, orthogonal to the null vectors, and the one that will be the next.
pub(super) struct Basis<'a> {
    panels: Panels<'a>,
    /// The panel worked on: whole runs, zeros at the end.
    work: Rows,
    /// The sum of all panels but the last two, each with random signs of its columns: its product with a panel is as large as the product of all of them
    /// is, in the mean of squares.
    sketch: Rows,
    signs: Random,
    /// Ritz vectors along which products grow fastest: every new panel is made orthogonal to them.
    locked: Rows,
    pool: &'a Pool,
    null: &'a Null,
    hooks: &'a dyn Hooks,
}

/// Products of the working panel w with what is nearest to it.
#[derive(Clone)]
pub(super) struct Near {
    /// With the last panel and the one before.
    pub last: [Block; 2],
    pub null: Vec<Row>,
    pub locked: Vec<Block>,
    /// With the sketch of all others.
    pub sketch: Block,
    /// w' w.
    pub gram: Block,
}

impl Near {
    fn none(null: &Null, locked: usize) -> Self {
        Self {
            last: [ZERO; 2],
            null: vec![[0.0; WIDTH]; null.count],
            locked: vec![ZERO; locked],
            sketch: ZERO,
            gram: ZERO,
        }
    }

    /// The products over more rows.
    fn join(&mut self, other: &Self) {
        let blocks = self.last.iter_mut().chain(&mut self.locked).chain([&mut self.gram, &mut self.sketch]);
        let others = other.last.iter().chain(&other.locked).chain([&other.gram, &other.sketch]);
        blocks.zip(others).for_each(|(block, other)| add(block, other));
        let null = self.null.as_flattened_mut().iter_mut();
        null.zip(other.null.as_flattened()).for_each(|(x, y)| *x += y);
    }
}

/// Products with the first panels, of the last panel and of w.
pub(super) struct Along {
    pub panels: Vec<[Block; 2]>,
}

impl Along {
    /// Whether anything was found along the last panel.
    pub fn is_paired(&self) -> bool {
        self.panels.iter().any(|h| norm(&h[0]) > 0.0)
    }
}

impl<'a> Basis<'a> {
    /// No panels yet.
    pub fn new(pool: &'a Pool, place: Place, null: &'a Null, hooks: &'a dyn Hooks) -> Result<Self, EigenError> {
        Ok(Self {
            panels: Panels::new(pool, place),
            work: pool.panels(1)?,
            sketch: pool.panels(1)?,
            signs: Random::from_state(SIGNS),
            locked: pool.panels(0)?,
            pool,
            null,
            hooks,
        })
    }

    pub fn count(&self) -> usize {
        self.panels.count()
    }

    pub fn is_locked(&self) -> bool {
        !runs(&self.locked).is_empty()
    }

    /// The first rows of the panel worked on.
    pub fn work(&mut self, rows: usize) -> &mut [Row] {
        &mut self.work.as_mut_slice()[..rows]
    }

    /// A pass over all rows that costs as much as so many products of each with a block.
    fn pass(&self, cost: usize) -> Pass<'a> {
        Pass::new(self.hooks, runs(&self.work).len(), cost)
    }

    /// V_j' w for the last panel j.
    pub fn diagonal(&self) -> Result<Block, EigenError> {
        let newest = self.panels.newest();
        Ok(self.products(&newest[..1], None)?[0][1])
    }

    /// w -= V_j a + V_(j-1) b' for the last panel j, and the panel before joins the sketch after that.
    pub fn recur(&mut self, diagonal: &Block, before: Option<&Block>) -> Result<Near, EigenError> {
        let signs = std::array::from_fn(|_| if self.signs.signed() < 0.0 { -1.0 } else { 1.0 });
        self.nearest(Some(&Step { diagonal, before, signs }))
    }

    /// Products with what is nearest.
    pub fn near(&mut self) -> Result<Near, EigenError> {
        self.nearest(None)
    }

    /// The same after a step, if there is one.
    fn nearest(&mut self, step: Option<&Step<'_>>) -> Result<Near, EigenError> {
        let (newest, locked) = (self.panels.newest(), self.pool.split(&self.locked));
        let steps = if step.is_some() { newest.len() + 1 } else { 0 };
        let (pass, null) = (self.pass(steps + newest.len() + locked.len() + 2), self.null);
        let work = runs_mut(&mut self.work).chunks_mut(pass.share);
        let parts = work.zip(runs_mut(&mut self.sketch).chunks_mut(pass.share));
        pass.sum(Near::none(null, locked.len()), parts, Near::join, |first, (work, sketch), near| {
            let (newest, locked) = (&newest, &locked);
            Arch::new().dispatch(Nearest { step, newest, locked, null, work, sketch, first, near });
        })
    }

    /// Products with the panels before the last two: of w, and of the last panel if `paired`. All of them, or with `scale`, the R^-1 of w, up to where they
    /// are negligible: products grow along converged Ritz vectors, which live in the first panels.
    pub fn along(&self, paired: bool, scale: Option<&Block>) -> Result<Along, EigenError> {
        let panels = self.panels.all();
        let older = panels.len().saturating_sub(2);
        let mut along = Along { panels: Vec::with_capacity(older) };
        for group in panels[..older].chunks(GROUP) {
            let sums = self.products(group, paired.then(|| panels[older + 1]))?;
            let negligible = |scale: &Block| {
                sums.iter().all(|h| norm(&h[0]) < NEGLIGIBLE && norm(&product(&h[1], scale)) < 100.0 * NEGLIGIBLE)
            };
            let last = scale.is_some_and(negligible);
            along.panels.extend(sums);
            if last {
                break;
            }
        }
        Ok(along)
    }

    /// Products of some panels with the last one, if it is given, and with w.
    fn products(&self, panels: &[&Panel], last: Option<&Panel>) -> Result<Vec<[Block; 2]>, EigenError> {
        let pass = self.pass(panels.len() * (1 + usize::from(last.is_some())));
        let zero = vec![[ZERO; 2]; panels.len()];
        let join = |sums: &mut Vec<[Block; 2]>, others: &Vec<[Block; 2]>| {
            let pairs = sums.as_flattened_mut().iter_mut().zip(others.as_flattened());
            pairs.for_each(|(sum, other)| add(sum, other));
        };
        pass.sum(zero, runs(&self.work).chunks(pass.share), join, |first, work, sums| {
            Arch::new().dispatch(Products { panels, last, work, first, sums });
        })
    }

    /// Removes what was found from the last panel and from w, then w <- w h; returns w' w.
    pub fn remove(&mut self, near: &Near, along: &Along, h: Option<&Block>) -> Result<Block, EigenError> {
        let pass = self.pass(along.panels.len() * (1 + usize::from(along.is_paired())) + 4);
        let (null, locked) = (self.null, self.pool.split(&self.locked));
        let (older, last) = self.panels.split().unwrap_or_default();
        // There is none at first.
        let mut last = last.chunks_mut(pass.share);
        let parts = runs_mut(&mut self.work).chunks_mut(pass.share).map(|work| (work, last.next().unwrap_or_default()));
        pass.sum(ZERO, parts, add, |first, (work, last), gram| {
            let (older, locked) = (&older, &locked);
            Arch::new().dispatch(Removal { near, along, older, last, locked, null, work, first, h, gram });
        })
    }

    /// w <- w h; returns the new w' w.
    pub fn multiply(&mut self, h: &Block) -> Result<Block, EigenError> {
        let pass = self.pass(2);
        pass.sum(ZERO, runs_mut(&mut self.work).chunks_mut(pass.share), add, |_, work, gram| {
            Arch::new().dispatch(Product { work, h, gram });
        })
    }

    /// w <- w h, which is appended, once what was found nearest to it is removed.
    pub fn append(&mut self, near: Option<&Near>, h: &Block) -> Result<(), EigenError> {
        self.panels.grow()?;
        // Three panels go through memory at least.
        let pass = self.pass(3);
        let (older, copy) = self.panels.split().unwrap_or_default();
        let locked = self.pool.split(&self.locked);
        let found = near.into_iter().flat_map(|near| {
            let newest = older.iter().rev().copied().zip(&near.last);
            newest.chain(locked.iter().copied().zip(&near.locked))
        });
        let found: Vec<_> = found.filter(|(_, found)| norm(&product(found, h)) > FAINT).collect();
        let null = near.map(|near| (self.null, near.null.as_slice()));
        let parts = runs_mut(&mut self.work).chunks_mut(pass.share).zip(copy.chunks_mut(pass.share));
        pass.run(parts, |first, (work, copy)| {
            Arch::new().dispatch(Appending { null, found: &found, work, first, h, copy });
        })
    }

    /// Locks V c; c has eight rows for each of the first panels, and columns in eights.
    pub fn lock(&mut self, c: MatRef<'_, f64>) -> Result<(), EigenError> {
        let (rows, columns) = (c.nrows() / WIDTH, c.ncols() / WIDTH);
        self.locked = self.pool.panels(columns)?;
        let pass = self.pass(rows * columns);
        let mut panels = self.panels.all_mut();
        panels.truncate(rows);
        panels.extend(self.pool.split_mut(&mut self.locked));
        let block = |p: usize, l: usize| -> Block {
            std::array::from_fn(|i| std::array::from_fn(|q| -c[(p * WIDTH + i, l * WIDTH + q)]))
        };
        let steps = (0..columns).flat_map(|l| (0..rows).map(move |p| (l, p)));
        let steps: Vec<_> = steps.map(|(l, p)| (rows + l, p, block(p, l))).collect();
        pass.run(pass.split(panels), |_, mut panels| subtract_products(&mut panels, &steps))
    }

    /// V c, in place of the first panels; c has eight rows per panel, and panels of columns.
    pub fn combine(mut self, c: MatRef<'_, f64>) -> Result<Panels<'a>, EigenError> {
        let pass = self.pass(c.nrows() * c.ncols() / (WIDTH * WIDTH));
        let parts = pass.split(self.panels.all_mut());
        let combination = Combination::new(c);
        pass.run(parts, |_, mut panels| replace_by_product(&mut panels, &combination))?;
        self.panels.truncate(c.ncols() / WIDTH);
        Ok(self.panels)
    }
}
