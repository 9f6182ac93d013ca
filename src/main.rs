//! The `salient` command with the nodes of this repository.

use std::process::ExitCode;

fn main() -> ExitCode {
    salient::cli::main(&[salient_nodes::NODES])
}
