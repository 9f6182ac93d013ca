//! The stages from Laplacian to evaluation, run in memory, against what we know without them.

// A test may fail where it stands.
#![allow(clippy::unwrap_used)]

mod cancel;
mod evaluate;
mod features;
mod invariance;
mod matching;
mod orientation;
mod registry;
mod repeatability;
mod retrieval;
mod shapes;
mod signatures;
mod spectral;

use std::sync::Arc;

use salient_nodes::eigensolve::{self, Eigenpairs, Eigensolve};
use salient_nodes::iqp_match::{self, IqpMatch, Match};
use salient_nodes::laplacian::{self, Laplacian, Operator};
use salient_nodes::maxima::{self, Maxima, Salient};
use salient_nodes::patch_extract::{self, PatchExtract, Patches};
use salient_nodes::patch_spectrum::{self, Features, PatchSpectrum};
use salient_nodes::reconstruction_energy::{self, Energy, ReconstructionEnergy};
use salient_nodes::shuffle::{self, Shuffle};
use salient_nodes::synthesize::{self, Synthesize};
use salient_sdk::testing::TestHost;
use salient_sdk::{AnyArtefact, ArtefactType, Mesh, Node, NodeError, PortValues};

/// Runs a node on wired inputs, and checks that its output survives being written and read.
fn run<N: Node>(params: &N::Params, wires: &[(&str, Arc<dyn AnyArtefact>)]) -> Result<Arc<N::Output>, NodeError> {
    let mut wired = PortValues::default();
    for (port, value) in wires {
        wired.push(port, "", value.clone());
    }
    let output = TestHost::with_workers(1).run_wired::<N>(params, wired)?;
    let (bytes, _) = output.to_bytes().unwrap();
    let back = (ArtefactType::of::<N::Output>().decode)(&bytes).unwrap();
    assert!(back.to_bytes().unwrap().0 == bytes, "{} changes when written and read", N::KIND);
    assert!(back.json() == AnyArtefact::json(&output), "{} changes when written and read", N::KIND);
    Ok(Arc::new(output))
}

/// The defaults of a node's params.
fn defaults<P: serde::de::DeserializeOwned>() -> P {
    salient_sdk::params::parse(&[]).unwrap()
}

/// A creature of the given pose with few vertices.
fn creature(pose: u32, vertices: u32) -> Arc<Mesh> {
    run::<Synthesize>(&synthesize::Params { pose, vertices, ..defaults() }, &[]).unwrap()
}

fn shuffled(mesh: &Arc<Mesh>, seed: u64) -> Arc<Mesh> {
    run::<Shuffle>(&shuffle::Params { seed }, &[("mesh", mesh.clone())]).unwrap()
}

fn operator(mesh: &Arc<Mesh>) -> Arc<Operator> {
    run::<Laplacian>(&defaults::<laplacian::Params>(), &[("mesh", mesh.clone())]).unwrap()
}

fn basis(mesh: &Arc<Mesh>, pairs: u32) -> Arc<Eigenpairs> {
    run::<Eigensolve>(&eigensolve::Params { pairs }, &[("operator", operator(mesh))]).unwrap()
}

fn energy(mesh: &Arc<Mesh>, basis: &Arc<Eigenpairs>) -> Arc<Energy> {
    let params: reconstruction_energy::Params = defaults();
    run::<ReconstructionEnergy>(&params, &[("mesh", mesh.clone()), ("basis", basis.clone())]).unwrap()
}

fn maxima(mesh: &Arc<Mesh>, energy: &Arc<Energy>, count: u32) -> Arc<Salient> {
    let params = maxima::Params { count, ..defaults() };
    run::<Maxima>(&params, &[("mesh", mesh.clone()), ("energy", energy.clone())]).unwrap()
}

fn patches(mesh: &Arc<Mesh>, maxima: &Arc<Salient>, params: &patch_extract::Params) -> Arc<Patches> {
    run::<PatchExtract>(params, &[("mesh", mesh.clone()), ("maxima", maxima.clone())]).unwrap()
}

fn spectra(patches: &Arc<Patches>, params: &patch_spectrum::Params) -> Arc<Features> {
    run::<PatchSpectrum>(params, &[("patches", patches.clone())]).unwrap()
}

/// All stages up to the features, as `salient_features.ron` wires them.
fn features(mesh: &Arc<Mesh>, count: u32) -> Arc<Features> {
    let basis = basis(mesh, 60);
    let maxima = maxima(mesh, &energy(mesh, &basis), count);
    spectra(&patches(mesh, &maxima, &defaults()), &defaults())
}

fn matched(left: &Arc<Features>, right: &Arc<Features>, params: &iqp_match::Params) -> Arc<Match> {
    run::<IqpMatch>(params, &[("left", left.clone()), ("right", right.clone())]).unwrap()
}
