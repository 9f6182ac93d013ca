//! `salient`: a dataflow engine for spectral shape analysis.
//!
//! | module | holds |
//! |---|---|
//! | [`graph`] | RON text -> calls -> checked and expanded DAG -> plan |
//! | [`diagnostics`] | what is wrong with a graph file, and where |
//! | [`engine`] | runs a plan: keys, content-addressed cache, scheduling, events |
//! | [`compare`] | variants, graphs and runs side by side |
//! | [`report`] | results as a page with the shapes themselves |
//! | [`watch`] | runs again whenever an input changes |
//! | [`export`] | artefacts in the formats of other tools |
//! | [`cli`] | the command line: printing and exit codes |
//!
//! The engine knows no stage by name: it is given a [`salient_sdk::Registry`].

pub mod cli;
pub mod compare;
pub mod diagnostics;
pub mod engine;
pub mod export;
pub mod graph;
pub mod report;
pub mod watch;
