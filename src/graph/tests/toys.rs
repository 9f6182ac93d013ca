//! Toy nodes, and graphs in a temporary folder.

use std::path::Path;

use salient_sdk::{
    AnyNode, Artefact, Context, Decoder, Encoder, FileParam, FormatError, Inputs, Node, NodeError, Port, PortValues,
    Registry,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::diagnostics::Diagnostics;
use crate::graph::{Overrides, Plan, plan};

macro_rules! artefact {
    ($name:ident, $type:literal) => {
        pub struct $name;
        impl Artefact for $name {
            const TYPE: &'static str = $type;
            const FORMAT: u32 = 1;
            const DOC: &'static str = "A toy.";
            fn encode(&self, _: &mut Encoder) {}
            fn decode(_: &Decoder) -> Result<Self, FormatError> {
                Ok(Self)
            }
            fn json(&self) -> Value {
                Value::Null
            }
            fn summary(&self) -> Vec<(&'static str, String)> {
                Vec::new()
            }
        }
    };
}

artefact!(Number, "number");
artefact!(Words, "words");

macro_rules! node {
    ($name:ident, $kind:literal, $params:ty, $inputs:ty, $output:ident) => {
        pub struct $name;
        impl Node for $name {
            const KIND: &'static str = $kind;
            const VERSION: u32 = 1;
            const DOC: &'static str = "A toy.";
            const EXAMPLE: &'static str = "";
            type Params = $params;
            type Inputs = $inputs;
            type Output = $output;
            fn run(_: &$params, _: $inputs, _: Context) -> Result<$output, NodeError> {
                Ok($output)
            }
        }
    };
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SourceParams {
    /// The file to read.
    pub path: FileParam,
    /// What to multiply by.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub scale: f64,
}

#[derive(Default, Serialize, Deserialize, JsonSchema)]
pub enum Mode {
    #[default]
    Exact,
    Rounded,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AddParams {
    /// What to add. In metres.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub offset: f64,
    /// How to round.
    #[serde(default)]
    pub mode: Mode,
    /// A table of weights.
    #[serde(default)]
    pub table: Option<FileParam>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoParams {}

pub struct AddInputs;

impl Inputs for AddInputs {
    const PORTS: &'static [Port] =
        &[Port::one::<Number>("left", "a number"), Port::optional::<Number>("right", "another number")];
    fn take(_: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self)
    }
}

pub struct Terms;

impl Inputs for Terms {
    const PORTS: &'static [Port] = &[Port::many::<Number>("terms", "numbers")];
    fn take(_: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self)
    }
}

node!(Source, "source", SourceParams, (), Number);
node!(Add, "add", AddParams, AddInputs, Number);
node!(Sum, "sum", NoParams, Terms, Number);
node!(Say, "say", NoParams, (), Words);

pub const TOYS: &[&dyn AnyNode] = &[&Source, &Add, &Sum, &Say];

/// A folder with graphs and files.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// A folder with the given files.
    pub fn new(files: &[(&str, &str)]) -> Self {
        let folder = Self(tempfile::tempdir().expect("a temporary folder"));
        for (name, text) in files {
            folder.write(name, text);
        }
        folder
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, text: &str) {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().expect("inside the folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    }

    pub fn try_plan(&self, overrides: &Overrides) -> Result<Plan, Diagnostics> {
        let registry = Registry::new(&[TOYS]).expect("distinct toys");
        plan(&self.path().join("main.ron"), overrides, &registry)
    }

    pub fn plan(&self) -> Plan {
        self.plan_with(&[])
    }

    pub fn plan_with(&self, sets: &[&str]) -> Plan {
        self.try_plan(&sets_of(sets)).unwrap_or_else(|e| panic!("{e}"))
    }

    /// What is wrong with a graph that is wrong.
    pub fn report(&self, overrides: &Overrides) -> Diagnostics {
        let Err(report) = self.try_plan(overrides) else { panic!("the graph is right") };
        report
    }

    /// What is wrong, each as `code @text: message | hint`, with the folder's name taken out.
    pub fn errors_with(&self, overrides: &Overrides) -> Vec<String> {
        let report = self.report(overrides);
        assert!(!report.render(false).is_empty() && !report.render(true).is_empty());
        let folder = format!("{}/", self.path().display());
        let one = |d: &crate::diagnostics::Diagnostic| {
            let hint = d.hint.clone().unwrap_or_default();
            let text = report.text(d);
            format!("{} @{text}@ {} | {hint}", d.code, d.message)
                .replace(&folder, "")
                .replace(&*self.path().to_string_lossy(), ".")
        };
        report.iter().map(one).collect()
    }

    pub fn errors(&self) -> Vec<String> {
        self.errors_with(&Overrides::default())
    }
}

pub fn sets_of(sets: &[&str]) -> Overrides {
    Overrides { sets: sets.iter().map(|s| (*s).to_owned()).collect(), variants: None }
}

pub fn variants_of(names: &[&str]) -> Overrides {
    Overrides { sets: Vec::new(), variants: Some(names.iter().map(|s| (*s).to_owned()).collect()) }
}

/// A folder whose `main.ron` has these nodes, and files `a.txt` and `b.txt`.
pub fn nodes(nodes: &str, show: &str) -> Folder {
    let text = format!("(format: 1, nodes: {{{nodes}}}, show: [\"{show}\"])");
    Folder::new(&[("main.ron", &text), ("a.txt", ""), ("b.txt", "")])
}

/// All calls, one a line: `address = kind(port[label]: address, ..) params`.
pub fn listing(plan: &Plan) -> String {
    use petgraph::Direction;
    use petgraph::visit::EdgeRef;
    let mut lines = Vec::new();
    for call in plan.dag.node_indices() {
        let mut edges: Vec<_> = plan.dag.edges_directed(call, Direction::Incoming).collect();
        edges.sort_by_key(EdgeRef::id);
        let wire = |e: &petgraph::graph::EdgeReference<'_, crate::graph::Wire>| {
            let label = &e.weight().label;
            let label = if label.is_empty() { String::new() } else { format!("[{label}]") };
            format!("{}{label}: {}", e.weight().port, plan.name(e.source()))
        };
        let wires: Vec<String> = edges.iter().map(wire).collect();
        let node = &plan.dag[call];
        lines.push(format!(
            "{} = {}({}) {}",
            node.addresses.join(" "),
            node.node.kind(),
            wires.join(", "),
            node.bound.params()
        ));
    }
    lines.join("\n")
}

/// A param of the call at an address.
pub fn param(plan: &Plan, address: &str, name: &str) -> Value {
    plan.dag[plan.addresses[address]].bound.params()[name].clone()
}
