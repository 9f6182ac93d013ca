//! The engine on toy nodes: each test says which calls executed.
#![allow(clippy::unwrap_used)]

#[path = "../toy/mod.rs"]
mod toy;

mod caching;
mod failures;
mod fuzz;
mod lab;
mod memo;
mod oracle;
mod remembered;
mod sharing;
