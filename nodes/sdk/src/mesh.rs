//! The triangle mesh that nodes pass on, and the defects that travel with artefacts.

use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::artefact::{Artefact, Place, Table};
use crate::codec::{Decoder, Encoder, FormatError};
use crate::difference::{Difference, Surfaces, short};

/// A triangle mesh in the units of its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions, finite.
    pub vertices: Vec<[f64; 3]>,
    /// Vertex indices of each triangle, all below `vertices.len()`.
    pub faces: Vec<[u32; 3]>,
    /// Ground truth, if known: for each vertex the position of the same material point in a
    /// reference pose shared by all meshes of the object.
    pub reference: Option<Vec<[f64; 3]>>,
    /// For each vertex its index in the mesh that this one was made from, by nodes that renumber.
    pub source: Option<Vec<u32>>,
    /// What is doubtful about the mesh.
    pub defects: Vec<Defect>,
}

impl Mesh {
    /// Total area of the triangles, in squared units of the file.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.faces.iter().map(|face| self.face_area(face)).sum()
    }

    /// Area of one triangle over this mesh's vertices.
    #[must_use]
    pub fn face_area(&self, face: &[u32; 3]) -> f64 {
        let [a, b, c] = face.map(|i| self.vertices[i as usize]);
        let (u, v) = (sub(b, a), sub(c, a));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt() / 2.0
    }

    /// Keeps `source` through a renumbering: `kept[i]` is the old index of new vertex `i`.
    #[must_use]
    pub fn renumbered(&self, vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>, kept: &[u32]) -> Self {
        let old_source = |i: &u32| self.source.as_ref().map_or(*i, |s| s[*i as usize]);
        Self {
            vertices,
            faces,
            reference: self.reference.as_ref().map(|r| kept.iter().map(|i| r[*i as usize]).collect()),
            source: Some(kept.iter().map(old_source).collect()),
            defects: self.defects.clone(),
        }
    }

    fn validate(&self) -> Result<(), FormatError> {
        let n = self.vertices.len();
        if let Some(face) = self.faces.iter().position(|f| f.iter().any(|i| *i as usize >= n)) {
            return Err(FormatError(format!("face {face} points past the {n} vertices")));
        }
        let reference = self.reference.as_ref().is_none_or(|r| r.len() == n);
        let source = self.source.as_ref().is_none_or(|s| s.len() == n);
        if reference && source {
            return Ok(());
        }
        Err(FormatError(format!("a vertex attribute does not have {n} entries")))
    }
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

impl Artefact for Mesh {
    const TYPE: &'static str = "mesh";
    const FORMAT: u32 = 1;
    const PLACE: Place = Place::Itself;
    const DOC: &'static str = "A triangle mesh: vertices [n, 3] in the units of its file, faces [m, 3], \
        and where known the reference position [n, 3] and source index [n] of each vertex.";

    fn encode(&self, out: &mut Encoder) {
        out.points("vertices", &self.vertices);
        out.triples("faces", &self.faces);
        if let Some(reference) = &self.reference {
            out.points("reference", reference);
        }
        if let Some(source) = &self.source {
            out.u32("source", source, &[source.len()]);
        }
        out.header("defects", &self.defects);
    }

    fn decode(from: &Decoder) -> Result<Self, FormatError> {
        let reference = from.has("reference").then(|| from.points("reference")).transpose()?;
        let source = from.has("source").then(|| from.u32("source")).transpose()?;
        let mesh = Self {
            vertices: from.points("vertices")?,
            faces: from.triples("faces")?,
            reference,
            source: source.map(|(values, _)| values),
            defects: from.header("defects")?,
        };
        mesh.validate()?;
        Ok(mesh)
    }

    fn json(&self) -> Value {
        json!({
            "vertices": self.vertices,
            "faces": self.faces,
            "reference": self.reference,
            "source": self.source,
            "area": self.area(),
            "defects": self.defects,
        })
    }

    fn summary(&self) -> Vec<(&'static str, String)> {
        vec![
            ("vertices", self.vertices.len().to_string()),
            ("faces", self.faces.len().to_string()),
            ("area", format!("{:.6}", self.area())),
        ]
    }

    fn defects(&self) -> Vec<Defect> {
        self.defects.clone()
    }

    fn surface(&self) -> Option<&Mesh> {
        Some(self)
    }

    fn table(&self) -> Option<Table> {
        let row = |p: &[f64; 3]| p.iter().map(f64::to_string).collect();
        Some(Table::new(&["x", "y", "z"], self.vertices.iter().map(row).collect()))
    }

    fn differences(&self, other: &Self, _: &Surfaces) -> Vec<Difference> {
        let vertices = Difference::of_count("vertices", self.vertices.len(), other.vertices.len());
        let faces = Difference::of_count("faces", self.faces.len(), other.faces.len());
        let connected = (self.faces.len() == other.faces.len() && self.faces != other.faces)
            .then(|| Difference::new("connectivity", 1.0, "other faces over the vertices"));
        let moved = if vertices.is_none() { moved(self, other) } else { None };
        let area = Difference::of_number("area", self.area(), other.area());
        [vertices, faces, connected, moved, area].into_iter().flatten().collect()
    }
}

/// How far the vertex that moved farthest has moved, over the square root of the area.
fn moved(one: &Mesh, other: &Mesh) -> Option<Difference> {
    let distance = |(i, (p, q)): (usize, (&[f64; 3], &[f64; 3]))| {
        let [x, y, z] = sub(*q, *p);
        (i, (x * x + y * y + z * z).sqrt())
    };
    let all = one.vertices.iter().zip(&other.vertices).enumerate().map(distance);
    let (vertex, farthest) = all.reduce(|best, it| if it.1 > best.1 { it } else { best })?;
    if farthest == 0.0 {
        return None;
    }
    let root = one.area().sqrt();
    let size = if root > 0.0 { farthest / root } else { farthest };
    let text = format!("vertex {vertex} moved farthest, by {} of sqrt(area)", short(size));
    let details = json!({ "vertex": vertex, "distance": farthest });
    Some(Difference::new("positions", size, text).details(details))
}

/// What may be wrong with a mesh or with what was computed from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DefectKind {
    /// Edges with more than two faces.
    NonManifoldEdge,
    /// Vertices whose faces form more than one fan.
    NonManifoldVertex,
    /// Edges that their two faces run through in the same direction.
    InconsistentOrientation,
    /// Faces of (nearly) no area.
    ZeroAreaFace,
    /// Vertices at exactly the position of an earlier one.
    DuplicateVertex,
    /// Vertices of no face.
    UnreferencedVertex,
    /// Edges with one face.
    BoundaryEdge,
    /// Connected components beyond the first.
    SeveralComponents,
    /// Faces given as polygons, split into triangles.
    Polygon,
    /// Features whose patch cannot be described.
    PatchWithoutDescriptor,
}

impl DefectKind {
    /// What one of them is called, for messages.
    #[must_use]
    pub fn noun(self) -> &'static str {
        match self {
            Self::NonManifoldEdge => "non-manifold edge",
            Self::NonManifoldVertex => "non-manifold vertex",
            Self::InconsistentOrientation => "inconsistently oriented edge",
            Self::ZeroAreaFace => "zero-area face",
            Self::DuplicateVertex => "duplicate vertex",
            Self::UnreferencedVertex => "unreferenced vertex",
            Self::BoundaryEdge => "boundary edge",
            Self::SeveralComponents => "further component",
            Self::Polygon => "polygon split into triangles",
            Self::PatchWithoutDescriptor => "patch without descriptor",
        }
    }
}

/// One kind of defect with how often and where it was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Defect {
    /// What it is.
    pub kind: DefectKind,
    /// How often it was found.
    pub count: usize,
    /// The first places: vertex or face indices (edges by their two vertices), at most eight numbers.
    pub first: Vec<u32>,
    /// Whether it was mended.
    pub repaired: bool,
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let repaired = if self.repaired { "repaired " } else { "" };
        write!(f, "{repaired}{} × {}", self.kind.noun(), self.count)?;
        if let Some(first) = self.first.first() {
            write!(f, ", first at {first}")?;
        }
        Ok(())
    }
}
