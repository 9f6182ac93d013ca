//! The named, typed inputs of a node.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::artefact::{AnyArtefact, Artefact};
use crate::error::NodeError;

/// How many wires a port takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arity {
    /// Exactly one.
    One,
    /// None or one.
    Optional,
    /// Any number, each with a label: the name of its instance on an axis, or its position in a list of wires.
    Many,
    /// As `Many`, but a producer that fails does not stop the node: it runs without it, and [`PortValues::missing`] has its label.
    Surviving,
}

impl Arity {
    /// Whether a port takes any number of wires.
    #[must_use]
    pub fn is_many(self) -> bool {
        matches!(self, Self::Many | Self::Surviving)
    }
}

/// A named, typed input.
#[derive(Clone, Copy, Debug)]
pub struct Port {
    /// Its name in graph files.
    pub name: &'static str,
    /// [`Artefact::TYPE`] of what it takes.
    pub artefact: &'static str,
    /// How many wires it takes.
    pub arity: Arity,
    /// What it is for, one sentence.
    pub doc: &'static str,
}

impl Port {
    /// A port that must be wired once.
    #[must_use]
    pub const fn one<T: Artefact>(name: &'static str, doc: &'static str) -> Self {
        Self { name, artefact: T::TYPE, arity: Arity::One, doc }
    }

    /// A port that may stay open.
    #[must_use]
    pub const fn optional<T: Artefact>(name: &'static str, doc: &'static str) -> Self {
        Self { name, artefact: T::TYPE, arity: Arity::Optional, doc }
    }

    /// A port for all instances of a node along an axis.
    #[must_use]
    pub const fn many<T: Artefact>(name: &'static str, doc: &'static str) -> Self {
        Self { name, artefact: T::TYPE, arity: Arity::Many, doc }
    }

    /// A port for all instances of a node along an axis but those that failed, for nodes that sum up a whole database and are
    /// worth their result without some of it. The node must say in its output what is [missing](PortValues::missing).
    #[must_use]
    pub const fn surviving<T: Artefact>(name: &'static str, doc: &'static str) -> Self {
        Self { name, artefact: T::TYPE, arity: Arity::Surviving, doc }
    }
}

/// The typed inputs of a node: a struct of `Arc`s, taken from the wired values by name.
///
/// ```
/// # use std::sync::Arc;
/// use salient_sdk::{Inputs, Mesh, NodeError, Port, PortValues};
/// struct MyInputs {
///     mesh: Arc<Mesh>,
/// }
/// impl Inputs for MyInputs {
///     const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "the surface")];
///     fn take(from: &mut PortValues) -> Result<Self, NodeError> {
///         Ok(Self { mesh: from.one("mesh")? })
///     }
/// }
/// ```
pub trait Inputs: Sized {
    /// The ports, in the order in which they are documented.
    const PORTS: &'static [Port];

    /// Takes the wired values. The engine has checked names, types and arity.
    fn take(from: &mut PortValues) -> Result<Self, NodeError>;
}

/// For nodes without inputs.
impl Inputs for () {
    const PORTS: &'static [Port] = &[];
    fn take(_: &mut PortValues) -> Result<Self, NodeError> {
        Ok(())
    }
}

/// What is wired to each port: labelled artefacts.
#[derive(Default)]
pub struct PortValues {
    values: BTreeMap<String, Vec<Labelled>>,
    missing: BTreeMap<String, Vec<String>>,
}

type Labelled = (String, Arc<dyn AnyArtefact>);

impl PortValues {
    /// Wires one more artefact to a port; `label` is as in [`Arity::Many`], else empty.
    pub fn push(&mut self, port: &str, label: &str, value: Arc<dyn AnyArtefact>) {
        self.values.entry(port.to_owned()).or_default().push((label.to_owned(), value));
    }

    /// Says that the producer wired to a [surviving](Arity::Surviving) port under this label failed.
    pub fn push_missing(&mut self, port: &str, label: &str) {
        self.missing.entry(port.to_owned()).or_default().push(label.to_owned());
    }

    /// Labels of what failed on the way to a [surviving](Arity::Surviving) port, in the order of the axis.
    pub fn missing(&mut self, port: &str) -> Vec<String> {
        self.missing.remove(port).unwrap_or_default()
    }

    /// The one artefact at a port.
    pub fn one<T: Artefact>(&mut self, port: &str) -> Result<Arc<T>, NodeError> {
        self.optional(port)?.ok_or_else(|| NodeError::new(format!("nothing is wired to `{port}`")))
    }

    /// The artefact at a port that may be open.
    pub fn optional<T: Artefact>(&mut self, port: &str) -> Result<Option<Arc<T>>, NodeError> {
        Ok(self.many(port)?.pop().map(|(_, value)| value))
    }

    /// All artefacts at a port with their labels, in the order of the axis.
    pub fn many<T: Artefact>(&mut self, port: &str) -> Result<Vec<(String, Arc<T>)>, NodeError> {
        let values = self.values.remove(port).unwrap_or_default();
        values
            .into_iter()
            .map(|(label, value)| {
                let found = value.type_name();
                let typed = value
                    .into_any()
                    .downcast::<T>()
                    .map_err(|_| NodeError::new(format!("`{port}` takes `{}`, but `{found}` is wired", T::TYPE)))?;
                Ok((label, typed))
            })
            .collect()
    }
}
