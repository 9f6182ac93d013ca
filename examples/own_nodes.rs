//! The command line with nodes of one's own: a package that depends on `salient` and lists its nodes.
//!
//! The nodes here are the toys that the tests of the engine use.

#[path = "../tests/toy/mod.rs"]
mod toy;

fn main() -> std::process::ExitCode {
    salient::cli::main(&[toy::NODES])
}
