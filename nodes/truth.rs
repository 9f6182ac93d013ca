//! Ground truth: where the vertices of one mesh are on another one.
//!
//! The truth is, in this order: positions on a `template` of which both meshes are poses (by vertex
//! index); the reference positions that the meshes carry; a vertex index that both meshes share. Positions are carried over to
//! the nearest point *on the faces* of the other mesh, so that meshes of different resolution are compared without rounding to
//! a vertex.

use std::collections::BTreeMap;

use salient_kernels::nearest::NearestVertex;
use salient_sdk::{Context, Mesh, NodeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use surface::Surface;

mod surface;

/// Which plane of the reference mirrors left to right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Mirror {
    /// The coordinate plane through the middle about which the reference is symmetric, if one is.
    Auto,
    /// No figures up to symmetry.
    Never,
    /// x changes sign.
    X,
    /// y changes sign.
    Y,
    /// z changes sign.
    Z,
}

/// A point on a mesh: the corners of a face and their weights, which sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The corners.
    pub corners: [u32; 3],
    /// Their barycentric weights.
    pub weights: [f64; 3],
}

impl Place {
    /// A vertex.
    #[must_use]
    pub fn vertex(v: u32) -> Self {
        Self { corners: [v; 3], weights: [1.0, 0.0, 0.0] }
    }

    /// The heaviest corner.
    #[must_use]
    pub fn nearest_vertex(&self) -> u32 {
        let heavier = |best: usize, i: usize| if self.weights[i] > self.weights[best] { i } else { best };
        self.corners[(1..3).fold(0, heavier)]
    }

    /// A function on vertices, interpolated. Infinite where a corner with weight is.
    #[must_use]
    pub fn value(&self, at: &[f64]) -> f64 {
        let corner =
            |i: usize| if self.weights[i] > 0.0 { self.weights[i] * at[self.corners[i] as usize] } else { 0.0 };
        corner(0) + corner(1) + corner(2)
    }
}

/// Where left vertices are on the right mesh.
pub enum Truth {
    /// Equal vertex index.
    Shared(Vec<Option<u32>>),
    /// Nearest reference position.
    Reference(Box<References>),
}

/// Reference positions of left vertices, and the right mesh in the reference pose.
pub struct References {
    name: &'static str,
    left: Vec<[f64; 3]>,
    surface: Surface,
    reach: f64,
    /// Axis and the coordinate of the plane of symmetry.
    mirror: Option<(usize, f64)>,
}

impl Truth {
    /// From left to right. A position farther than `reach` (in units of the square root of the right area) from the right
    /// reference surface has no image. Fails if the meshes have no truth in common.
    pub fn new(
        left: &Mesh,
        right: &Mesh,
        template: Option<&Mesh>,
        wanted: Mirror,
        reach: f64,
        cx: Context,
    ) -> Result<Self, NodeError> {
        let (name, left, references) = match (template, &left.reference, &right.reference) {
            (Some(t), ..) => ("template", on_template(left, t, "left")?, on_template(right, t, "right")?),
            (None, Some(l), Some(r)) => ("reference", l.clone(), r.clone()),
            (None, ..) => return shared(left, right),
        };
        cx.check()?;
        let mirror = mirror(template.map_or(&references, |t| &t.vertices), wanted, cx)?;
        let reach = reach * right.area().sqrt();
        cx.check()?;
        let surface = Surface::new(references, &right.faces);
        cx.check()?;
        Ok(Self::Reference(Box::new(References { name, left, surface, reach, mirror })))
    }

    /// `template`, `reference` or `shared_index`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Shared(_) => "shared_index",
            Self::Reference(r) => r.name,
        }
    }

    /// Where a left vertex is on the right mesh.
    #[must_use]
    pub fn image(&self, left: u32) -> Option<Place> {
        match self {
            Self::Shared(images) => images[left as usize].map(Place::vertex),
            Self::Reference(r) => r.at(r.left[left as usize]),
        }
    }

    /// Where the left vertex's mirror twin is.
    #[must_use]
    pub fn twin(&self, left: u32) -> Option<Place> {
        let Self::Reference(r) = self else { return None };
        r.at(reflected(r.left[left as usize], r.mirror?))
    }

    /// The axis that the symmetry reverses, 0 to 2.
    #[must_use]
    pub fn mirror(&self) -> Option<usize> {
        let Self::Reference(r) = self else { return None };
        r.mirror.map(|(axis, _)| axis)
    }
}

impl References {
    fn at(&self, point: [f64; 3]) -> Option<Place> {
        self.surface.nearest(point).filter(|(_, d)| *d <= self.reach).map(|(place, _)| place)
    }
}

fn reflected(mut p: [f64; 3], (axis, plane): (usize, f64)) -> [f64; 3] {
    p[axis] = 2.0 * plane - p[axis];
    p
}

/// The index that a vertex had in the file.
fn identity(mesh: &Mesh, vertex: usize) -> u32 {
    mesh.source.as_ref().map_or(vertex as u32, |s| s[vertex])
}

fn on_template(mesh: &Mesh, template: &Mesh, side: &str) -> Result<Vec<[f64; 3]>, NodeError> {
    let at = |vertex: usize| {
        let index = identity(mesh, vertex);
        template.vertices.get(index as usize).copied().ok_or_else(|| {
            NodeError::new(format!(
                "{side} vertex {vertex} is vertex {index} of its original, but the template has {}",
                template.vertices.len()
            ))
        })
    };
    (0..mesh.vertices.len()).map(at).collect()
}

fn shared(left: &Mesh, right: &Mesh) -> Result<Truth, NodeError> {
    let (l, r) = (left.vertices.len(), right.vertices.len());
    if l != r && left.source.is_none() && right.source.is_none() {
        return Err(NodeError::new(format!(
            "no ground truth: the meshes carry no reference positions, and {l} and {r} vertices share no index"
        ))
        .help("wire `template`, or match meshes that share their vertex order"));
    }
    let images: BTreeMap<u32, u32> = (0..r).rev().map(|j| (identity(right, j), j as u32)).collect();
    let image = |i| images.get(&identity(left, i)).copied();
    Ok(Truth::Shared((0..l).map(image).collect()))
}

/// A reference counts as symmetric if the median distance from mirrored vertices to the nearest one is
/// below this share of its bounding box's diagonal.
const SYMMETRIC: f64 = 0.01;

fn mirror(points: &[[f64; 3]], wanted: Mirror, cx: Context) -> Result<Option<(usize, f64)>, NodeError> {
    let extent = |axis: usize| {
        let coordinates = points.iter().map(|p| p[axis]);
        let low = coordinates.clone().fold(f64::INFINITY, f64::min);
        (low, coordinates.fold(f64::NEG_INFINITY, f64::max))
    };
    let extents = [extent(0), extent(1), extent(2)];
    let plane = |axis: usize| (axis, 0.5 * (extents[axis].0 + extents[axis].1));
    let diagonal = extents.iter().map(|(low, high)| (high - low).powi(2)).sum::<f64>().sqrt();
    let asymmetry = |nearest: &NearestVertex, axis: usize| {
        let distance = |p: &[f64; 3]| nearest.nearest(reflected(*p, plane(axis))).map(|(_, d)| d);
        let mut all = Vec::with_capacity(points.len());
        for some in points.chunks(512) {
            cx.check()?;
            all.extend(some.iter().filter_map(distance));
        }
        let middle = all.len() / 2;
        Ok(if all.is_empty() { f64::INFINITY } else { *all.select_nth_unstable_by(middle, f64::total_cmp).1 })
    };
    Ok(match wanted {
        Mirror::Never => None,
        Mirror::X => Some(plane(0)),
        Mirror::Y => Some(plane(1)),
        Mirror::Z => Some(plane(2)),
        Mirror::Auto => {
            let nearest = NearestVertex::new(points);
            let axes = (0..3).map(|axis| Ok((axis, asymmetry(&nearest, axis)?)));
            let axes = axes.collect::<Result<Vec<(usize, f64)>, NodeError>>()?;
            let best = axes.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
            best.filter(|(_, a)| *a <= SYMMETRIC * diagonal).map(|(axis, _)| plane(axis))
        }
    })
}
