//! The smallest eigenpairs of M v = lambda S v, certified (Hu & Hua 2009, eq. 10).
//!
//! With y = S^1/2 v the problem is A y = lambda y, A = S^-1/2 M S^-1/2, solved by block Lanczos on (A - sigma I)^-1, a sparse LDL' factorisation, or
//! by a dense solver when the matrix is small or most of its spectrum is wanted. Neither is believed: the pairs are accepted only if
//! residuals and orthogonality are small *and* the number of eigenvalues below a cut just above the last wanted one, counted by
//! Sylvester's law of inertia from another factorisation, equals the number found. A missed copy of a multiple eigenvalue thus cannot pass.

mod band;
mod basis;
mod certify;
mod cut;
mod dense;
mod departure;
mod factor;
mod gauge;
mod lanczos;
mod packed;
mod panel;
mod parts;
mod passes;
mod pool;
mod problem;
mod projected;
mod quality;
mod reach;
mod rows;
mod scratch;
mod slices;
mod slicing;
mod solver;
mod spare;
mod supernode;
mod tiles;
mod tree;
mod twisted;
mod vectors;

use crate::freed;
use crate::laplacian::Operator;
use solver::solve;
use std::fmt;
use std::fs::File;
use std::io;

/// What a caller may want of a long computation: to see how far it is, to stop it, and to lend it threads.
pub trait Hooks: Sync {
    /// Called with the share of the work done, in \[0, 1\], not decreasing.
    fn progress(&self, _fraction: f64) {}
    /// Polled before each phase, so several times per Lanczos block; once true, the computation ends with [`EigenError::Cancelled`].
    fn cancelled(&self) -> bool {
        false
    }
    /// Runs `task(0)` to `task(count - 1)`, each once, in any order and on any threads, and returns when all are done. Results do not depend on how.
    /// Tasks may call it themselves: threads that are at work already had better not be counted on then.
    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).for_each(task);
    }
    /// An empty file that nobody else uses, to be read and written, and gone once it is closed: for what is not needed for a while of a result so large that it and the
    /// work on it had better not be in memory at once. Asked for more than one at a time. Without them all is kept in memory; results do not depend on it.
    fn scratch(&self) -> io::Result<Option<File>> {
        Ok(None)
    }
    /// What the calling thread does from now on; for measuring.
    fn phase(&self, _phase: Phase) {}
}

/// Where time goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Ordering for small fill, and the symbolic factorisation.
    Order,
    /// Numeric factorisation at a shift.
    Factorise,
    /// Solves with the factor.
    Solve,
    /// Orthogonalisation of a block.
    Orthogonalise,
    /// The projected eigenproblem, or the whole one if it is solved densely.
    Projected,
    /// Ritz vectors.
    Vectors,
    /// The count by inertia.
    Count,
    /// Orthogonality, residuals, and conversion to the caller's order and units.
    Certify,
}

/// No interest in either.
impl Hooks for () {}

/// Begins a phase, unless the computation was cancelled.
fn enter(hooks: &dyn Hooks, phase: Phase) -> Result<(), EigenError> {
    if hooks.cancelled() {
        return Err(EigenError::Cancelled);
    }
    hooks.phase(phase);
    Ok(())
}

/// How the eigensolver works; the defaults suit meshes of 10 to 200,000 vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Largest accepted residual `||M v - lambda S v||` in the `S^-1` norm, relative to lambda, in (0, 1e-2]. Where the rounding of the entries of
    /// M alone exceeds it (slivers), that rounding error is the bound.
    pub tolerance: f64,
    /// Up to this many vertices the dense solver is used.
    pub dense_limit: usize,
    /// Results of more numbers (vertices times pairs) are found in smaller slices, one after the other, and what is done of them waits in files that
    /// [`Hooks::scratch`] gives. That takes 520 MB instead of 962 at 172,962 vertices and 300 pairs, and a tenth more time.
    pub in_memory: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { tolerance: 1e-8, dense_limit: 200, in_memory: 12_000_000 }
    }
}

/// Which solver found the pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// A full symmetric eigendecomposition.
    Dense,
    /// Shift-invert block Lanczos.
    Lanczos,
}

/// The evidence that the pairs are the smallest ones, all of them, and accurate.
#[derive(Clone, Debug, PartialEq)]
pub struct Certificate {
    /// Which solver found the pairs.
    pub method: Method,
    /// The cut in a gap of the spectrum above the last returned eigenvalue, in the units of the eigenvalues.
    pub cut: f64,
    /// Number of eigenvalues below the cut by Sylvester inertia.
    pub expected: usize,
    /// Number of eigenvalues found below the cut; at least the number returned. Equal to `expected`.
    pub found: usize,
    /// Largest `||M v - lambda S v||` in the `S^-1` norm over lambda (for lambda = 0 over the first positive eigenvalue).
    pub max_residual: f64,
    /// Largest entry of |V' S V - I|.
    pub max_orthogonality_error: f64,
    /// Lanczos runs it took; 0 for the dense solver, 1 if nothing was missed.
    pub rounds: usize,
    /// Relative distance from the last returned eigenvalue to the next; `None` if there is no next one. Near zero, the basis ends
    /// inside a multiple eigenvalue, and its last vectors are an arbitrary part of that eigenspace.
    pub gap_above: Option<f64>,
}

/// The k smallest eigenpairs, ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Eigenpairs {
    /// Eigenvalues in inverse squared length, ascending; exactly 0.0 once per connected component.
    pub values: Vec<f64>,
    /// Eigenvectors, column-major n x k: vector j is `vectors[j * n..(j + 1) * n]`. `V' S V = I`.
    ///
    /// The first ones are the indicators of the components over the square root of their areas, ordered by smallest vertex. Signs: the
    /// S-weighted sum of cubes is positive; for vectors whose sum of cubes vanishes (odd symmetry), the first entry of largest
    /// magnitude is. Inside a multiple eigenvalue the basis is some basis, the same in every run.
    pub vectors: Vec<f64>,
    /// Number of vertices.
    pub n: usize,
    /// Why they may be trusted.
    pub certificate: Certificate,
}

impl Eigenpairs {
    /// Eigenvector j.
    #[must_use]
    pub fn vector(&self, j: usize) -> &[f64] {
        &self.vectors[j * self.n..(j + 1) * self.n]
    }
}

/// Why there are no eigenpairs.
#[derive(Clone, Debug, PartialEq)]
pub enum EigenError {
    /// No pairs were asked for.
    NoneWanted,
    /// More pairs were asked for than there are vertices.
    TooMany {
        /// Pairs asked for.
        wanted: usize,
        /// Pairs there are: the number of vertices.
        available: usize,
    },
    /// An option is outside its range.
    Option {
        /// Its name.
        name: &'static str,
    },
    /// The mass has another length than the stiffness matrix has rows.
    MassLength {
        /// Rows of the stiffness matrix.
        rows: usize,
        /// Length of the mass.
        masses: usize,
    },
    /// A mass is not positive and finite, or an entry of the vertex's row is not finite.
    NotFinite {
        /// The offending vertex.
        vertex: usize,
    },
    /// The vertex's row of the stiffness matrix does not sum to zero.
    NotLaplacian {
        /// The offending vertex.
        vertex: usize,
    },
    /// The sparse factorisation at this shift failed, at neighbouring shifts too, or memory ran out.
    Factorisation {
        /// The shift, in the units of the eigenvalues.
        shift: f64,
    },
    /// The dense solver did not converge.
    Dense,
    /// The pairs found could not be certified; they are not returned.
    NotCertified {
        /// Number of eigenvalues below the last cut tried.
        expected: usize,
        /// Number found below it.
        found: usize,
        /// Largest relative residual of the last attempt.
        residual: f64,
    },
    /// Memory ran out.
    Memory,
    /// The scratch file could not be made, written or read.
    Scratch {
        /// The system's reason.
        reason: String,
    },
    /// The Krylov space had no more vectors before the pairs had converged.
    Exhausted,
    /// The caller's hooks said to stop.
    Cancelled,
}

impl EigenError {
    fn scratch(error: &io::Error) -> Self {
        Self::Scratch { reason: error.to_string() }
    }
}

impl fmt::Display for EigenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoneWanted => write!(f, "at least one eigenpair must be asked for"),
            Self::TooMany { wanted, available } => {
                write!(f, "{wanted} eigenpairs were asked for, but {available} vertices have only {available}")
            }
            Self::Option { name } => write!(f, "option `{name}` is out of range"),
            Self::MassLength { rows, masses } => {
                write!(f, "{masses} masses for a stiffness matrix of {rows} rows")
            }
            Self::NotFinite { vertex } => {
                write!(f, "vertex {vertex} has a mass that is not positive, or an entry that is not finite")
            }
            Self::NotLaplacian { vertex } => write!(f, "row {vertex} of the stiffness matrix does not sum to zero"),
            Self::Factorisation { shift } => {
                write!(f, "the sparse factorisation failed at the shift {shift:e}")
            }
            Self::Dense => write!(f, "the dense eigensolver did not converge"),
            Self::NotCertified { expected, found, residual } => write!(
                f,
                "eigenpairs could not be certified: {found} found where inertia counts {expected}, largest relative residual {residual:.1e}"
            ),
            Self::Scratch { reason } => write!(f, "the scratch file for eigenvectors: {reason}"),
            Self::Memory => write!(f, "not enough memory for the Krylov basis"),
            Self::Exhausted => write!(f, "the Krylov space was exhausted before the eigenpairs had converged"),
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

impl std::error::Error for EigenError {}

/// The k smallest eigenpairs of M v = lambda S v, for 1 <= k <= n.
///
/// Values are accurate to about 1e-10 relative or better, independent of the mesh's scale. Any number of components, boundaries and
/// multiple eigenvalues are allowed. The result depends on the operator, k and the options alone.
pub fn eigenpairs(
    operator: &Operator,
    k: usize,
    options: &Options,
    hooks: &dyn Hooks,
) -> Result<Eigenpairs, EigenError> {
    freed::keep();
    solve(operator, k, options, hooks)
}
