//! Procedural articulated creatures in poses, each meshed on its own, with ground truth.
//!
//! A creature is an implicit surface about a skeleton at rest ([`RestSurface`]). A pose moves the bones, and the surface
//! follows by blended rigid motions, so that poses are near-isometric away from joints and limbs that touch never grow
//! together. Each (pose, triangulation) marches its own turned grid and is remeshed in the posed shape: meshes of two poses
//! share no vertex. Every vertex carries its point on the rest surface, which is the correspondence between poses.

mod grid;
mod remesh;
mod skeleton;
mod skin;
mod surface;

pub(crate) use grid::march;
pub use skeleton::Species;
pub(crate) use skin::rotate;
pub use surface::RestSurface;

use crate::adjacency::MeshError;
use crate::nearest::NearestVertex;
use crate::random::Random;
use crate::stop::{NEVER, Stop};
use crate::topology;
use remesh::Remesher;
use std::fmt;

/// Fewest and most vertices a creature can be asked to have. Fewer could not follow ears and tails.
pub const VERTICES: std::ops::RangeInclusive<usize> = 400..=200_000;

/// Which creature, in which pose, meshed how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CreatureParams {
    /// Proportions.
    pub species: Species,
    /// Individual of the species: varies the proportions by up to 12 %.
    pub seed: u64,
    /// Joint angles: 0 is rest, any other number a pose of its own, the same for all species up to collisions.
    pub pose: u32,
    /// Number of vertices, within [`VERTICES`].
    pub vertices: usize,
    /// Grid orientation and offset, on top of those that differ by pose: one shape, other triangulations.
    pub triangulation: u64,
}

impl Default for CreatureParams {
    fn default() -> Self {
        Self { species: Species::Cat, seed: 0, pose: 0, vertices: 2000, triangulation: 0 }
    }
}

/// A meshed creature: a closed manifold of genus 0 in one component.
#[derive(Debug, Clone, PartialEq)]
pub struct Creature {
    /// Posed vertex positions; the torso is about one unit long. x left-right, y up, z forward.
    pub vertices: Vec<[f64; 3]>,
    /// Faces, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// For each vertex the point of the rest surface that it shows: the ground truth.
    pub rest: Vec<[f64; 3]>,
    /// Named places (nose, paws, knees, ...) and the vertex nearest to each, measured at rest.
    pub landmarks: Vec<(&'static str, u32)>,
}

/// Why a creature could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CreatureError {
    /// The number of vertices is out of [`VERTICES`].
    VertexCount(usize),
    /// The mesh did not come out as a closed manifold of genus 0: too few vertices for this shape.
    NotASphere,
    /// The mesh arrays are inconsistent; a defect of this module.
    Mesh(MeshError),
    /// The caller said to stop.
    Cancelled,
}

impl fmt::Display for CreatureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::VertexCount(count) => {
                write!(f, "{count} vertices asked for; a creature has {} to {}", VERTICES.start(), VERTICES.end())
            }
            Self::NotASphere => {
                write!(f, "the creature's mesh is not a closed surface of genus 0; ask for more vertices")
            }
            Self::Mesh(error) => write!(f, "the creature's mesh is inconsistent: {error}"),
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

impl std::error::Error for CreatureError {}

/// Makes a creature. The same parameters give the same bits.
pub fn generate(params: &CreatureParams) -> Result<Creature, CreatureError> {
    generate_until(params, NEVER)
}

/// The same, until `stop`.
pub fn generate_until(params: &CreatureParams, stop: Stop) -> Result<Creature, CreatureError> {
    if !VERTICES.contains(&params.vertices) {
        return Err(CreatureError::VertexCount(params.vertices));
    }
    let surface = RestSurface::new(params.species, params.seed);
    let motions = surface.skeleton.pose(params.pose);
    let mut random =
        Random::new(&[params.seed, params.species as u64, u64::from(params.pose), params.triangulation, 3]);
    let frame = random.frame();
    // Cells about as long as the edges to come, but no longer than the thinnest limb needs.
    let spacing = 2.0 / (params.vertices as f64).sqrt();
    let cell = spacing.min(1.1 * surface.thinnest());
    let (vertices, faces) =
        grid::march(|p| surface.level(p), |p, r| surface.clear(p, r), surface.bounds(), cell, frame, stop);
    let go_on = || if stop() { Err(CreatureError::Cancelled) } else { Ok(()) };
    let mesh = Remesher::new(&surface, &motions, &vertices, &faces, stop).run(params.vertices);
    go_on()?;
    let census = topology::census(&mesh.posed, &mesh.faces).map_err(CreatureError::Mesh)?;
    if !census.is_closed_manifold() || census.euler != [2] {
        return Err(CreatureError::NotASphere);
    }
    go_on()?;
    let nearest = NearestVertex::new(&mesh.rest);
    let landmark =
        |&(name, near): &(&'static str, [f64; 3])| nearest.nearest(surface.project(near)).map(|(v, _)| (name, v));
    let landmarks = surface.skeleton.landmarks.iter().filter_map(landmark).collect();
    Ok(Creature { vertices: mesh.posed, faces: mesh.faces, rest: mesh.rest, landmarks })
}

/// For each vertex of `from` the vertex of `to` that shows nearly the same place: nearest at rest, the lowest index among
/// equals. Both must be poses or triangulations of one individual, and `to` must not be empty.
#[must_use]
pub fn correspondence(from: &Creature, to: &Creature) -> Vec<u32> {
    let tree = NearestVertex::new(&to.rest);
    from.rest.iter().filter_map(|&p| tree.nearest(p).map(|(v, _)| v)).collect()
}

/// For each vertex the vertex nearest to its left-right mirror image at rest: the ground truth of the symmetry.
#[must_use]
pub fn mirror_twins(creature: &Creature) -> Vec<u32> {
    let tree = NearestVertex::new(&creature.rest);
    creature.rest.iter().filter_map(|&[x, y, z]| tree.nearest([-x, y, z]).map(|(v, _)| v)).collect()
}
