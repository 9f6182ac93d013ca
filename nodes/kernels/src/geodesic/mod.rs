//! Geodesic distances on triangle meshes, by four metrics with one interface.
//!
//! Mean deviation from the true distance, and the greatest, in percent. `tests/geodesic_metrics.rs` asserts the first five rows, against
//! analytic distances beyond 0.3 to 0.4 of the shape's radius (the exact metric's is that of the polyhedron from the round shape); the last two
//! compare with the exact metric, at 2-5 % and at more than 10 % of the extent (`examples/hot_loops.rs`).
//!
//! | surface | `Edges` | `Unfolded` | `Heat` | `Exact` |
//! |---|---|---|---|---|
//! | plane, right triangles | 10 (26) | 4.0 (8.2) | 1.0 (8.9) | 0 |
//! | plane, vertices moved by 15 % | 8.0 (26) | 2.7 (8.4) | 0.7 (8.1) | 0 |
//! | plane, vertices moved by 25 % | 7.4 (28) | 2.5 (9.5) | 0.6 (7.9) | 0 |
//! | sphere, 2,562 vertices | 6.9 (18) | 1.4 (4.0) | 0.3 (2.4) | 0.06 (0.07) |
//! | cylinder, 1,320 vertices | 6.5 (19) | 1.5 (7.2) | 0.6 (3.4) | 0.06 (0.14) |
//! | hand, 7,993 vertices: near, far | 7.0, 4.3 | 1.9, 1.4 | 2.6, 1.1 | |
//! | fish, 10,786 vertices: near, far | 11.7, 6.4 | 3.7, 1.8 | 2.0, 1.2 | |
//!
//! `Edges` and `Unfolded` never are too short; `Heat` may be either.

mod dijkstra;
mod exact;
mod graph;
mod heat;
mod queue;

pub use dijkstra::{Ball, Dijkstra};
pub use exact::{ExactSearch, Polyhedron};
pub use graph::Graph;
pub use heat::{HeatError, HeatMethod, HeatSearch};

use crate::adjacency::MeshError;
use crate::stop::{NEVER, Stop};
use std::fmt;

/// How distances on the surface are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Metric {
    /// Dijkstra's algorithm along mesh edges: what Hu & Hua (2009) use.
    Edges,
    /// Dijkstra's algorithm along mesh edges and, for each pair of triangles sharing an edge, the straight segment between their far
    /// corners after unfolding them into a plane, where that segment crosses the shared edge.
    #[default]
    Unfolded,
    /// The heat method (Crane, Weischedel & Wardetzky 2013).
    Heat,
    /// Shortest paths through the triangles (Mitchell, Mount & Papadimitriou 1987): exact on the polyhedron.
    Exact,
}

/// Why a mesh has no geodesics.
#[derive(Debug, Clone, PartialEq)]
pub enum GeodesicError {
    /// The arrays are not a triangle mesh.
    Mesh(MeshError),
    /// The heat method cannot be set up.
    Heat(HeatError),
}

impl fmt::Display for GeodesicError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mesh(error) => error.fmt(f),
            Self::Heat(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for GeodesicError {}

impl From<MeshError> for GeodesicError {
    fn from(error: MeshError) -> Self {
        Self::Mesh(error)
    }
}

impl From<HeatError> for GeodesicError {
    fn from(error: HeatError) -> Self {
        match error {
            HeatError::Mesh(error) => Self::Mesh(error),
            error => Self::Heat(error),
        }
    }
}

/// A mesh made ready for distances by one metric. It is read only, so that several searches may share it.
#[derive(Debug)]
pub struct Geodesics(Prepared);

#[derive(Debug)]
enum Prepared {
    Graph(Graph),
    Heat(Box<HeatMethod>),
    Exact(Box<Polyhedron>),
}

impl Geodesics {
    /// Prepares a mesh. Refuses indices out of range and coordinates that are not finite; `Heat` also refuses faces without area.
    pub fn new(vertices: &[[f64; 3]], faces: &[[u32; 3]], metric: Metric) -> Result<Self, GeodesicError> {
        Self::new_until(vertices, faces, metric, NEVER)
    }

    /// The same, until `stop`, which only the heat method asks: the others are soon ready.
    pub fn new_until(
        vertices: &[[f64; 3]],
        faces: &[[u32; 3]],
        metric: Metric,
        stop: Stop,
    ) -> Result<Self, GeodesicError> {
        Ok(Self(match metric {
            Metric::Edges => Prepared::Graph(Graph::edges(vertices, faces)?),
            Metric::Unfolded => Prepared::Graph(Graph::unfolded(vertices, faces)?),
            Metric::Heat => Prepared::Heat(Box::new(HeatMethod::new_until(vertices, faces, stop)?)),
            Metric::Exact => Prepared::Exact(Box::new(Polyhedron::new(vertices, faces)?)),
        }))
    }

    /// A workspace for queries. It grows on first use and is reused from query to query.
    #[must_use]
    pub fn search(&self) -> Search<'_> {
        self.search_until(NEVER)
    }

    /// The same; queries end early once `stop` says so, with what they have.
    #[must_use]
    pub fn search_until<'a>(&'a self, stop: Stop<'a>) -> Search<'a> {
        let work = match &self.0 {
            Prepared::Graph(graph) => Work::Graph(graph, Box::default()),
            Prepared::Heat(heat) => Work::Heat(heat, HeatSearch::new()),
            Prepared::Exact(polyhedron) => Work::Exact(polyhedron, ExactSearch::new()),
        };
        Search { work, stop }
    }
}

/// Queries on [`Geodesics`]. Sources out of range are ignored.
pub struct Search<'a> {
    work: Work<'a>,
    stop: Stop<'a>,
}

impl fmt::Debug for Search<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Search").field("work", &self.work).finish_non_exhaustive()
    }
}

#[derive(Debug)]
enum Work<'a> {
    Graph(&'a Graph, Box<Dijkstra>),
    Heat(&'a HeatMethod, HeatSearch),
    Exact(&'a Polyhedron, ExactSearch),
}

impl Search<'_> {
    /// Distances of all vertices from the nearest source; infinite where no path leads.
    pub fn distances(&mut self, sources: &[u32]) -> Vec<f64> {
        match &mut self.work {
            Work::Graph(graph, work) => work.distances(graph, sources),
            Work::Heat(heat, work) => work.distances(heat, sources),
            Work::Exact(polyhedron, work) => work.distances_until(polyhedron, sources, self.stop),
        }
    }

    /// The vertices within `radius` of the nearest source, and all their neighbours.
    ///
    /// The cost is set by the visited vertices alone, but for `Heat`, whose every query solves for the whole mesh.
    pub fn ball(&mut self, sources: &[u32], radius: f64) -> Ball<'_> {
        match &mut self.work {
            Work::Graph(graph, work) => work.ball(graph, sources, radius),
            Work::Heat(heat, work) => work.ball(heat, sources, radius),
            Work::Exact(polyhedron, work) => work.ball_until(polyhedron, sources, radius, self.stop),
        }
    }

    /// Distances from each source to each target, `sources.len()` rows; infinite where no path leads.
    pub fn between(&mut self, sources: &[u32], targets: &[u32]) -> Vec<Vec<f64>> {
        let (stop, unknown) = (self.stop, vec![f64::INFINITY; targets.len()]);
        match &mut self.work {
            Work::Graph(graph, work) => {
                let row = |&s: &u32| if stop() { unknown.clone() } else { work.to(graph, &[s], targets) };
                sources.iter().map(row).collect()
            }
            Work::Heat(heat, work) => work.between_until(heat, sources, targets, stop),
            Work::Exact(polyhedron, work) => {
                sources.iter().map(|&s| work.to_until(polyhedron, &[s], targets, stop)).collect()
            }
        }
    }
}
