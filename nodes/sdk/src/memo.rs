//! Values of single items that outlive an execution: a node over many independent items computes only those it has not met before.
//!
//! An output is cached as a whole, by all that it depends on. A node whose output is made of many items would compute all of them again
//! when one is added. With [`Context::map_memo`] each item has a key of its own: the kind and version of the node, the part of its params
//! that the item's value depends on, and the item's content. The host keeps values by that key, and the output is the same with and
//! without them.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use serde_json::Value;

use crate::context::{Context, Host};
use crate::error::NodeError;

/// The hash of an item's content.
pub type ItemKey = [u8; 32];

/// Values are handed to the host when so many are done, so that little is lost if the process is killed.
const BATCH: usize = 256;

/// How the items of a node are told apart, computed and written down.
pub trait Memo: Sync {
    /// An item. Its value depends on [`Memo::scope`] and on what [`Memo::content`] hashes, and on nothing else.
    type Item: Sync;
    /// Its value.
    type Value: Send;

    /// What items are called in the figures of the run: `patches` gives `patches computed` and `patches remembered`.
    fn name(&self) -> &'static str;
    /// The part of the node's params that values depend on. Kind and version of the node are added by the host.
    fn scope(&self) -> Value;
    /// Hashes all of the item that its value depends on.
    fn content(&self, item: &Self::Item, hash: &mut ItemHasher);
    /// A guess at how long the item takes, in any unit: long ones are begun first.
    fn weight(&self, _item: &Self::Item) -> usize {
        0
    }
    /// The value of an item: a pure function.
    fn compute(&self, item: &Self::Item, cx: Context) -> Result<Self::Value, NodeError>;
    /// The bytes to keep; `None` for a value that is not to be kept, such as the report of a failure.
    fn encode(&self, value: &Self::Value) -> Option<Vec<u8>>;
    /// The value of these bytes, bit for bit what was encoded; `None` if they are none, and then the value is computed.
    fn decode(&self, bytes: &[u8]) -> Option<Self::Value>;
}

/// Hashes the content of an item.
#[derive(Default)]
pub struct ItemHasher(blake3::Hasher);

impl ItemHasher {
    /// Adds numbers with their count, by their bits.
    pub fn f64s(&mut self, values: &[f64]) {
        self.words(values.len(), values.iter().map(|x| x.to_le_bytes()));
    }

    /// Adds integers with their count.
    pub fn u32s(&mut self, values: &[u32]) {
        self.words(values.len(), values.iter().map(|x| x.to_le_bytes()));
    }

    /// Adds the hash of a part.
    pub fn part(&mut self, key: &ItemKey) {
        self.0.update(key);
    }

    fn words<const N: usize>(&mut self, count: usize, words: impl Iterator<Item = [u8; N]>) {
        self.0.update(&(count as u64).to_le_bytes());
        let bytes: Vec<u8> = words.flatten().collect();
        self.0.update(&bytes);
    }

    /// The hash of all that was added: of a part that many items share, so that it is hashed once.
    #[must_use]
    pub fn finish(&self) -> ItemKey {
        *self.0.finalize().as_bytes()
    }
}

impl Context<'_> {
    /// The values of all items in order, of which the host may remember some; the others are computed on the workers that are idle.
    ///
    /// The values do not depend on what is remembered, nor on the number of workers. If the run is stopped or an item fails, values done
    /// by then are kept all the same. How many were computed and remembered is recorded among the figures of the run.
    pub fn map_memo<M: Memo>(&self, memo: &M, items: &[M::Item]) -> Result<Vec<M::Value>, NodeError> {
        let scope = memo.scope();
        let keys = self.map(items, |_, item| {
            let mut hash = ItemHasher::default();
            memo.content(item, &mut hash);
            Ok(hash.finish())
        })?;
        let recalled = self.host().recall(&scope, &keys)?;
        let mut values: Vec<Option<M::Value>> =
            recalled.into_iter().map(|bytes| bytes.and_then(|bytes| memo.decode(&bytes))).collect();
        values.resize_with(items.len(), || None);
        let mut missing: Vec<usize> = (0..items.len()).filter(|&i| values[i].is_none()).collect();
        missing.sort_by_key(|&i| std::cmp::Reverse(memo.weight(&items[i])));
        let pending = Pending { host: self.host(), scope: &scope, items: Mutex::default() };
        let (work, done) = (missing.iter().map(|&i| memo.weight(&items[i])).sum::<usize>(), AtomicUsize::new(0));
        let computed = self.map(&missing, |_, &i| {
            let value = memo.compute(&items[i], *self)?;
            if let Some(bytes) = memo.encode(&value) {
                pending.add(keys[i], bytes)?;
            }
            let weight = memo.weight(&items[i]);
            let done = done.fetch_add(weight, Ordering::Relaxed) + weight;
            self.progress(done as f64 / work.max(1) as f64);
            Ok(value)
        });
        let kept = pending.flush();
        let computed = computed?; // this error first: it is the reason for the other, if there are both
        kept?;
        self.record(&format!("{} computed", memo.name()), missing.len());
        self.record(&format!("{} remembered", memo.name()), items.len() - missing.len());
        for (i, value) in missing.into_iter().zip(computed) {
            values[i] = Some(value);
        }
        Ok(values.into_iter().flatten().collect())
    }
}

/// Values not handed over yet: they are when dropped, so after a panic too.
struct Pending<'a> {
    host: &'a dyn Host,
    scope: &'a Value,
    items: Mutex<Vec<(ItemKey, Vec<u8>)>>,
}

impl Pending<'_> {
    fn add(&self, key: ItemKey, bytes: Vec<u8>) -> Result<(), NodeError> {
        let mut items = self.items.lock().unwrap_or_else(PoisonError::into_inner);
        items.push((key, bytes));
        if items.len() < BATCH {
            return Ok(());
        }
        let full = std::mem::take(&mut *items);
        drop(items);
        self.host.keep(self.scope, full)
    }

    fn flush(&self) -> Result<(), NodeError> {
        let items = std::mem::take(&mut *self.items.lock().unwrap_or_else(PoisonError::into_inner));
        if items.is_empty() { Ok(()) } else { self.host.keep(self.scope, items) }
    }
}

impl Drop for Pending<'_> {
    fn drop(&mut self) {
        // After a panic there is nobody to tell.
        let _ = self.flush();
    }
}
