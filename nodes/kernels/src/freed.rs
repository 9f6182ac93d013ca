//! Freed memory, kept by the process: a page touched for the first time costs more than most of what is computed in it.

use std::sync::Once;

/// The C library of Linux gives freed memory back to the system beyond twice the size of the largest block that it has seen freed, and maps blocks that
/// are larger than that one for themselves. One of so many bytes, never written to, makes it keep what one step frees for the next.
const LARGE_BLOCK: usize = 8 << 20;

/// Has some memory that is freed from now on used again, in this process.
pub(crate) fn keep() {
    static KEPT: Once = Once::new();
    KEPT.call_once(|| drop(std::hint::black_box(Vec::<u8>::with_capacity(LARGE_BLOCK))));
}
