//! A database of synthetic objects: 20 families, articulated and rigid, of which every individual has proportions, a pose and details of its own.
//!
//! The families are those that benchmarks of retrieval have: people, cups, chairs, pliers and so on. Unlike [`crate::creature`], an object has no
//! ground truth but its family. It is turned at random, and its triangulation is that of a turned grid, decimated.

mod creatures;
mod solid;
mod things;

use std::fmt;

use crate::adjacency::MeshError;
use crate::creature::{march, rotate};
use crate::random::Random;
use crate::simplify::simplify_until;
use crate::stop::{NEVER, Pace, Stop};
use crate::topology;
use solid::Body;

/// Makes a body of a family.
type Maker = fn(&mut Random) -> Body;

/// The families by name, in order of the alphabet.
const FAMILIES: [(&str, Maker); 20] = [
    ("airplane", things::airplane),
    ("ant", creatures::ant),
    ("armadillo", creatures::armadillo),
    ("bearing", things::bearing),
    ("bird", creatures::bird),
    ("bust", creatures::bust),
    ("chair", things::chair),
    ("cup", things::cup),
    ("fish", creatures::fish),
    ("fourleg", creatures::fourleg),
    ("glasses", things::glasses),
    ("hand", creatures::hand),
    ("human", creatures::human),
    ("mechanic", things::mechanic),
    ("octopus", creatures::octopus),
    ("plier", things::plier),
    ("spring", things::spring),
    ("table", things::table),
    ("teddy", creatures::teddy),
    ("vase", things::vase),
];

/// Names of the families.
#[must_use]
pub fn families() -> [&'static str; 20] {
    FAMILIES.map(|(name, _)| name)
}

/// A closed mesh in one component, in a random orientation and of no particular size.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Positions.
    pub vertices: Vec<[f64; 3]>,
    /// Faces, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

/// Why an object could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObjectError {
    /// No family has this name.
    Unknown,
    /// The mesh arrays are inconsistent; a defect of this module.
    Mesh(MeshError),
    /// It was told to stop.
    Cancelled,
}

impl fmt::Display for ObjectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => write!(f, "no such family; there are {}", families().join(", ")),
            Self::Mesh(error) => write!(f, "the object's mesh is inconsistent: {error}"),
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

impl std::error::Error for ObjectError {}

/// Individual `seed` of a family, with about `vertices` vertices. The same parameters give the same bits.
pub fn generate(family: &str, seed: u64, vertices: usize) -> Result<Object, ObjectError> {
    generate_until(family, seed, vertices, NEVER)
}

/// The same, until `stop`.
pub fn generate_until(family: &str, seed: u64, vertices: usize, stop: Stop) -> Result<Object, ObjectError> {
    let go_on = || if stop() { Err(ObjectError::Cancelled) } else { Ok(()) };
    let found = FAMILIES.iter().position(|(name, _)| *name == family).ok_or(ObjectError::Unknown)?;
    let mut random = Random::new(&[found as u64, seed, 7]);
    let body = FAMILIES[found].1(&mut random);
    let (low, high) = body.bounds();
    // So fine a grid that decimation has something to choose from.
    let rough = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max) / 24.0;
    let frame = random.frame();
    let coarse = mesh(&body, rough, frame, stop);
    go_on()?;
    let area = topology::surface_area(&coarse.0, &coarse.1).map_err(ObjectError::Mesh)?;
    // A cell of the grid is cut into about three triangles where the surface passes.
    let cell = (area / (0.75 * vertices as f64)).sqrt().min(FINEST);
    let (mut points, faces) = mesh(&body, cell, frame, stop);
    let pace = Pace::new(stop, 256);
    for p in points.iter_mut().take_while(|_| !pace.ends()) {
        *p = project(&body, *p, cell);
    }
    go_on()?;
    let whole = topology::largest_component(&points, &faces).map_err(ObjectError::Mesh)?;
    let small = simplify_until(&whole.vertices, &whole.faces, vertices, stop).map_err(ObjectError::Mesh)?;
    go_on()?;
    let (turn, size) = (random.frame().0, 0.5 + 2.0 * random.unit());
    let placed = small.vertices.iter().map(|p| rotate(turn, p.map(|x| size * x)));
    // Vertices in no particular order.
    let order = random.permutation(small.vertices.len());
    let mut object = Object { vertices: vec![[0.0; 3]; order.len()], faces: Vec::new() };
    for (p, to) in placed.zip(&order) {
        object.vertices[*to as usize] = p;
    }
    object.faces = small.faces.iter().map(|f| f.map(|v| order[v as usize])).collect();
    Ok(object)
}

/// A grid of this cell still resolves the walls of vases and the pads of wings.
const FINEST: f64 = 0.03;

/// Newton steps to the surface: the grid leaves points up to a tenth of a cell off, which would show as terraces.
fn project(body: &Body, mut p: [f64; 3], cell: f64) -> [f64; 3] {
    let h = 1e-3 * cell;
    for _ in 0..3 {
        let level = body.level(p);
        let slope: [f64; 3] = std::array::from_fn(|k| {
            let (mut up, mut down) = (p, p);
            (up[k], down[k]) = (p[k] + h, p[k] - h);
            (body.level(up) - body.level(down)) / (2.0 * h)
        });
        let steep = slope.iter().map(|x| x * x).sum::<f64>().max(0.1);
        let step = level.clamp(-0.3 * cell, 0.3 * cell) / steep;
        p = std::array::from_fn(|k| p[k] - step * slope[k]);
    }
    p
}

/// A mesh: its points and faces.
type Raw = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn mesh(body: &Body, cell: f64, frame: ([f64; 4], [f64; 3]), stop: Stop) -> Raw {
    march(|p| body.level(p), |p, r| body.level(p) > 1.5 * r + body.blend, body.bounds(), cell, frame, stop)
}

/// A number between two.
fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.unit()
}
