//! Integer quadratic programming over one-to-one partial assignments, the optimisation behind shape matching.
//!
//! The problem, for candidate pairs `a = (left i, right j)` with `x_a` in {0, 1}:
//!
//! ```text
//! maximise   sum_a c_a x_a  +  sum_{a<b} h_ab x_a x_b  -  sum_{i unmatched} l_i  -  sum_{j unmatched} r_j
//! subject to each left feature and each right feature in at most one chosen pair
//! ```
//!
//! **Relation to Hu & Hua (2009), eq. 19-26.** The paper maximises `x'Hx + Cx` with `H` symmetric and zero on the diagonal,
//! which counts every unordered pair twice. Here each unordered pair counts **once**: to state the paper's objective, give
//! `h_ab = 2 H_ab = H_ab + H_ba`.
//!
//! **Method.** [`solve`] brings the problem into one canonical form (`canonical`), so that a swap of left and right, or another order of
//! candidates, changes nothing. A first assignment comes from a seeded tabu search (`tabu`),
//! better ones from many of them that learn from each other (`evolve`). The upper bound at a node is the level-1
//! reformulation-linearisation dual (Adams & Johnson 1994), which equals the *tight* linear relaxation: every `h_ab` is split as `w_ab + w_ba`;
//! each candidate `a` bounds its share by a linear assignment problem over its row `w_a.` (a *star*), and one linear assignment over
//! `c_a + star_a` combines them (`bound`). Any split gives a valid bound. A good one comes from the relaxation's dual, solved
//! approximately by restarted primal-dual hybrid gradient in floating point (`relax`); children start where their parent ended. Slacks of
//! the assignment problems exclude candidates and pairs of them. Branching is on a feature of either side, best bound first (`tree`); branches that are images of each
//! other are searched once (`symmetry`).
//!
//! **Rounding.** Floating point only *proposes* splits. The bound itself is computed in `i64`: scores are multiplied by a power of two (exact)
//! and rounded *up*, so that the integer objective of each assignment is at or above its true one, and no sum afterwards rounds at all. A proved
//! bound is therefore a bound on the real problem; the price is [`Solution::resolution`], about 1e-12 of the objective's scale, and nothing
//! for scores that are integers of moderate size. Objectives are exact sums, rounded once.
//!
//! **Negative pair terms** are lifted to nonnegative ones by the identity `x_a = sum_{b of k} x_a x_b + x_a z_k`, with `z_k` for "`k` is
//! unmatched" (`model`); a relaxation with `y_ab >= 0` alone would ignore them.
//!
//! The heuristics can be called one by one ([`Heuristics`]). Text formats: [`dd`], [`qaplib`]. Everything is deterministic, and sequential but for what
//! [`Control::spread`] may do side by side; only a [`Control::stop`] that reads a clock gives that up, and [`Solution::reproducible`] says so.

mod bound;
mod canonical;
pub mod dd;
mod evolve;
mod heuristics;
mod lap;
mod model;
mod pool;
mod problem;
pub mod qaplib;
mod relax;
mod solve;
mod sub;
mod symmetry;
mod synthetic;
mod tables;
mod tabu;
mod text;
mod timeline;
mod tree;

pub use heuristics::{Heuristics, Proposal};
pub use problem::{Problem, ProblemBuilder, ProblemError};
pub use solve::{Control, Limits, Progress, Ranked, Solution, SolveError, Spread, StopReason, solve};
pub use synthetic::Synthetic;
pub use text::ReadError;
pub use timeline::Timeline;
