//! From RON text to a plan.

pub mod plan;

pub use plan::{Call, Plan, Shown, Wire};

mod temporary;
pub use temporary::{Diagnostics, Overrides, plan};
