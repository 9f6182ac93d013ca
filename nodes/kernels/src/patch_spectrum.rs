//! The spectrum of a patch glued to its mirror copy (Hu & Hua 2009, section 4.1), without gluing.
//!
//! The doubled patch is a closed surface with a mirror symmetry. Its eigenfunctions are even or odd under it: the even ones are the
//! patch's Neumann eigenfunctions (boundary vertices get the stiffness and the mass of both copies, which cancels), the odd ones vanish on
//! the boundary and are its Dirichlet eigenfunctions. The spectrum is the sorted union, from two problems of half the size.

// Code compiled for wider vector instructions must be inlined into what chooses them.
#![expect(clippy::inline_always, reason = "vectorised kernels")]

mod bisection;
mod factor;
mod lanczos;
mod memory;
mod panel;
mod problem;
mod solve;
mod sparse;
mod tridiagonal;

use crate::adjacency::on_rim;
use crate::eigen::Hooks;
use crate::laplacian::{Area, LaplacianError, Operator, laplacian};
use crate::sturm::Tridiagonal;
use problem::Problem;
use std::fmt;

/// How a patch spectrum is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchOptions {
    /// How triangle areas are shared among vertices.
    pub area: Area,
    /// Whether the patch is retriangulated intrinsically first; its boundary edges stay, so that the mirror symmetry does.
    pub intrinsic_delaunay: bool,
    /// Up to this many vertices a dense solver is used.
    pub dense_limit: usize,
}

impl Default for PatchOptions {
    fn default() -> Self {
        Self { area: Area::Mixed, intrinsic_delaunay: false, dense_limit: 150 }
    }
}

/// The first nonzero eigenvalues of a closed surface made of a patch.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchSpectrum {
    /// `lambda_1..=lambda_count` in inverse squared length, ascending, positive, with multiplicity.
    pub values: Vec<f64>,
    /// Whether the patch was doubled; false if it has no boundary and so is closed already.
    pub doubled: bool,
    /// Area of the patch.
    pub patch_area: f64,
    /// Area of the closed surface that has this spectrum: twice the patch's if doubled.
    pub closed_area: f64,
}

/// Why a patch has no such spectrum.
#[derive(Clone, Debug, PartialEq)]
pub enum PatchError {
    /// No eigenvalues were asked for.
    NoneWanted,
    /// The closed surface has fewer nonzero eigenvalues than asked for.
    TooFew {
        /// Values asked for.
        wanted: usize,
        /// Values it has.
        available: usize,
    },
    /// The patch is not in one piece.
    Disconnected {
        /// The number of pieces.
        components: usize,
    },
    /// The patch has no Laplacian.
    Laplacian(LaplacianError),
    /// The values could not be certified: their number below a cut differs from the count by inertia, or they are not accurate. They
    /// are not returned.
    NotCertified,
    /// Memory ran out.
    Memory,
    /// The caller's hooks said to stop.
    Cancelled,
}

impl fmt::Display for PatchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoneWanted => write!(f, "at least one eigenvalue must be asked for"),
            Self::TooFew { wanted, available } => {
                write!(f, "{wanted} nonzero eigenvalues were asked for, but the closed patch has only {available}")
            }
            Self::Disconnected { components } => write!(f, "the patch is in {components} pieces"),
            Self::Laplacian(error) => write!(f, "the patch has no Laplacian: {error}"),
            Self::NotCertified => write!(f, "the patch's eigenvalues could not be certified"),
            Self::Memory => write!(f, "memory ran out for the patch's eigenvalues"),
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

impl std::error::Error for PatchError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Laplacian(error) => Some(error),
            _ => None,
        }
    }
}

impl From<LaplacianError> for PatchError {
    fn from(error: LaplacianError) -> Self {
        Self::Laplacian(error)
    }
}

/// The first `count` nonzero eigenvalues of the patch glued to its mirror copy along its boundary, or of the patch itself if it has none.
///
/// The patch is connected, its vertices all in use. Its boundary is the edges with exactly one face.
pub fn patch_spectrum(
    vertices: &[[f64; 3]],
    faces: &[[u32; 3]],
    count: usize,
    options: &PatchOptions,
    hooks: &dyn Hooks,
) -> Result<PatchSpectrum, PatchError> {
    if count == 0 {
        return Err(PatchError::NoneWanted);
    }
    if hooks.cancelled() {
        return Err(PatchError::Cancelled);
    }
    let operator = laplacian(vertices, faces, options.area, options.intrinsic_delaunay)?;
    let (components, _) = operator.stiffness.components();
    if components != 1 {
        return Err(PatchError::Disconnected { components });
    }
    let n = vertices.len();
    let rim = on_rim(n, faces);
    let inner = rim.iter().filter(|on_rim| !**on_rim).count();
    let doubled = inner < n;
    let available = n - 1 + if doubled { inner } else { 0 };
    if available < count {
        return Err(PatchError::TooFew { wanted: count, available });
    }
    let patch_area = operator.area();
    let mut values = scaled_values(&operator, &rim, count, options, hooks)?;
    for value in &mut values {
        *value /= patch_area;
    }
    Ok(PatchSpectrum { values, doubled, patch_area, closed_area: if doubled { 2.0 * patch_area } else { patch_area } })
}

/// Past this many vertices a dense solver takes too long and too much memory to be the last resort.
const DENSE_AT_MOST: usize = 3000;

/// The values of the patch scaled to unit area.
fn scaled_values(
    operator: &Operator,
    rim: &[bool],
    count: usize,
    options: &PatchOptions,
    hooks: &dyn Hooks,
) -> Result<Vec<f64>, PatchError> {
    let n = operator.mass.len();
    let on_rim = rim.iter().filter(|on_rim| **on_rim).count();
    let unknowns = if on_rim == 0 { n } else { 2 * n - on_rim };
    // With most of the spectrum wanted, Lanczos would make bases as large as the matrices.
    if (n <= options.dense_limit || 5 * count > unknowns)
        && let Some(values) = dense_values(&Problem::in_any_order(operator, rim), count)?
    {
        return Ok(values);
    }
    let problems = problem::problems(operator, rim).ok_or(PatchError::Memory)?;
    let found = memory::with(|memory| {
        for (seed, attempt) in [sparse::lowest::<4>, sparse::lowest::<8>].into_iter().enumerate() {
            if let Some(values) = attempt(&problems, count, seed as u64, memory, hooks)? {
                return Ok(Some(values));
            }
        }
        Ok::<_, PatchError>(None)
    })?;
    if let Some(values) = found {
        return Ok(values);
    }
    if n > DENSE_AT_MOST {
        return Err(PatchError::NotCertified);
    }
    dense_values(&Problem::in_any_order(operator, rim), count)?.ok_or(PatchError::NotCertified)
}

/// About where the value of this number is, by Weyl's law for the closed surface: of area 2 if there are two problems, else 1.
fn expected(problems: usize, count: usize) -> f64 {
    4.0 * std::f64::consts::PI * count as f64 / problems as f64
}

/// Accepted effect of rounding on the values of the dense solver, relative to the lowest: slivers have more.
const DENSE_ROUNDING: f64 = 1e-8;

/// The same by complete decompositions; nothing if rounding may be in the values.
fn dense_values(problems: &[Problem], count: usize) -> Result<Option<Vec<f64>>, PatchError> {
    let reduced = |problem: &Problem| {
        let (diagonal, off) = tridiagonal::reduce(&mut problem.dense(), problem.n(), &mut []);
        (Tridiagonal::new(&diagonal, &off), usize::from(problem.has_null))
    };
    let all: Vec<(Tridiagonal, usize)> = problems.iter().map(reduced).collect();
    let values = bisection::lowest(&all, count, expected(problems.len(), count)).ok_or(PatchError::NotCertified)?;
    let rounding = f64::EPSILON * problems.iter().map(Problem::norm).fold(0.0, f64::max);
    Ok(values.first().is_some_and(|&lowest| rounding <= DENSE_ROUNDING * lowest).then_some(values))
}
