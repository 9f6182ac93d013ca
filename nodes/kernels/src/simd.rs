//! Vector instructions, chosen when the program runs.

/// Runs `f` compiled for the vector instructions that this processor has. What `f` calls must be inlined into it.
#[inline(always)]
pub(crate) fn vectorised<T>(f: impl FnOnce() -> T) -> T {
    pulp::Arch::new().dispatch(f)
}
