//! What the author of a `salient` node needs, and nothing else.
//!
//! | module | holds |
//! |---|---|
//! | [`node`] | [`Node`]: a pure function of typed inputs and typed params; [`AnyNode`], the same seen by the engine |
//! | [`port`] | [`Port`] and [`Inputs`]: the named, typed inputs of a node |
//! | [`params`] | [`FileParam`], param schemas, parsing from RON with exact places of errors |
//! | [`artefact`] | [`Artefact`]: a typed output that can be written to and read from the cache |
//! | [`codec`] | the safetensors layout of an artefact: [`Encoder`], [`Decoder`] |
//! | [`context`] | [`Context`]: all that a running node may ask of its host |
//! | [`difference`] | [`Difference`]: how two artefacts of a type differ, for `salient compare` |
//! | [`memo`] | [`Memo`]: values of single items, remembered between executions |
//! | [`error`] | [`NodeError`] |
//! | [`mesh`] | [`Mesh`] and its [`Defect`]s: the one artefact that many nodes make |
//! | [`registry`] | [`Registry`]: all kinds of node that a host offers |
//! | [`view`] | [`View`]: what can be seen of an artefact, for reports |
//! | [`threads`] | threads for tasks that are shorter than it takes to start one |
//! | [`testing`] | running one node in memory, for tests |
//!
//! A node touches no file, clock, environment variable or global: it reads through its [`Context`],
//! which records the read for the cache key.

pub mod artefact;
pub mod codec;
pub mod context;
pub mod difference;
pub mod error;
pub mod memo;
pub mod mesh;
pub mod node;
pub mod params;
mod place;
pub mod port;
pub mod registry;
pub mod testing;
pub mod threads;
pub mod view;

pub use artefact::{AnyArtefact, Artefact, ArtefactType, Place, Table};
pub use codec::{ArrayView, Decoder, Encoder, FormatError, WriteError, Written};
pub use context::{Context, Host};
pub use difference::{Common, Difference, Surfaces};
pub use error::NodeError;
pub use memo::{ItemHasher, ItemKey, Memo};
pub use mesh::{Defect, DefectKind, Mesh};
pub use node::{AnyNode, BoundNode, Node};
pub use params::{FileParam, ParamError, ParamInfo};
pub use port::{Arity, Inputs, Port, PortValues};
pub use registry::Registry;
pub use view::View;
