//! Sparse LDL' factorisations of A - shift I: solves, and eigenvalue counts by inertia.

use super::packed::{Packed, Shape};
use super::parts::{collect, locked};
use super::problem::Problem;
use super::spare::Spare;
use super::{EigenError, Hooks};
use crate::multifrontal::{Branch, Elimination, Fronts, Keep, Lower, Shifted, Symbolic};
use crate::sparse::SymmetricCsr;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// Merging small supernodes costs some fill and pays in every solve; measured on meshes of 1,000 to 170,000 vertices.
const RELAXED: [(usize, f64); 4] = [(8, 0.7), (16, 0.2), (48, 0.05), (usize::MAX, 0.02)];

/// Branches of the elimination tree have at most this share of all work, so that threads finish at about the same time.
const SHARE: f64 = 0.12;

/// Factorisations that take less than so many nanoseconds are not worth threads.
const LEAST: f64 = 2e5;

/// A shift below the spectrum, by about the mean distance of eigenvalues: there A - shift I is positive definite, and its factorisation as accurate as
/// can be.
pub(super) const BELOW: f64 = -4.0 * PI;

/// Ordering and fill, for which the numbers of a matrix do not matter.
pub(super) struct Pattern {
    elimination: Elimination,
    shape: Shape,
    branches: Vec<Range<usize>>,
}

impl Pattern {
    /// By minimum degree; nothing if memory ran out.
    pub fn new(stiffness: &SymmetricCsr) -> Option<Self> {
        let elimination = Elimination::minimum_degree(stiffness)?;
        let symbolic = Symbolic::new(&elimination, &RELAXED);
        let branches = symbolic.branches(SHARE, LEAST);
        Some(Self { elimination, shape: Shape::new(symbolic), branches })
    }
}

/// The part of a factorisation that all shifts share.
pub(super) struct Factorizer {
    order: Vec<u32>,
    lower: Lower,
    shape: Arc<Shape>,
    /// What threads can do at the same time.
    branches: Vec<Range<usize>>,
    area: f64,
    /// Memory of fronts, and of what branches leave.
    fronts: Spare<Fronts>,
    left: Spare<Branch>,
}

impl Factorizer {
    pub fn new(problem: &Problem<'_>, pattern: Pattern) -> Self {
        let Pattern { elimination, shape, branches } = pattern;
        let roots: Vec<f64> = elimination.order.iter().map(|&row| problem.root[row as usize]).collect();
        let lower = Lower::scaled(problem.stiffness, &elimination, &roots);
        Self {
            order: elimination.order,
            lower,
            shape: Arc::new(shape),
            branches,
            area: problem.area,
            fronts: Spare::new(),
            left: Spare::new(),
        }
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
        packed.invert(pivots);
        Ok(packed)
    }

    /// Gives memory that is kept for the next factorisation back to the allocator.
    pub fn release(&self) {
        self.fronts.clear();
        self.left.clear();
        self.shape.release();
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
            let keep = &mut *locked(&own[i]);
            let memory = self.left.take().unwrap_or_default();
            self.with_fronts(|fronts| fronts.branch(&matrix, self.branches[i].clone(), keep, memory))
        })?;
        let Some(branches) = branches.into_iter().collect::<Option<Vec<Branch>>>() else { return Ok(None) };
        let all = |fronts: &mut Fronts| fronts.join(&matrix, &branches, &mut rest).map(|_| fronts.pivots.clone());
        let pivots = self.with_fronts(all);
        for branch in branches {
            self.left.give(branch);
        }
        Ok(pivots)
    }

    fn with_fronts<T>(&self, f: impl FnOnce(&mut Fronts) -> T) -> T {
        let mut fronts = self.fronts.take().unwrap_or_default();
        let result = f(&mut fronts);
        self.fronts.give(fronts);
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eigen::packed::tests::sheet;
    use crate::laplacian::Operator;
    use crate::random::Random;
    use crate::sparse::SymmetricCsr;

    impl Factorizer {
        pub(in crate::eigen) fn of(problem: &Problem<'_>) -> Self {
            Self::new(problem, Pattern::new(problem.stiffness).expect("small"))
        }
    }

    /// Each task on a thread of its own, the last one first.
    struct Threads;

    impl Hooks for Threads {
        fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
            std::thread::scope(|scope| (0..count).rev().for_each(|i| drop(scope.spawn(move || task(i)))));
        }
    }

    /// Leaves out the last task.
    struct Stopped;

    impl Hooks for Stopped {
        fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
            (1..count).for_each(|i| task(i - 1));
        }
    }

    #[test]
    fn threads_change_no_bit_and_what_is_left_out_is_told() {
        let operator = sheet(130, 110);
        let problem = Problem::of(&operator);
        let factorizer = Factorizer::of(&problem);
        assert!(factorizer.branches.len() > 4, "worth threads");
        let shift = 500.0;
        let mut random = Random::new(&[2]);
        let right: Vec<[f64; 8]> = (0..problem.n()).map(|_| std::array::from_fn(|_| random.signed())).collect();
        let solved = |hooks: &dyn Hooks| {
            let (packed, mut x) = (factorizer.factor(shift, hooks).expect("not singular"), right.clone());
            packed.solve(hooks, &mut x).expect("not cancelled");
            (packed.negative(), x)
        };
        let (below, x) = solved(&());
        // Weyl's law.
        assert!((30..50).contains(&below), "{below}");
        assert!(solved(&Threads) == (below, x));
        assert_eq!(factorizer.count_below(shift, 0.0, &()), Ok(below));
        assert_eq!(factorizer.count_below(shift, 0.0, &Threads), Ok(below));
        assert_eq!(factorizer.count_below(shift, 0.0, &Stopped), Err(EigenError::Cancelled));
    }

    #[test]
    fn counts_avoid_shifts_that_break_down() {
        // An isolated vertex and a path, whose ends have pivots of one times the scale minus the shift.
        let stiffness = SymmetricCsr::graph_laplacian(5, [(1, 2), (2, 3), (3, 4)].into_iter(), &[1.0; 3]);
        let operator = Operator { stiffness, mass: vec![1.0; 5] };
        let factorizer = Factorizer::of(&Problem::of(&operator));
        let end = factorizer.order.iter().position(|&v| v == 1 || v == 4).expect("all are in it");
        let shift = factorizer.lower.diagonal[end];
        assert!((shift - 5.0).abs() < 1e-12 && factorizer.factor(shift, &()).is_err());
        // Twice 0, and 5 (2 - 2 cos (pi / 4)); the next is 10.
        assert_eq!(factorizer.count_below(shift, 0.01, &()), Ok(3));
        assert_eq!(factorizer.count_below(0.0, 0.01, &()), Err(EigenError::Factorisation { shift: 0.0 }));
    }
}
