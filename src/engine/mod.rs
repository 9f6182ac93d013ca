//! Runs a plan: keys, cache, scheduling, events.
//!
//! | module | holds |
//! |---|---|
//! | [`key`] | what an output depends on, and the key made of it |
//! | [`sources`] | input files, one consistent snapshot a run |
//! | [`fingerprints`] | hashes of files from run to run, for watching |
//! | [`record`] | what the cache remembers of an output |
//! | [`cache`] | the cache directory: objects and records |
//! | [`memo`] | values of single items, remembered between executions |
//! | [`upkeep`] | its size, verification and collection |
//! | [`running`] | which processes use it now |
//! | [`history`], `remember` | recent runs with their plans, and how they are remembered |
//! | [`schedule`] | [`run`]: workers, order, outcome |
//! | [`event`] | all that a run tells the outside |
//! | `working` | memory of calls that work alone |
//! | [`forecast`], [`why`] | what a run would do, and why |

pub mod cache;
mod cone;
mod coordinator;
mod estimate;
pub mod event;
pub mod fingerprints;
pub mod forecast;
mod held;
pub mod history;
pub mod key;
pub mod memo;
pub mod record;
mod remember;
pub mod running;
pub mod schedule;
pub mod sources;
pub mod upkeep;
pub mod why;
mod worker;
mod working;

pub use cache::{Cache, CacheError};
pub use event::{Event, Totals};
pub use key::{Digest, Ingredients};
pub use record::Record;
pub use schedule::{Cancel, Options, Outcome, State, run, run_on};
