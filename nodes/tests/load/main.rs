//! The `load` node: formats, refusals, repairs, glTF poses, mutations, real files.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::format_collect,
    clippy::needless_pass_by_value,
    reason = "helpers of tests outside test functions, which are no nodes; short texts; `json!` values"
)]

mod files;
mod formats;
mod fuzz;
mod gltf;
mod malformed;
mod real;
mod repairs;

use salient_nodes::load::{Load, Params};
use salient_sdk::testing::TestHost;
use salient_sdk::{Defect, DefectKind, Mesh, NodeError};

/// Params from their RON texts.
fn params(name: &str, more: &[(&str, &str)]) -> Params {
    let path = format!("{name:?}");
    let mut fields = vec![("path", path.as_str())];
    fields.extend(more);
    salient_sdk::params::parse(&fields).unwrap()
}

/// Loads bytes as the file of that name.
fn load_with(name: &str, bytes: &[u8], more: &[(&str, &str)]) -> Result<Mesh, NodeError> {
    TestHost::default().file("path", bytes).run::<Load>(&params(name, more), ())
}

fn load(name: &str, bytes: &[u8]) -> Result<Mesh, NodeError> {
    load_with(name, bytes, &[])
}

fn defect(mesh: &Mesh, kind: DefectKind) -> Option<&Defect> {
    mesh.defects.iter().find(|d| d.kind == kind)
}
