//! `salient`: a dataflow engine for spectral shape analysis.
//!
//! | module | holds |
//! |---|---|
//! | [`graph`] | RON text -> calls -> checked and expanded DAG -> plan |
//! | [`engine`] | runs a plan: keys, content-addressed cache, scheduling, events |
//!
//! The engine knows no stage by name: it is given a [`salient_sdk::Registry`].

pub mod diagnostics;
pub mod engine;
pub mod graph;
