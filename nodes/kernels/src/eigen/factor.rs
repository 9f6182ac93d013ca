//! Sparse LDL' factorisations of A - shift I: solves, and eigenvalue counts by inertia.

use super::EigenError;
use super::packed::{Packed, Shape};
use super::problem::Problem;
use super::spare::Spare;
use crate::multifrontal::{Elimination, Fronts, Lower, Symbolic};
use std::sync::Arc;

/// Merging small supernodes costs some fill and pays in every solve; measured on meshes of 1,000 to 170,000 vertices.
const RELAXED: [(usize, f64); 4] = [(4, 0.5), (16, 0.2), (48, 0.05), (usize::MAX, 0.02)];

/// The part of a factorisation that all shifts share: ordering and fill.
pub(super) struct Factorizer {
    order: Vec<u32>,
    lower: Lower,
    shape: Arc<Shape>,
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
        let shape = Arc::new(Shape::new(Symbolic::new(&elimination, &RELAXED)));
        Ok(Self { order: elimination.order, lower, shape, area: problem.area, fronts: Spare::new() })
    }

    /// The vertex that is eliminated at each step.
    pub fn order(&self) -> Vec<u32> {
        self.order.clone()
    }

    /// The factorisation of A - shift I, without pivoting: backward stable here unless the shift is very near an eigenvalue of a leading
    /// block, which residuals and counts would show.
    pub fn factor(&self, shift: f64) -> Result<Packed, EigenError> {
        let mut packed = Packed::new(&self.shape);
        let factored = self.with_fronts(|fronts| {
            let below = fronts.factor(self.shape.symbolic(), &self.lower, shift, &mut packed)?;
            packed.invert(&fronts.pivots);
            Some(below)
        });
        if factored.is_some() { Ok(packed) } else { Err(EigenError::Factorisation { shift: shift / self.area }) }
    }

    fn with_fronts<T>(&self, f: impl FnOnce(&mut Fronts) -> T) -> T {
        let mut fronts = self.fronts.take().unwrap_or_default();
        let result = f(&mut fronts);
        self.fronts.give(fronts);
        result
    }

    /// The number of eigenvalues of A below `cut`: by Sylvester's law the number of negative pivots of A - cut I.
    ///
    /// A factorisation that breaks down is tried again at nearby cuts, which the caller places in a gap of this relative width.
    pub fn count_below(&self, cut: f64, gap: f64) -> Result<usize, EigenError> {
        let count =
            |cut: f64| self.with_fronts(|fronts| fronts.factor(self.shape.symbolic(), &self.lower, cut, &mut ()));
        let mut cuts = [0.0, 0.11, -0.13, 0.23].into_iter().map(|nudge| cut * (1.0 + nudge * gap));
        cuts.find_map(count).ok_or(EigenError::Factorisation { shift: cut / self.area })
    }
}
