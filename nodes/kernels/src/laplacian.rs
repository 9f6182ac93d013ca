//! The cotangent Laplacian of a triangle mesh: M v = lambda S v (Hu & Hua 2009, eq. 7 to 10).
//!
//! M is the stiffness matrix, positive semidefinite: M(i,j) = -(cot a + cot b) / 2 for an edge with opposite angles a and b, and the
//! diagonal makes rows sum to zero. S is diagonal and holds an area per vertex, either Meyer's mixed Voronoi area or a third of the
//! incident triangles. With `intrinsic_delaunay` both come from the intrinsic Delaunay triangulation of the same surface (Bobenko &
//! Springborn 2007), whose edge weights are never negative.

mod error;
mod intrinsic_delaunay;
mod triangle;

pub use error::LaplacianError;
pub(crate) use intrinsic_delaunay::flip_to_delaunay;
pub(crate) use triangle::Triangle;
pub use triangle::is_zero_area;

use crate::adjacency::opposite_sides;
use crate::sparse::SymmetricCsr;
use crate::stop::{NEVER, Pace, Stop};

/// How a triangle's area is shared among its corners; both ways sum to the surface's area.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Area {
    /// Meyer's mixed area: the Voronoi cell in a triangle without an obtuse angle; else half of the triangle goes to the obtuse corner and
    /// a quarter to each of the others, so that no area is negative.
    #[default]
    Mixed,
    /// A third of each incident triangle.
    Barycentric,
}

/// The generalised eigenproblem M v = lambda S v of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Operator {
    /// M, positive semidefinite, n x n; dimensionless. Exactly symmetric, rows summing to zero.
    pub stiffness: SymmetricCsr,
    /// The diagonal of S, n positive areas in squared units of length. Their sum is the surface's area.
    pub mass: Vec<f64>,
}

impl Operator {
    /// The surface's area, the sum of the masses.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.mass.iter().sum()
    }
}

/// The Laplacian of a mesh given by vertex positions.
///
/// Every face must have three different vertices and a positive area (see [`is_zero_area`]), every vertex a face. Edges with three or more faces
/// are fine here, unless `intrinsic_delaunay` is set, which needs a manifold, orientable (not necessarily consistently oriented) mesh.
pub fn laplacian(
    vertices: &[[f64; 3]],
    faces: &[[u32; 3]],
    area: Area,
    intrinsic_delaunay: bool,
) -> Result<Operator, LaplacianError> {
    laplacian_until(vertices, faces, area, intrinsic_delaunay, NEVER)
}

/// The same, until `stop`.
pub fn laplacian_until(
    vertices: &[[f64; 3]],
    faces: &[[u32; 3]],
    area: Area,
    intrinsic_delaunay: bool,
    stop: Stop,
) -> Result<Operator, LaplacianError> {
    check_indices(vertices.len(), faces)?;
    if let Some(vertex) = vertices.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        return Err(LaplacianError::NonFinite { vertex });
    }
    for (face, &[a, b, c]) in faces.iter().enumerate() {
        if a == b || b == c || c == a {
            return Err(LaplacianError::RepeatedVertex { face });
        }
    }
    let triangle = |face: usize| Triangle::from_points(faces[face].map(|v| vertices[v as usize]));
    if intrinsic_delaunay {
        let lengths = measure(faces, triangle, stop).map(|t| Ok(t?.squared.map(f64::sqrt)));
        let lengths: Vec<[f64; 3]> = lengths.collect::<Result<_, LaplacianError>>()?;
        // Checked before the flips: they keep every vertex that has a face, and an orphan would otherwise be blamed on them.
        check_referenced(vertices.len(), faces)?;
        return delaunay_operator(vertices.len(), faces, &lengths, area, stop);
    }
    assemble(vertices.len(), faces, triangle, area, stop)
}

/// The Laplacian of an intrinsic triangulation: no positions, only edge lengths.
///
/// `lengths[f][i]` is the length of the edge of face `f` opposite its corner `i`. Faces may share vertices in ways that no mesh in space could,
/// such as a face with a repeated vertex on a coarse flat torus (but not with `intrinsic_delaunay`, which must tell edges by their ends).
pub fn laplacian_from_lengths(
    vertex_count: usize,
    faces: &[[u32; 3]],
    lengths: &[[f64; 3]],
    area: Area,
    intrinsic_delaunay: bool,
) -> Result<Operator, LaplacianError> {
    if lengths.len() != faces.len() {
        return Err(LaplacianError::LengthCount { faces: faces.len(), lengths: lengths.len() });
    }
    check_indices(vertex_count, faces)?;
    let triangle = |face: usize| Triangle::from_lengths(lengths[face]);
    if intrinsic_delaunay {
        measure(faces, triangle, NEVER).try_for_each(|t| t.map(|_| ()))?;
        check_referenced(vertex_count, faces)?;
        return delaunay_operator(vertex_count, faces, lengths, area, NEVER);
    }
    assemble(vertex_count, faces, triangle, area, NEVER)
}

fn delaunay_operator(
    n: usize,
    faces: &[[u32; 3]],
    lengths: &[[f64; 3]],
    area: Area,
    stop: Stop,
) -> Result<Operator, LaplacianError> {
    let (faces, lengths) = intrinsic_delaunay::flip_to_delaunay(faces, lengths, stop)?;
    assemble(n, &faces, |face| Triangle::from_lengths(lengths[face]), area, stop)
}

fn measure(
    faces: &[[u32; 3]],
    triangle: impl Fn(usize) -> Option<Triangle>,
    stop: Stop,
) -> impl Iterator<Item = Result<Triangle, LaplacianError>> {
    let pace = Pace::new(stop, 8192);
    (0..faces.len()).map(move |face| {
        if pace.ends() {
            return Err(LaplacianError::Cancelled);
        }
        triangle(face).ok_or(LaplacianError::ZeroAreaFace { face })
    })
}

fn check_indices(n: usize, faces: &[[u32; 3]]) -> Result<(), LaplacianError> {
    if faces.is_empty() {
        return Err(LaplacianError::Empty);
    }
    // u32::MAX itself and the count of half-edges serve as markers and indices.
    if n >= u32::MAX as usize || faces.len() >= u32::MAX as usize / 3 {
        return Err(LaplacianError::TooLarge);
    }
    for (face, corners) in faces.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= n) {
            return Err(LaplacianError::IndexOutOfRange { face, vertex });
        }
    }
    Ok(())
}

fn check_referenced(n: usize, faces: &[[u32; 3]]) -> Result<(), LaplacianError> {
    let mut seen = vec![false; n];
    faces.iter().flatten().for_each(|&v| seen[v as usize] = true);
    match seen.iter().position(|s| !s) {
        Some(vertex) => Err(LaplacianError::UnreferencedVertex { vertex }),
        None => Ok(()),
    }
}

fn assemble(
    n: usize,
    faces: &[[u32; 3]],
    triangle: impl Fn(usize) -> Option<Triangle>,
    area: Area,
    stop: Stop,
) -> Result<Operator, LaplacianError> {
    let mut weights = Vec::with_capacity(3 * faces.len());
    let mut mass = vec![0.0; n];
    for (corners, triangle) in faces.iter().zip(measure(faces, triangle, stop)) {
        let triangle = triangle?;
        let shares = match area {
            Area::Mixed => triangle.mixed_areas(),
            Area::Barycentric => [triangle.area / 3.0; 3],
        };
        for i in 0..3 {
            weights.push(0.5 * triangle.cotangents[i]);
            mass[corners[i] as usize] += shares[i];
        }
    }
    check_referenced(n, faces)?;
    if let Some(vertex) = mass.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(LaplacianError::NotPositive { vertex }); // areas that under- or overflow
    }
    if stop() {
        return Err(LaplacianError::Cancelled);
    }
    Ok(Operator { stiffness: SymmetricCsr::graph_laplacian(n, opposite_sides(faces), &weights), mass })
}
