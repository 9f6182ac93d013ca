//! The stages of spectral shape analysis as dataflow nodes, one file each, and the list of them all.

pub mod bag_of_features;
pub mod cut;
pub mod differences;
pub mod diffuse;
pub mod eigensolve;
pub mod evaluate_match;
pub mod evaluate_repeatability;
pub mod explain_match;
pub mod feature;
pub mod fuse;
pub mod iqp_match;
pub mod laplacian;
pub mod lists;
pub mod load;
pub mod match_all;
pub mod maxima;
pub mod network_fusion;
pub mod orient_match;
pub mod pair_scores;
pub mod patch_extract;
pub mod patch_spectrum;
pub mod point_signature;
pub mod rank;
pub mod reconstruct;
pub mod reconstruction_energy;
pub mod retrieval_metrics;
pub mod score;
pub mod shape_dna;
pub mod shortlist;
pub mod shuffle;
pub mod signature;
pub mod signature_similarity;
pub mod similarity;
pub mod simplify;
pub mod spectral_signature;
pub mod synthesize;
pub mod synthesize_object;
pub mod truth;
pub mod views;
pub mod vocabulary;
pub mod volume_signature;
pub mod weights;

use salient_sdk::AnyNode;

/// All nodes of this package.
pub static NODES: &[&dyn AnyNode] = &[
    &bag_of_features::BagOfFeatures,
    &cut::Cut,
    &diffuse::Diffuse,
    &eigensolve::Eigensolve,
    &evaluate_match::EvaluateMatch,
    &evaluate_repeatability::EvaluateRepeatability,
    &explain_match::ExplainMatch,
    &fuse::Fuse,
    &spectral_signature::HeatSignature,
    &iqp_match::IqpMatch,
    &laplacian::Laplacian,
    &load::Load,
    &match_all::MatchAll,
    &maxima::Maxima,
    &network_fusion::NetworkFusion,
    &orient_match::OrientMatch,
    &volume_signature::PanoramaSignature,
    &patch_extract::PatchExtract,
    &patch_spectrum::PatchSpectrum,
    &point_signature::PointSignature,
    &rank::Rank,
    &reconstruct::Reconstruct,
    &reconstruction_energy::ReconstructionEnergy,
    &retrieval_metrics::RetrievalMetrics,
    &score::Score,
    &shape_dna::ShapeDna,
    &shortlist::Shortlist,
    &shuffle::Shuffle,
    &signature_similarity::SignatureSimilarity,
    &simplify::Simplify,
    &synthesize::Synthesize,
    &synthesize_object::SynthesizeObject,
    &volume_signature::ViewSignature,
    &vocabulary::MakeVocabulary,
    &volume_signature::VolumeSignature,
    &spectral_signature::WaveSignature,
];
