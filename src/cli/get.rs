//! `salient get`.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;
use std::sync::Arc;

use clap::ValueEnum;
use petgraph::Direction;
use petgraph::graph::NodeIndex;
use salient_sdk::{Artefact, Mesh, Place, Registry};

use super::args::GetArgs;
use super::fail::Fail;
use super::plan::{find, load};
use super::results::write;
use super::run::{compute, listen, verdict};
use super::text::print;
use crate::engine::key::wires;
use crate::engine::{Cache, Outcome, State};
use crate::export::{Drawing, Format, draw, export};
use crate::graph::Plan;

/// Writes one node's output to a file, or to standard output.
pub fn get(args: &GetArgs, registry: &Registry) -> Result<(), Fail> {
    let file = args.output.as_deref().filter(|path| *path != Path::new("-"));
    let format = args.format.map_or_else(|| format_of(file), Ok)?;
    let how = Drawing { index: args.index, colours: args.colours.unwrap_or_default(), bare: args.bare };
    if !format.draws() && (args.index.is_some() || args.colours.is_some() || args.bare) {
        let message = format!("--index, --colours and --bare are for drawings, and {} is none", format.extension());
        return Err(Fail::Usage { message, help: Some("write ply, glb, obj or off".into()) });
    }
    let plan = load(&args.graph, registry)?;
    let call = find(&plan, &args.node)?;
    let on = if format.draws() { meshes(&plan, call, &args.node, format)? } else { Vec::new() };
    let cache = args.cache.open()?;
    let wanted: Vec<NodeIndex> = [call].into_iter().chain(on.iter().copied()).collect();
    let outcome = compute(&plan, &wanted, &cache, &args.effort, false, &listen()?)?;
    if let Some(State::Failed(_) | State::Skipped(_) | State::Cancelled) = outcome.states.get(&call) {
        return verdict(&outcome);
    }
    let bytes = bytes(&plan, call, &on, (&outcome, &cache), format, &how)?;
    match file {
        Some(path) => write(path, &bytes),
        None => print(&bytes),
    }
}

fn bytes(
    plan: &Plan,
    call: NodeIndex,
    on: &[NodeIndex],
    (outcome, cache): (&Outcome, &Cache),
    format: Format,
    how: &Drawing,
) -> Result<Vec<u8>, Fail> {
    let output = |call: NodeIndex| {
        let lost = || Fail::Lacking(format!("the output of {} vanished from the cache; run again", plan.name(call)));
        outcome.artefact(plan, call, cache)?.ok_or_else(lost)
    };
    let artefact = output(call)?;
    if !format.draws() {
        return export(artefact.as_ref(), format).map_err(|e| Fail::Lacking(e.0));
    }
    let mut meshes: Vec<Arc<Mesh>> = Vec::new();
    for call in on {
        meshes.extend(output(*call)?.into_any().downcast::<Mesh>().ok());
    }
    let scene = draw(artefact.as_ref(), &meshes, how).map_err(|e| Fail::Lacking(e.0))?;
    scene.write(format).map_err(|e| Fail::Lacking(e.0))
}

/// The meshes that a call's output is drawn on; refused if it cannot be drawn at all.
fn meshes(plan: &Plan, call: NodeIndex, address: &str, format: Format) -> Result<Vec<NodeIndex>, Fail> {
    let output = plan.dag[call].node.output();
    let refused = |why: &str| {
        let others: Vec<_> = Format::of(output).into_iter().filter(|f| !f.draws()).map(Format::extension).collect();
        Fail::Usage {
            message: format!(
                "{address}, {} `{}`, {why}, and cannot be written as {}",
                article(output.name),
                output.name,
                format.extension()
            ),
            help: Some(format!("write {}", others.join(", "))),
        }
    };
    let needs = |found: Option<NodeIndex>| found.ok_or_else(|| refused("rests on no mesh"));
    match output.place {
        Place::Nowhere => Err(refused("has no surface")),
        Place::Itself => Ok(Vec::new()),
        Place::OnSurface => Ok(vec![needs(mesh(plan, call))?]),
        Place::Between(ports) => {
            let from =
                |port: &str| wires(plan, call).into_iter().find(|(wire, _)| wire.port == port).map(|(_, from)| from);
            ports.iter().map(|port| needs(from(port).and_then(|from| mesh(plan, from)))).collect()
        }
    }
}

fn article(name: &str) -> &'static str {
    if name.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" }
}

/// The nearest call upward that makes a mesh, the call itself included.
fn mesh(plan: &Plan, call: NodeIndex) -> Option<NodeIndex> {
    let (mut left, mut seen) = (VecDeque::from([call]), BTreeSet::from([call]));
    while let Some(call) = left.pop_front() {
        if plan.dag[call].node.output().name == Mesh::TYPE {
            return Some(call);
        }
        let mut above: Vec<NodeIndex> = plan.dag.neighbors_directed(call, Direction::Incoming).collect();
        above.sort();
        left.extend(above.into_iter().filter(|from| seen.insert(*from)));
    }
    None
}

fn format_of(file: Option<&Path>) -> Result<Format, Fail> {
    let Some(file) = file else { return Ok(Format::Json) };
    let extension = file.extension().unwrap_or_default().to_string_lossy();
    Format::of_extension(&extension).ok_or_else(|| {
        let known: Vec<_> = Format::value_variants().iter().map(|format| format.extension()).collect();
        let message = format!("the name {} does not say a format: `{extension}` is none", file.display());
        Fail::Usage { message, help: Some(format!("name one with --format: {}", known.join(", "))) }
    })
}
