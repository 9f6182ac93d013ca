//! Runs a plan: keys, cache, scheduling, events.
