//! The spectrum of a patch glued to its mirror copy (Hu & Hua 2009, section 4.1), without gluing.
//!
//! The doubled patch is a closed surface with a mirror symmetry. Its eigenfunctions are even or odd under it: the even ones are the
//! patch's Neumann eigenfunctions (boundary vertices get the stiffness and the mass of both copies, which cancels), the odd ones vanish on
//! the boundary and are its Dirichlet eigenfunctions. The spectrum is the sorted union, from two problems of half the size.

use crate::eigen::{EigenError, Hooks, Kernel, Options, Problem, dense_values, solve};
use crate::laplacian::{Area, LaplacianError, Operator, laplacian};
use std::fmt;

/// How a patch spectrum is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchOptions {
    /// How triangle areas are shared among vertices.
    pub area: Area,
    /// Whether the patch is retriangulated intrinsically first; its boundary edges stay, so that the mirror symmetry does.
    pub intrinsic_delaunay: bool,
    /// Up to this many vertices (interior ones for the Dirichlet part) a dense solver is used.
    pub dense_limit: usize,
}

impl Default for PatchOptions {
    fn default() -> Self {
        Self { area: Area::Mixed, intrinsic_delaunay: false, dense_limit: 450 }
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
    /// The eigensolver failed.
    Eigen(EigenError),
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
            Self::Eigen(error) => write!(f, "the patch's spectrum failed: {error}"),
        }
    }
}

impl std::error::Error for PatchError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Laplacian(error) => Some(error),
            Self::Eigen(error) => Some(error),
            _ => None,
        }
    }
}

impl From<LaplacianError> for PatchError {
    fn from(error: LaplacianError) -> Self {
        Self::Laplacian(error)
    }
}

impl From<EigenError> for PatchError {
    fn from(error: EigenError) -> Self {
        Self::Eigen(error)
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
    let operator = laplacian(vertices, faces, options.area, options.intrinsic_delaunay)?;
    let kernel = Kernel::of_components(&operator.stiffness)?;
    if kernel.count() != 1 {
        return Err(PatchError::Disconnected { components: kernel.count() });
    }
    let interior = interior_vertices(vertices.len(), faces);
    let doubled = interior.len() < vertices.len();
    let mut available = vertices.len() - 1;
    let mut parts = vec![Part { operator: &operator, kernel: 1 }];
    let restricted;
    if doubled {
        available += interior.len();
        restricted = Operator {
            stiffness: operator.stiffness.principal_submatrix(&interior),
            mass: interior.iter().map(|&i| operator.mass[i as usize]).collect(),
        };
        if !interior.is_empty() {
            parts.push(Part { operator: &restricted, kernel: 0 });
        }
    }
    if available < count {
        return Err(PatchError::TooFew { wanted: count, available });
    }
    let values = merged(&parts, count, options, hooks)?;
    let patch_area = operator.area();
    Ok(PatchSpectrum { values, doubled, patch_area, closed_area: if doubled { 2.0 * patch_area } else { patch_area } })
}

/// One of the two problems: Neumann, with the constants as its kernel of dimension 1, or Dirichlet, with none.
struct Part<'a> {
    operator: &'a Operator,
    kernel: usize,
}

impl Part<'_> {
    fn n(&self) -> usize {
        self.operator.mass.len()
    }

    /// At least the first `want` positive eigenvalues, or all there are; and whether they are all.
    fn values(&self, want: usize, options: &PatchOptions, hooks: &dyn Hooks) -> Result<(Vec<f64>, bool), EigenError> {
        if hooks.cancelled() {
            return Err(EigenError::Cancelled);
        }
        let stiffness = &self.operator.stiffness;
        let kernel = if self.kernel == 1 { Some(Kernel::of_components(stiffness)?) } else { None };
        let problem = Problem::new(stiffness, &self.operator.mass, kernel)?;
        if self.n() <= options.dense_limit {
            return Ok((dense_values(&problem)?, true));
        }
        let k = (want + self.kernel).min(self.n());
        let solver = Options { dense_limit: options.dense_limit, ..Options::default() };
        let pairs = solve(&problem, k, &solver, hooks)?;
        Ok((pairs.values[self.kernel..].to_vec(), k == self.n()))
    }
}

/// The `count` smallest values of the union of the parts.
fn merged(parts: &[Part<'_>], count: usize, options: &PatchOptions, hooks: &dyn Hooks) -> Result<Vec<f64>, EigenError> {
    // By Weyl's law each part has about its share of the values; more are computed if that was too few.
    let mut want = count.div_ceil(parts.len()) + count / 8 + 4 * (parts.len() - 1);
    loop {
        let spectra = parts.iter().map(|p| p.values(want, options, hooks)).collect::<Result<Vec<_>, _>>()?;
        let mut union: Vec<f64> = spectra.iter().flat_map(|s| s.0.iter().copied()).collect();
        union.sort_by(f64::total_cmp);
        union.truncate(count);
        // A part's list must reach the end of the union, or be complete: else it may lack values.
        let reaches = |values: &[f64]| match (values.last(), union.last()) {
            (Some(last), Some(end)) => last >= end,
            _ => false,
        };
        if union.len() == count && spectra.iter().all(|(values, all)| *all || reaches(values)) {
            return Ok(union);
        }
        want += want.div_ceil(2);
    }
}

/// Vertices on no edge that has exactly one face, ascending.
fn interior_vertices(n: usize, faces: &[[u32; 3]]) -> Vec<u32> {
    let mut edges: Vec<(u32, u32)> = faces
        .iter()
        .flat_map(|&[a, b, c]| [(a.min(b), a.max(b)), (b.min(c), b.max(c)), (c.min(a), c.max(a))])
        .collect();
    edges.sort_unstable();
    let mut inside = vec![true; n];
    for group in edges.chunk_by(|x, y| x == y) {
        if let [(a, b)] = *group {
            inside[a as usize] = false;
            inside[b as usize] = false;
        }
    }
    (0..n as u32).filter(|&v| inside[v as usize]).collect()
}
