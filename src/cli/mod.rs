//! The command line: arguments, printing and exit codes; everything else is in the library.
//!
//! Results go to standard output, all else to standard error. Exit codes: 0 done; 1 a node failed or
//! the cache cannot be used; 2 the call or the graph is wrong; 130 interrupted.
//!
//! A host of other nodes has the same command line in one line of `main`:
//! `salient::cli::main(&[salient_nodes::NODES, MY_NODES])`.

mod args;
mod cache;
mod compare;
mod compare_text;
mod fail;
mod failures;
mod get;
mod nodes;
mod plan;
mod progress;
mod report;
mod results;
mod run;
mod runs;
mod text;
mod watch;

use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use salient_sdk::{AnyNode, Registry};

use args::{Cli, Command};
use fail::Fail;

/// Runs the command line of this process with the nodes of these slices.
#[must_use]
pub fn main(slices: &[&[&'static dyn AnyNode]]) -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are asked for and end well; a closed pipe is nobody's fault.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let result = Registry::new(slices)
        .map_err(|message| Fail::Usage { message, help: None })
        .and_then(|registry| dispatch(cli.command, &registry));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(fail) => fail.report(),
    }
}

fn dispatch(command: Command, registry: &Registry) -> Result<(), Fail> {
    match command {
        Command::Run(args) => run::run(&args, registry),
        Command::Watch(args) => watch::watch(&args, registry),
        Command::Get(args) => get::get(&args, registry),
        Command::Check(args) => plan::check(&args, registry),
        Command::Plan(args) => plan::plan(&args, registry),
        Command::Compare(args) => compare::compare(&args, registry),
        Command::Runs(args) => runs::runs(&args),
        Command::Graph(args) => plan::graph(&args, registry),
        Command::Nodes(args) => nodes::nodes(&args, registry),
        Command::Cache(args) => cache::cache(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "salient", &mut script);
            text::print(&script)
        }
    }
}
