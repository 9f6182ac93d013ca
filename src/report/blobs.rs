//! Arrays of a scene, by the hash of their bytes: equal arrays are kept once, and a page that has one never asks again.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::engine::Digest;

/// Arrays as little-endian bytes, by name.
#[derive(Clone, Debug, Default)]
pub struct Blobs(BTreeMap<String, Arc<[u8]>>);

impl Blobs {
    /// Keeps bytes, and says by which name.
    pub fn add(&mut self, bytes: Vec<u8>) -> String {
        let name: String = Digest::of(&bytes).to_string().chars().take(20).collect();
        self.0.entry(name.clone()).or_insert_with(|| bytes.into());
        name
    }

    /// Keeps single-precision numbers.
    pub fn floats<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) -> String {
        self.add(values.into_iter().flat_map(|x| (*x as f32).to_le_bytes()).collect())
    }

    /// Keeps integers.
    pub fn integers<'a>(&mut self, values: impl IntoIterator<Item = &'a u32>) -> String {
        self.add(values.into_iter().flat_map(|x| x.to_le_bytes()).collect())
    }

    /// Takes over all arrays of another collection.
    pub fn join(&mut self, other: &Self) {
        self.0.extend(other.0.iter().map(|(name, bytes)| (name.clone(), bytes.clone())));
    }

    /// The bytes of a name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Arc<[u8]>> {
        self.0.get(name)
    }

    /// All of them, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &[u8])> {
        self.0.iter().map(|(name, bytes)| (name.as_str(), &**bytes))
    }

    /// How many bytes there are.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.0.values().map(|bytes| bytes.len()).sum()
    }
}
