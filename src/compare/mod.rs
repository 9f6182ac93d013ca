//! Experiments side by side: variants of a graph, graphs, and recorded runs.
//!
//! | module | holds |
//! |---|---|
//! | [`side`] | one column: a variant, a graph or a run, made from the record of a run |
//! | [`pair`] | two of them: where they part first, and what follows |
//! | [`table`] | results and stages of all of them |
//! | [`library`] | artefacts read from the cache, and the surfaces that they rest on |
//!
//! Everything is made from records of runs, so that a graph just run and one run last week are compared by the same
//! code. How two artefacts differ is said by their type ([`salient_sdk::Artefact::differences`]); nothing here knows any.

pub mod library;
pub mod pair;
pub mod side;
pub mod table;

pub use library::Library;
pub use pair::{Comparison, Depth, NodeDifference, compare};
pub use side::{Side, sides};
pub use table::{Cell, Figure, StageRow, figures, stages};
