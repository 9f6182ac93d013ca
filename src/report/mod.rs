//! Results as a page: shapes, functions on them, features, matches, charts and the graph.
//!
//! | module | holds |
//! |---|---|
//! | [`mod@scene`] | what a page shows: one JSON document that names arrays |
//! | [`blobs`] | the arrays, by content |
//! | [`gather`] | recorded runs and the cache -> scene |
//! | `part` | what one output shows |
//! | `relate` | what lies between outputs: matches, rankings |
//! | `surface` | large meshes simplified, values in 16 bits |
//! | [`serve`] | the live page of a watch |
//! | [`page`] | markup, style, library (three.js) and script around a scene |
//!
//! `run`, `compare` and `watch` show the same scene, made from the same records as [`crate::compare`]. A report holds its
//! data; the live page asks for it, and for no array twice.

pub mod blobs;
pub mod gather;
pub mod page;
mod part;
mod relate;
pub mod scene;
pub mod serve;
mod surface;

use crate::compare::{Comparison, Library, Side, figures, stages};
use crate::engine::CacheError;
use crate::engine::history::RunSummary;
pub use blobs::Blobs;
pub use gather::Gatherer;
pub use page::Assets;
use scene::Scene;

/// How many vertices of a surface are displayed, unless somebody says otherwise.
pub const DETAIL: usize = 20_000;

/// The scene of some sides and the differences of their pairs; `runs` are those that the sides are of, the newest last.
pub fn scene(
    gatherer: &mut Gatherer,
    runs: &[&RunSummary],
    sides: &[Side],
    differences: &[Comparison],
    library: &Library,
) -> Result<(Scene, Blobs), CacheError> {
    let mut graphs: Vec<String> = runs.iter().map(|run| run.graph.clone()).collect();
    graphs.dedup();
    let name = |path: &String| {
        std::path::Path::new(path).file_name().map_or_else(|| path.clone(), |name| name.to_string_lossy().into_owned())
    };
    let last = runs.last();
    let head = Scene {
        title: graphs.iter().map(name).collect::<Vec<_>>().join(", "),
        program: format!("salient {}", env!("CARGO_PKG_VERSION")),
        when: last.map_or(0, |run| run.when),
        seconds: last.map_or(0.0, |run| run.seconds),
        compared: !differences.is_empty(),
        sides: Vec::new(),
        surfaces: Vec::new(),
        figures: figures(sides, library)?,
        stages: stages(sides),
        differences: differences.iter().map(scene::difference).collect(),
        notes: Vec::new(),
        graphs,
    };
    gatherer.gather(sides, library, head)
}
