//! A hint to the memory: this will be read soon.
//!
//! A tile's triangles lie all over the frame's, and a triangle of a few pixels is drawn in less time than one takes to come from memory. The
//! hint changes no value and can't fail; elsewhere than on x86-64 it is nothing.
#![cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "the intrinsic takes a pointer"))]

/// Brings the beginning of what `reference` names nearer.
#[inline(always)]
pub(crate) fn prefetch<T>(reference: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: SSE is a part of every x86-64, and the pointer is a reference's; the instruction reads nothing that the
        // program could see.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(reference).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = reference;
}
