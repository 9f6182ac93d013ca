//! Values of single items (see `salient_sdk::memo`), many to a file.
//!
//! ```text
//! memo/ab/<group>/<digest>.memo   a pack: the values that one execution added, named by the hash of its bytes
//! ```
//!
//! A group is made of the kind and version of the node and the params that its items depend on. Packs are content-addressed, checked
//! when read, written whole or not at all, and never changed. When a group has many, they are merged: the merged pack is there before
//! the others go, so a reader that finds one gone looks again, and at worst computes what it did not find.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use salient_sdk::ItemKey;
use serde_json::{Value, json};

use super::cache::{Cache, CacheError, Entry, list, remove, touch};
use super::key::{Digest, canonical};

/// First bytes of a pack; bumped with its layout.
const MAGIC: &[u8; 16] = b"salient memo 1\n\0";
/// A key and where its value ends.
const INDEX_ENTRY: usize = 40;
/// A group with more packs is merged.
const MAX_PACKS: usize = 16;
/// Packs of this size are left as they are.
const FULL: usize = 16 << 20;
/// How often a reader looks again for packs that were merged under its eyes.
const LOOKS: usize = 3;

/// Values by the keys of their items.
pub type Items = BTreeMap<ItemKey, Vec<u8>>;

/// The group of all items of one kind and version of node, and one scope.
#[must_use]
pub fn group(kind: &str, version: u32, scope: &Value) -> Digest {
    Digest::of(canonical(&json!(["memo", kind, version, scope])).as_bytes())
}

/// What was found of some items.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Recalled {
    /// The values found.
    pub items: Items,
    /// Damaged packs; they have been removed.
    pub corrupt: Vec<PathBuf>,
}

impl Cache {
    fn group_dir(&self, group: &Digest) -> PathBuf {
        let name = group.to_string();
        self.root.join("memo").join(&name[..2]).join(name)
    }

    /// The values that are known of these items.
    pub fn recall(&self, group: &Digest, keys: &[ItemKey]) -> Result<Recalled, CacheError> {
        let mut recalled = Recalled::default();
        for _ in 0..LOOKS {
            let mut gone = false;
            for path in list(&self.group_dir(group))? {
                let before = recalled.items.len();
                match self.pack(&path)? {
                    Entry::Found(bytes) => {
                        let pack = Pack::parse(&bytes);
                        for (key, value) in keys.iter().filter_map(|key| Some((key, pack.as_ref()?.get(key)?))) {
                            recalled.items.entry(*key).or_insert_with(|| value.to_vec());
                        }
                    }
                    Entry::Missing => gone = true,
                    Entry::Corrupt(path) => recalled.corrupt.push(path),
                }
                if recalled.items.len() > before {
                    touch(&path);
                }
                if recalled.items.len() == keys.len() {
                    return Ok(recalled);
                }
            }
            if !gone {
                break;
            }
        }
        Ok(recalled)
    }

    /// Keeps the values of some items.
    pub fn keep(&self, group: &Digest, items: &Items) -> Result<(), CacheError> {
        if items.is_empty() {
            return Ok(());
        }
        let dir = self.group_dir(group);
        self.put_pack(&dir, items)?;
        if list(&dir)?.len() > MAX_PACKS {
            self.merge(&dir)?;
        }
        Ok(())
    }

    fn put_pack(&self, dir: &Path, items: &Items) -> Result<PathBuf, CacheError> {
        let bytes = encode(items);
        let path = dir.join(format!("{}.memo", Digest::of(&bytes)));
        self.write(&path, &bytes)?;
        Ok(path)
    }

    /// Makes one pack of all that are not full. Two processes that merge the same packs write the same file.
    fn merge(&self, dir: &Path) -> Result<(), CacheError> {
        let (mut items, mut merged) = (Items::new(), Vec::new());
        for path in list(dir)? {
            let Entry::Found(bytes) = self.pack(&path)? else { continue };
            if bytes.len() >= FULL {
                continue;
            }
            let Some(pack) = Pack::parse(&bytes) else { continue };
            items.extend(pack.iter().map(|(key, value)| (key, value.to_vec())));
            merged.push(path);
        }
        if merged.len() < 2 {
            return Ok(());
        }
        let whole = self.put_pack(dir, &items)?;
        for path in merged.iter().filter(|path| **path != whole) {
            remove(path)?;
        }
        Ok(())
    }

    /// The bytes of a pack, checked against its name; a damaged one is removed.
    pub(super) fn pack(&self, path: &Path) -> Result<Entry<Vec<u8>>, CacheError> {
        let named = path.file_stem().and_then(|stem| stem.to_str()).and_then(|name| name.parse::<Digest>().ok());
        let whole = |bytes: &[u8]| Some(Digest::of(bytes)) == named && Pack::parse(bytes).is_some();
        match fs::read(path) {
            Ok(bytes) if whole(&bytes) => Ok(Entry::Found(bytes)),
            Ok(_) => Ok(self.discard(path, whole)?.map_or(Entry::Corrupt(path.to_owned()), Entry::Found)),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Entry::Missing),
            Err(e) => Err(CacheError::new("read", path, &e)),
        }
    }
}

fn encode(items: &Items) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend((items.len() as u64).to_le_bytes());
    let mut end = 0u64;
    for (key, value) in items {
        end += value.len() as u64;
        bytes.extend(key);
        bytes.extend(end.to_le_bytes());
    }
    for value in items.values() {
        bytes.extend(value);
    }
    bytes
}

/// A pack's index, sorted by key, and its values.
struct Pack<'a> {
    index: &'a [[u8; INDEX_ENTRY]],
    values: &'a [u8],
}

impl<'a> Pack<'a> {
    /// `None` unless the bytes are a pack from beginning to end.
    fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (count, rest) = bytes.strip_prefix(MAGIC)?.split_first_chunk()?;
        let size = usize::try_from(u64::from_le_bytes(*count)).ok()?.checked_mul(INDEX_ENTRY)?;
        let (index, values) = rest.split_at_checked(size)?;
        let pack = Self { index: index.as_chunks().0, values };
        let ends = (0..pack.index.len()).map(|i| pack.end(i));
        let ascending = ends.clone().is_sorted() && pack.index.is_sorted_by(|a, b| a[..32] < b[..32]);
        (ascending && ends.max().unwrap_or(0) == values.len()).then_some(pack)
    }

    /// Where value `i` ends; past everything if that is no place.
    fn end(&self, i: usize) -> usize {
        let end = self.index[i].last_chunk().map_or(u64::MAX, |end| u64::from_le_bytes(*end));
        usize::try_from(end).unwrap_or(usize::MAX)
    }

    fn value(&self, i: usize) -> &'a [u8] {
        let start = if i == 0 { 0 } else { self.end(i - 1) };
        &self.values[start..self.end(i)]
    }

    fn get(&self, key: &ItemKey) -> Option<&'a [u8]> {
        let at = self.index.binary_search_by(|entry| entry[..32].cmp(key)).ok()?;
        Some(self.value(at))
    }

    fn iter(&self) -> impl Iterator<Item = (ItemKey, &'a [u8])> {
        (0..self.index.len()).filter_map(|i| Some((*self.index[i].first_chunk()?, self.value(i))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(i: u8) -> (ItemKey, Vec<u8>) {
        ([i.wrapping_mul(37); 32], vec![i; usize::from(i % 5)])
    }

    fn cache() -> (tempfile::TempDir, Cache) {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::open(dir.path()).unwrap();
        (dir, cache)
    }

    #[test]
    fn packs_are_read_as_written_and_nothing_else_is_a_pack() {
        let items: Items = (0..9).map(item).collect();
        let bytes = encode(&items);
        let pack = Pack::parse(&bytes).unwrap();
        assert_eq!(pack.iter().map(|(k, v)| (k, v.to_vec())).collect::<Items>(), items);
        assert!(items.iter().all(|(k, v)| pack.get(k) == Some(&v[..])) && pack.get(&[1; 32]).is_none());
        assert!(Pack::parse(&encode(&Items::new())).is_some());
        for cut in 0..bytes.len() {
            assert!(Pack::parse(&bytes[..cut]).is_none(), "cut at {cut}");
        }
        // Any damage in the header or the index is an error or another pack, never a panic.
        for at in 0..bytes.len() {
            let mut broken = bytes.clone();
            broken[at] ^= 0x80;
            if let Some(pack) = Pack::parse(&broken) {
                assert_eq!(pack.iter().count(), 9);
            }
        }
    }

    #[test]
    fn many_packs_become_one_and_lose_nothing() {
        let (_dir, cache) = cache();
        let scope = group("k", 1, &json!(null));
        let all: Items = (0..100).map(item).collect();
        for (key, value) in &all {
            cache.keep(&scope, &Items::from([(*key, value.clone())])).unwrap();
        }
        assert!(list(&cache.group_dir(&scope)).unwrap().len() <= MAX_PACKS);
        let keys: Vec<ItemKey> = all.keys().copied().collect();
        assert_eq!(cache.recall(&scope, &keys).unwrap(), Recalled { items: all, corrupt: vec![] });
        for other in [group("k", 2, &json!(null)), group("l", 1, &json!(null)), group("k", 1, &json!(1))] {
            assert_eq!(cache.recall(&other, &keys).unwrap(), Recalled::default());
        }
    }

    #[test]
    fn a_damaged_pack_is_removed_and_never_served() {
        let (_dir, cache) = cache();
        let scope = group("k", 1, &json!(null));
        let items: Items = (0..4).map(item).collect();
        let keys: Vec<ItemKey> = items.keys().copied().collect();
        cache.keep(&scope, &items).unwrap();
        let path = list(&cache.group_dir(&scope)).unwrap().remove(0);
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut broken = whole.clone();
            broken[at] ^= 1;
            fs::write(&path, &broken).unwrap();
            let recalled = cache.recall(&scope, &keys).unwrap();
            assert_eq!(recalled, Recalled { items: Items::new(), corrupt: vec![path.clone()] });
            assert!(!path.exists());
        }
        cache.keep(&scope, &items).unwrap();
        assert_eq!(cache.recall(&scope, &keys).unwrap().items, items);
    }

    #[test]
    fn processes_that_add_and_merge_at_once_serve_only_what_was_kept() {
        let (_dir, cache) = cache();
        let scope = group("k", 1, &json!(null));
        std::thread::scope(|threads| {
            for t in 0..4u8 {
                let (cache, scope) = (&cache, &scope);
                threads.spawn(move || {
                    for i in 0..40u8 {
                        let (key, value) = ([i, t].repeat(16).try_into().unwrap(), vec![t, i]);
                        cache.keep(scope, &Items::from([(key, value.clone())])).unwrap();
                        let found = cache.recall(scope, &[key]).unwrap();
                        assert!(found.corrupt.is_empty() && found.items.get(&key).is_none_or(|v| *v == value));
                    }
                });
            }
        });
        let keys: Vec<ItemKey> =
            (0..4u8).flat_map(|t| (0..40u8).map(move |i| [i, t].repeat(16).try_into().unwrap())).collect();
        assert_eq!(cache.recall(&scope, &keys).unwrap().items.len(), keys.len());
    }
}
