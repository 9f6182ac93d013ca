//! Cache keys: what the output of a call depends on, and nothing else.
//!
//! A key holds the kind and version of the node, the type and format of its output, its typed
//! params, the content of the files that its params name, and the content of its inputs. Paths,
//! names of nodes, the order of the graph file, modification times, and params of the run (workers,
//! memory) are not in it.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::str::FromStr;

use petgraph::Direction;
use petgraph::graph::NodeIndex;
use petgraph::visit::EdgeRef;
use salient_sdk::{FileParam, NodeError};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::sources::Sources;
use crate::graph::{Call, Plan};

/// Version of how keys are made; bumped whenever [`Ingredients::key`] changes.
const KEY_FORMAT: u32 = 1;

/// A blake3 hash of 256 bits, written as hexadecimal.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Digest([u8; 32]);

impl Digest {
    /// The hash of some bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The hash of all that a file holds.
    pub fn of_file(file: &mut File) -> io::Result<Self> {
        file.seek(SeekFrom::Start(0))?;
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(file)?;
        Ok(Self::finish(&hasher))
    }

    /// Stands for the output of a call that failed; no output has it, as it is not the hash of one.
    #[must_use]
    pub fn of_nothing() -> Self {
        Self::of(b"failed")
    }

    /// The hash that a hasher has arrived at.
    #[must_use]
    pub fn finish(hasher: &blake3::Hasher) -> Self {
        Self(*hasher.finalize().as_bytes())
    }

    /// The first twelve digits: enough for people.
    #[must_use]
    pub fn short(&self) -> String {
        self.to_string().chars().take(12).collect()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(blake3::Hash::from_bytes(self.0).to_hex().as_str())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl From<Digest> for String {
    fn from(digest: Digest) -> Self {
        digest.to_string()
    }
}

impl FromStr for Digest {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let hash = blake3::Hash::from_hex(text).map_err(|e| format!("`{text}`: {e}"))?;
        Ok(Self(*hash.as_bytes()))
    }
}

impl TryFrom<String> for Digest {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// An input file: what it holds, and where it was (for messages only).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileIngredient {
    /// Hash of its content.
    pub digest: Digest,
    /// Its path; not in the key.
    pub path: String,
}

/// An input: what it holds, and who made it (for messages only).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputIngredient {
    /// The port.
    pub port: String,
    /// The label on a port that takes many.
    pub label: String,
    /// Hash of the artefact's bytes.
    pub digest: Digest,
    /// Address of its producer; not in the key.
    pub from: String,
}

/// All that the output of a call depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ingredients {
    /// Kind of the node.
    pub kind: String,
    /// Version of the node.
    pub version: u32,
    /// Type of its output.
    pub output: String,
    /// Version of that type's byte layout.
    pub format: u32,
    /// Typed params; a file param is its lower-case extension.
    pub params: Value,
    /// Input files by param.
    pub files: BTreeMap<String, FileIngredient>,
    /// Inputs by port, within a port in the order of their wires.
    pub inputs: Vec<InputIngredient>,
}

impl Ingredients {
    /// The cache key. Further files that the node reads beside its own are verified against the
    /// record of the output (see [`super::record`]), as nobody knows them before it has run.
    #[must_use]
    pub fn key(&self) -> Digest {
        let files: BTreeMap<&String, Digest> = self.files.iter().map(|(param, file)| (param, file.digest)).collect();
        let inputs: Vec<_> = self.inputs.iter().map(|i| json!([i.port, i.label, i.digest])).collect();
        let key = json!([KEY_FORMAT, self.kind, self.version, self.output, self.format, self.params, files, inputs]);
        Digest::of(canonical(&key).as_bytes())
    }

    /// What is known of a call before its inputs are: everything but `inputs`.
    ///
    /// The error says which input file cannot be read.
    pub fn own(plan: &Plan, call: NodeIndex, sources: &Sources) -> Result<Self, NodeError> {
        let it = &plan.dag[call];
        let mut files = BTreeMap::new();
        for (param, path) in &it.files {
            let digest = sources.digest(path)?.ok_or_else(|| sources.absent(path))?;
            files.insert(param.clone(), FileIngredient { digest, path: path.display().to_string() });
        }
        let (params, output) = (Self::params_of(it), it.node.output());
        Ok(Self {
            kind: it.node.kind().to_owned(),
            version: it.node.version(),
            output: output.name.to_owned(),
            format: output.format,
            params,
            files,
            inputs: Vec::new(),
        })
    }

    /// The typed params of a call, a file param as its extension.
    #[must_use]
    pub fn params_of(call: &Call) -> Value {
        let mut params = call.bound.params().clone();
        for param in call.files.keys() {
            if let Some(Value::String(text)) = params.get_mut(param) {
                *text = FileParam(std::mem::take(text)).extension();
            }
        }
        params
    }

    /// Adds the inputs, given the content of each producer's output; `None` for one that failed, at a port that does without it.
    #[must_use]
    pub fn with_inputs(mut self, plan: &Plan, call: NodeIndex, digest: impl Fn(NodeIndex) -> Option<Digest>) -> Self {
        let input = |(wire, from): (&crate::graph::Wire, NodeIndex)| InputIngredient {
            port: wire.port.to_owned(),
            label: wire.label.clone(),
            digest: digest(from).unwrap_or_else(Digest::of_nothing),
            from: plan.name(from).to_owned(),
        };
        self.inputs = wires(plan, call).into_iter().map(input).collect();
        self.inputs.sort_by(|a, b| a.port.cmp(&b.port));
        self
    }
}

/// What is wired to a call, in the order of the wires.
#[must_use]
pub fn wires(plan: &Plan, call: NodeIndex) -> Vec<(&crate::graph::Wire, NodeIndex)> {
    let mut edges: Vec<_> = plan.dag.edges_directed(call, Direction::Incoming).collect();
    edges.sort_by_key(EdgeRef::id);
    edges.into_iter().map(|edge| (edge.weight(), edge.source())).collect()
}

/// JSON with sorted keys and without spaces, whatever map `serde_json` was built with.
#[must_use]
pub fn canonical(value: &Value) -> String {
    let mut out = String::new();
    write_canonical(value, &mut out);
    out
}

fn write_canonical(value: &Value, out: &mut String) {
    match value {
        Value::Array(items) => {
            out.push('[');
            for (i, item) in items.iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                write_canonical(item, out);
            }
            out.push(']');
        }
        Value::Object(entries) => {
            let mut sorted: Vec<_> = entries.iter().collect();
            sorted.sort_by_key(|(name, _)| *name);
            out.push('{');
            for (i, (name, item)) in sorted.into_iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                out.push_str(&Value::from(name.as_str()).to_string());
                out.push(':');
                write_canonical(item, out);
            }
            out.push('}');
        }
        plain => out.push_str(&plain.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ingredients() -> Ingredients {
        let file = FileIngredient { digest: Digest::of(b"mesh"), path: "a/cat.obj".into() };
        let input = |port: &str, label: &str| InputIngredient {
            port: port.into(),
            label: label.into(),
            digest: Digest::of(label.as_bytes()),
            from: "x".into(),
        };
        Ingredients {
            kind: "k".into(),
            version: 1,
            output: "o".into(),
            format: 1,
            params: json!({"path": "obj", "radius": 1.5}),
            files: BTreeMap::from([("path".into(), file)]),
            inputs: vec![input("p", "a"), input("p", "b"), input("q", "")],
        }
    }

    #[test]
    fn names_and_paths_are_not_in_the_key() {
        let mut other = ingredients();
        other.files.get_mut("path").unwrap().path = "elsewhere".into();
        other.inputs[0].from = "renamed".into();
        assert_eq!(other.key(), ingredients().key());
    }

    #[test]
    fn everything_else_is_in_the_key() {
        let change: [fn(&mut Ingredients); 11] = [
            |x| x.kind.push('!'),
            |x| x.version += 1,
            |x| x.output.push('!'),
            |x| x.format += 1,
            |x| x.params["radius"] = json!(1.6),
            |x| x.params["path"] = json!("off"),
            |x| x.files.get_mut("path").unwrap().digest = Digest::of(b"other"),
            |x| x.inputs[0].digest = Digest::of(b"other"),
            |x| x.inputs[0].label = "c".into(),
            |x| x.inputs[2].port = "r".into(),
            |x| x.inputs.swap(0, 1),
        ];
        let mut keys: Vec<_> = change
            .iter()
            .map(|change| {
                let mut x = ingredients();
                change(&mut x);
                x.key()
            })
            .collect();
        keys.push(ingredients().key());
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), change.len() + 1);
    }

    #[test]
    fn canonical_json_sorts_keys_at_every_depth() {
        let text = r#"{"b": [{"z": 1, "a": "\n"}], "a": null}"#;
        let value: Value = serde_json::from_str(text).unwrap();
        assert_eq!(canonical(&value), r#"{"a":null,"b":[{"a":"\n","z":1}]}"#);
    }

    #[test]
    fn digests_survive_their_text() {
        let digest = Digest::of(b"x");
        assert_eq!(digest.to_string().parse::<Digest>().unwrap(), digest);
        assert!("xyz".parse::<Digest>().is_err());
    }
}
