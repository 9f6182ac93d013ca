//! What can be seen of an artefact: functions on a surface, points, links between surfaces, charts.
//!
//! An artefact says what it holds that has a place on a surface; whose surface that is, the reader of the graph knows: the
//! nearest mesh upward of the node that made it, or upward of one of its ports. Reports draw this without knowing any stage.

use std::borrow::Cow;

use serde::Serialize;

/// All that can be seen of an artefact beside its surface; empty by default.
#[derive(Clone, Debug, Default)]
pub struct View<'a> {
    /// Functions on the vertices.
    pub fields: Vec<Fields<'a>>,
    /// Points on the surface.
    pub points: Option<Points<'a>>,
    /// Pairs of vertices on two surfaces.
    pub links: Option<Links>,
    /// How right the links of another artefact are.
    pub verdicts: Option<Verdicts>,
    /// Shapes in the order of their likeness to others.
    pub rankings: Option<Rankings>,
    /// Classes of the shapes in another artefact's rankings.
    pub classes: Option<Classes>,
    /// Charts.
    pub charts: Vec<Chart>,
}

/// Functions on the vertices of a surface, of one family.
#[derive(Clone, Debug)]
pub struct Fields<'a> {
    /// What one of them is called: `eigenfunction`.
    pub name: &'static str,
    /// Unit of the values, in terms of the length of the mesh's file.
    pub unit: &'static str,
    /// Whether zero is the centre of the values, as it is for eigenfunctions.
    pub signed: bool,
    /// One for each function.
    pub levels: Vec<Level>,
    /// Number of vertices.
    pub vertices: usize,
    /// Function after function, `vertices` values each.
    pub values: Cow<'a, [f64]>,
    /// The area of each vertex, if the functions are orthonormal by it: then positions can be taken apart into them.
    pub mass: Option<&'a [f64]>,
}

/// Which function of a family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Its number in the family, from 0.
    pub k: u32,
    /// Its eigenvalue, 1 / length²; none for functions that have none.
    pub lambda: Option<f64>,
}

impl Fields<'_> {
    /// The values of one function.
    #[must_use]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.vertices..(row + 1) * self.vertices]
    }
}

/// Points on a surface; `regions` and `profiles` have one entry for each point, or none at all.
#[derive(Clone, Debug, Default)]
pub struct Points<'a> {
    /// The points.
    pub points: Vec<Point>,
    /// The piece of the surface about each.
    pub regions: Vec<Region<'a>>,
    /// The descriptor of each, or why it has none.
    pub profiles: Vec<Result<&'a [f64], &'a str>>,
}

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Vertex index.
    pub vertex: u32,
    /// Index of its eigenpair.
    pub k: u32,
    /// Its frequency: an eigenvalue, 1 / length².
    pub lambda: f64,
    /// Its size, a length.
    pub scale: f64,
    /// By what it ranks, a length.
    pub energy: f64,
}

/// A piece of a surface with its own vertices.
#[derive(Clone, Copy, Debug)]
pub struct Region<'a> {
    /// What it looks like: `disk`.
    pub kind: &'static str,
    /// Positions.
    pub vertices: &'a [[f64; 3]],
    /// Faces over them.
    pub faces: &'a [[u32; 3]],
}

/// Correspondences between two surfaces.
#[derive(Clone, Debug)]
pub struct Links {
    /// The ports upward of which the two surfaces are.
    pub ports: [&'static str; 2],
    /// The correspondence, and others that were found beside it.
    pub sets: Vec<LinkSet>,
    /// How good the first of them is proved to be.
    pub certificate: Option<Certificate>,
}

/// One correspondence.
#[derive(Clone, Debug, Serialize)]
pub struct LinkSet {
    /// What it is called: `match`, `mirror twin`.
    pub name: String,
    /// Value of the objective.
    pub objective: f64,
    /// The pairs.
    pub pairs: Vec<Link>,
}

/// A pair of points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Link {
    /// Indices of the points on both sides, in the lists that were matched.
    pub points: [u32; 2],
    /// Their vertices.
    pub vertices: [u32; 2],
    /// Distance of their descriptors, without unit.
    pub distance: f64,
}

/// What is proved of an optimum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Certificate {
    /// Value of the objective.
    pub objective: f64,
    /// No value is greater.
    pub bound: f64,
    /// The difference.
    pub gap: f64,
    /// Whether the value is proved to be the greatest.
    pub proved: bool,
}

/// How far pairs are from the truth.
#[derive(Clone, Debug, Serialize)]
pub struct Verdicts {
    /// The port at which the pairs came in.
    pub port: &'static str,
    /// One for each pair.
    pub pairs: Vec<Verdict>,
}

/// How far a pair is from the truth; distances over the square root of the area of the right surface, none where there
/// is no true image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// Vertices of the pair.
    pub vertices: [u32; 2],
    /// Where the left vertex truly is.
    pub truth: Option<u32>,
    /// Distance to the truth.
    pub error: Option<f64>,
    /// The same, a mirror image of the truth counting as well.
    pub symmetric: Option<f64>,
}

/// For each query the shapes that are most like it. Names are labels of instances on an axis, upward of the artefact.
#[derive(Clone, Debug, Serialize)]
pub struct Rankings {
    /// What the order is by.
    pub measure: String,
    /// The queries.
    pub queries: Vec<RankedList>,
}

/// A query, and what is most like it.
#[derive(Clone, Debug, Serialize)]
pub struct RankedList {
    /// Its name.
    pub query: String,
    /// Names and scores, the most alike first; no more than are worth a look.
    pub found: Vec<(String, f64)>,
}

/// Which class each shape is of.
#[derive(Clone, Debug, Serialize)]
pub struct Classes {
    /// The port at which the rankings came in.
    pub port: &'static str,
    /// Names and classes.
    pub of: Vec<(String, String)>,
}

/// A chart; those of one title from several artefacts are drawn into one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Chart {
    /// What it shows.
    pub title: &'static str,
    /// What lies on the horizontal axis, with its unit.
    pub x: &'static str,
    /// What lies on the vertical axis, with its unit.
    pub y: &'static str,
    /// How it is drawn.
    pub marks: Marks,
    /// Curves or bars.
    pub series: Vec<Series>,
}

/// How a chart is drawn.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Marks {
    /// Curves.
    Lines,
    /// Bars, one for each of these names and series.
    Bars {
        /// Names of the places on the horizontal axis.
        names: Vec<String>,
    },
    /// A table of numbers with colours; each series is a row.
    Matrix {
        /// Names of the columns.
        names: Vec<String>,
    },
}

/// A curve, bars of one colour, or a row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    /// What it is called beside others of the chart; empty if the artefact's address says enough.
    pub name: String,
    /// Horizontal places; empty: 0, 1, 2 and so on.
    pub x: Vec<f64>,
    /// Values.
    pub y: Vec<f64>,
}

impl Chart {
    /// A chart of curves.
    #[must_use]
    pub fn lines(title: &'static str, x: &'static str, y: &'static str, series: Vec<Series>) -> Self {
        Self { title, x, y, marks: Marks::Lines, series }
    }
}

impl Series {
    /// A series at 0, 1, 2 and so on.
    #[must_use]
    pub fn new(name: impl Into<String>, y: Vec<f64>) -> Self {
        Self { name: name.into(), x: Vec::new(), y }
    }
}
