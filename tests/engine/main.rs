//! The engine on toy nodes: each test says which calls executed.

#[path = "../toy/mod.rs"]
mod toy;

mod caching;
mod failures;
mod lab;
mod sharing;
