//! What the cache remembers of a computed output: all it was made from, for `--why` too.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use salient_sdk::{Defect, NodeError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use super::key::{Digest, Ingredients, canonical};
use super::sources::Sources;
use crate::graph::Call;

/// A file that a node asked for beside one of its own: part of what the output depends on, though
/// nobody knew it before the node had run.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Read {
    /// The file param beside whose file it lies.
    pub param: String,
    /// Its path relative to the folder of that file.
    pub beside: String,
    /// Hash of its content; `None` if it was not there.
    pub digest: Option<Digest>,
}

/// Where a file beside the one that `param` names is; `None` for a param without a file.
#[must_use]
pub fn beside(call: &Call, param: &str, relative: &str) -> Option<PathBuf> {
    Some(call.files.get(param)?.parent().unwrap_or(Path::new("")).join(relative))
}

/// The output of a call, and all it was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// What the key was made of.
    pub ingredients: Arc<Ingredients>,
    /// Files discovered while running, sorted.
    pub reads: Vec<Read>,
    /// Hash of the output's bytes, by which its object is found.
    pub digest: Digest,
    /// Size of the output in bytes.
    pub bytes: u64,
    /// How long it took to compute, in seconds.
    pub seconds: f64,
    /// The most memory that the process gained while it was computed, in bytes, if nothing else was done meanwhile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub working: Option<u64>,
    /// When it was computed, in milliseconds since 1970.
    pub when: u64,
    /// Figures that the node recorded.
    pub figures: Map<String, Value>,
    /// What is doubtful about the output.
    pub defects: Vec<Defect>,
}

impl Record {
    /// Names the record among those of one key: records of different reads do not replace each
    /// other.
    #[must_use]
    pub fn reads_digest(&self) -> Digest {
        let reads = serde_json::to_value(&self.reads).unwrap_or_default();
        Digest::of(canonical(&reads).as_bytes())
    }

    /// The first discovered read that is not as it was, if any.
    pub fn changed_read(&self, call: &Call, sources: &Sources) -> Result<Option<&Read>, NodeError> {
        for read in &self.reads {
            let now = match beside(call, &read.param, &read.beside) {
                Some(path) => sources.digest(&path)?,
                None => None,
            };
            if now != read.digest {
                return Ok(Some(read));
            }
        }
        Ok(None)
    }
}

#[derive(Deserialize)]
struct Sealed<'a> {
    check: Digest,
    #[serde(borrow)]
    record: &'a RawValue,
}

/// JSON that carries the hash of its own text.
pub fn seal(value: &impl Serialize) -> Result<String, serde_json::Error> {
    let text = serde_json::to_string(value)?;
    Ok(format!("{{\"check\":\"{}\",\"record\":{text}}}\n", Digest::of(text.as_bytes())))
}

/// Reads what [`seal`] wrote; `None` for anything else.
#[must_use]
pub fn unseal<T: DeserializeOwned>(text: &[u8]) -> Option<T> {
    let sealed: Sealed = serde_json::from_slice(text).ok()?;
    let record = sealed.record.get();
    (Digest::of(record.as_bytes()) == sealed.check).then(|| serde_json::from_str(record).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_byte_breaks_the_seal() {
        let sealed = seal(&serde_json::json!({"seconds": 0.1, "name": "x y"})).unwrap();
        let whole: Option<Value> = unseal(sealed.as_bytes());
        assert_eq!(whole.unwrap()["seconds"], 0.1);
        for at in 0..sealed.trim_end().len() {
            let mut broken = sealed.clone().into_bytes();
            broken[at] ^= 1;
            assert_eq!(unseal::<Value>(&broken), None, "byte {at}");
            assert_eq!(unseal::<Value>(&sealed.as_bytes()[..at]), None, "cut at {at}");
        }
    }
}
