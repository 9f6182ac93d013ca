//! The stages of spectral shape analysis as dataflow nodes, one file each, and the list of them all.

pub mod cut;
pub mod differences;
pub mod eigensolve;
pub mod evaluate_match;
pub mod evaluate_repeatability;
pub mod feature;
pub mod iqp_match;
pub mod laplacian;
pub mod load;
pub mod maxima;
pub mod orient_match;
pub mod patch_extract;
pub mod patch_spectrum;
pub mod reconstruct;
pub mod reconstruction_energy;
pub mod shuffle;
pub mod simplify;
pub mod synthesize;
pub mod truth;
pub mod views;

use salient_sdk::AnyNode;

/// All nodes of this package.
pub static NODES: &[&dyn AnyNode] = &[
    &cut::Cut,
    &eigensolve::Eigensolve,
    &evaluate_match::EvaluateMatch,
    &evaluate_repeatability::EvaluateRepeatability,
    &iqp_match::IqpMatch,
    &laplacian::Laplacian,
    &load::Load,
    &maxima::Maxima,
    &orient_match::OrientMatch,
    &patch_extract::PatchExtract,
    &patch_spectrum::PatchSpectrum,
    &reconstruct::Reconstruct,
    &reconstruction_energy::ReconstructionEnergy,
    &shuffle::Shuffle,
    &simplify::Simplify,
    &synthesize::Synthesize,
];
