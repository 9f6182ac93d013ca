//! Sparse LDL' factorisations of A - shift I: solves, and eigenvalue counts by inertia.

use super::certify::collect;
use super::packed::{Packed, Shape};
use super::problem::Problem;
use super::spare::Spare;
use super::{EigenError, Hooks};
use crate::multifrontal::{Branch, Elimination, Fronts, Keep, Lower, Shifted, Symbolic};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Merging small supernodes costs some fill and pays in every solve; measured on meshes of 1,000 to 170,000 vertices.
const RELAXED: [(usize, f64); 4] = [(4, 0.5), (16, 0.2), (48, 0.05), (usize::MAX, 0.02)];

/// Branches of the elimination tree have at most this share of all work, so that threads finish at about the same time.
const SHARE: f64 = 0.12;

/// Factorisations that take less than so many nanoseconds are not worth threads.
const LEAST: f64 = 8e5;

/// The part of a factorisation that all shifts share: ordering and fill.
pub(super) struct Factorizer {
    order: Vec<u32>,
    lower: Lower,
    shape: Arc<Shape>,
    /// What threads can do at the same time.
    branches: Vec<Range<usize>>,
    area: f64,
    /// Memory of fronts.
    fronts: Spare<Fronts>,
}

impl Factorizer {
    pub fn new(problem: &Problem<'_>) -> Result<Self, EigenError> {
        let matrix = problem.stiffness;
        let elimination = Elimination::minimum_degree(matrix).ok_or(EigenError::Memory)?;
        let roots: Vec<f64> = elimination.order.iter().map(|&row| problem.root[row as usize]).collect();
        let lower = Lower::scaled(matrix, &elimination, &roots);
        let symbolic = Symbolic::new(&elimination, &RELAXED);
        let branches = symbolic.branches(SHARE, LEAST);
        let shape = Arc::new(Shape::new(symbolic));
        Ok(Self { order: elimination.order, lower, shape, branches, area: problem.area, fronts: Spare::new() })
    }

    /// The vertex that is eliminated at each step.
    pub fn order(&self) -> Vec<u32> {
        self.order.clone()
    }

    /// The factorisation of A - shift I, without pivoting: backward stable here unless the shift is very near an eigenvalue of a leading
    /// block, which residuals and counts would show.
    pub fn factor(&self, shift: f64, hooks: &dyn Hooks) -> Result<Packed, EigenError> {
        let mut packed = Packed::new(&self.shape);
        let (own, rest) = packed.pieces(&self.branches);
        let pivots =
            self.pivots(shift, hooks, own, rest)?.ok_or(EigenError::Factorisation { shift: shift / self.area })?;
        packed.invert(&pivots);
        Ok(packed)
    }

    /// The number of eigenvalues of A below `cut`: by Sylvester's law the number of negative pivots of A - cut I.
    ///
    /// A factorisation that breaks down is tried again at nearby cuts, which the caller places in a gap of this relative width.
    pub fn count_below(&self, cut: f64, gap: f64, hooks: &dyn Hooks) -> Result<usize, EigenError> {
        for nudge in [0.0, 0.11, -0.13, 0.23] {
            let shift = cut * (1.0 + nudge * gap);
            if let Some(pivots) = self.pivots(shift, hooks, vec![(); self.branches.len()], ())? {
                return Ok(pivots.iter().filter(|p| **p < 0.0).count());
            }
        }
        Err(EigenError::Factorisation { shift: cut / self.area })
    }

    /// The diagonal of D; `None` if it breaks down. `own` take L's supernodes of each branch, `rest` those of what is above.
    fn pivots<K: Keep + Send>(
        &self,
        shift: f64,
        hooks: &dyn Hooks,
        own: Vec<K>,
        mut rest: K,
    ) -> Result<Option<Vec<f64>>, EigenError> {
        let matrix = Shifted { symbolic: self.shape.symbolic(), lower: &self.lower, shift };
        let own: Vec<Mutex<K>> = own.into_iter().map(Mutex::new).collect();
        let branches = collect(hooks, own.len(), &|i| {
            let keep = &mut *own[i].lock().unwrap_or_else(PoisonError::into_inner);
            self.with_fronts(|fronts| fronts.branch(&matrix, self.branches[i].clone(), keep))
        })?;
        let Some(branches) = branches.into_iter().collect::<Option<Vec<Branch>>>() else { return Ok(None) };
        let all = |fronts: &mut Fronts| fronts.join(&matrix, &branches, &mut rest).map(|_| fronts.pivots.clone());
        Ok(self.with_fronts(all))
    }

    fn with_fronts<T>(&self, f: impl FnOnce(&mut Fronts) -> T) -> T {
        let mut fronts = self.fronts.take().unwrap_or_default();
        let result = f(&mut fronts);
        self.fronts.give(fronts);
        result
    }
}
