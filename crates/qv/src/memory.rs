//! How the allocator of the system keeps memory.

/// Bytes from which on memory is taken from the system apart; the largest that glibc allows.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const APART: libc::c_int = 32 << 20;
/// Free bytes at the end of a heap that are kept.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT: libc::c_int = 256 << 20;

/// Lets glibc keep memory that was freed. Training on the CPU takes and frees buffers of megabytes at every step; each time glibc gave them back to the
/// system, whose clearing of pages was a third of all processor time. Other systems' allocators stay as they are.
pub fn keep() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // Safety: both settings are documented for any time. A refusal changes nothing but speed.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, APART);
        libc::mallopt(libc::M_TRIM_THRESHOLD, KEPT);
    }
}
