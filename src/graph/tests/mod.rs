//! Tests of the way from text to plan, on toy nodes.

mod axes;
mod errors;
mod fuzz;
mod overrides;
mod plans;
mod toys;
