//! What a node is, and how the engine sees it.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::artefact::{AnyArtefact, Artefact, ArtefactType};
use crate::context::Context;
use crate::error::NodeError;
use crate::params::{self, ParamError, ParamInfo};
use crate::port::{Inputs, Port, PortValues};

/// A stage: a pure function of typed inputs and typed params, with one typed output.
///
/// Implement it for a unit struct and add that struct to the list of nodes.
pub trait Node: Sync + 'static {
    /// Its name in graph files.
    const KIND: &'static str;
    /// Bumped whenever equal inputs and params may give different bytes.
    const VERSION: u32;
    /// What it computes, its equation and source, in a few sentences; the first is the short form.
    const DOC: &'static str;
    /// Lines of a graph file's `nodes` that use it, complete enough to plan.
    const EXAMPLE: &'static str;

    /// Documented params; `deny_unknown_fields`, defaults by `serde(default)`, ranges by
    /// `schemars(range)`.
    type Params: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static;
    /// Named, typed inputs.
    type Inputs: Inputs;
    /// What it makes.
    type Output: Artefact;

    /// What ranges cannot say about params: conditions between them. Each error names a param.
    fn check(_params: &Self::Params) -> Vec<(&'static str, String)> {
        Vec::new()
    }

    /// Computes the output. Touches nothing but its arguments.
    fn run(params: &Self::Params, inputs: Self::Inputs, cx: Context) -> Result<Self::Output, NodeError>;
}

/// A [`Node`] as a value of the registry. Implemented for every node.
pub trait AnyNode: Sync {
    /// See [`Node::KIND`].
    fn kind(&self) -> &'static str;
    /// See [`Node::VERSION`].
    fn version(&self) -> u32;
    /// See [`Node::DOC`].
    fn doc(&self) -> &'static str;
    /// See [`Node::EXAMPLE`].
    fn example(&self) -> &'static str;
    /// Its inputs.
    fn ports(&self) -> &'static [Port];
    /// The type of its output.
    fn output(&self) -> ArtefactType;
    /// JSON schema of its params.
    fn schema(&self) -> Value;
    /// Parses params given as (name, RON text); all errors at once.
    fn bind(&self, fields: &[(&str, &str)]) -> Result<Arc<dyn BoundNode>, Vec<ParamError>>;

    /// Its params, documented.
    fn params(&self) -> Vec<ParamInfo> {
        params::infos(&self.schema())
    }
}

/// A node with its params: ready to run.
pub trait BoundNode: Send + Sync {
    /// All params with defaults filled in, typed and then written as JSON: what a key is made of.
    fn params(&self) -> &Value;
    /// Runs the node.
    fn run(&self, inputs: &mut PortValues, cx: Context) -> Result<Arc<dyn AnyArtefact>, NodeError>;
}

struct Bound<N: Node> {
    params: N::Params,
    canonical: Value,
}

impl<N: Node> BoundNode for Bound<N> {
    fn params(&self) -> &Value {
        &self.canonical
    }
    fn run(&self, inputs: &mut PortValues, cx: Context) -> Result<Arc<dyn AnyArtefact>, NodeError> {
        Ok(Arc::new(N::run(&self.params, N::Inputs::take(inputs)?, cx)?))
    }
}

impl<N: Node> AnyNode for N {
    fn kind(&self) -> &'static str {
        N::KIND
    }
    fn version(&self) -> u32 {
        N::VERSION
    }
    fn doc(&self) -> &'static str {
        N::DOC
    }
    fn example(&self) -> &'static str {
        N::EXAMPLE
    }
    fn ports(&self) -> &'static [Port] {
        N::Inputs::PORTS
    }
    fn output(&self) -> ArtefactType {
        ArtefactType::of::<N::Output>()
    }
    fn schema(&self) -> Value {
        params::schema_of::<N::Params>()
    }
    fn bind(&self, fields: &[(&str, &str)]) -> Result<Arc<dyn BoundNode>, Vec<ParamError>> {
        let params: N::Params = params::parse(fields)?;
        let canonical = serde_json::to_value(&params)
            .map_err(|e| vec![ParamError { param: String::new(), span: 0..0, message: e.to_string() }])?;
        let mut errors = params::not_finite(&params);
        let mut others = params::out_of_range(&params::infos(&self.schema()), &canonical);
        others.extend(N::check(&params).into_iter().map(|(param, message)| ParamError {
            param: param.to_owned(),
            span: 0..0,
            message,
        }));
        // A number that is none is in no range either: it is enough to say the former.
        others.retain(|other| errors.iter().all(|e| e.param != other.param));
        errors.extend(others);
        if errors.is_empty() { Ok(Arc::new(Bound::<N> { params, canonical })) } else { Err(errors) }
    }
}
