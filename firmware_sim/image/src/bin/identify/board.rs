//! What the program must know of its board: the timer that counts instructions, and how full the memories are.
#![allow(
    unsafe_code,
    reason = "registers, linker symbols, interrupts; the only place of the image that needs it"
)]

use core::ptr::{addr_of, read_volatile, write_volatile};

/// Timer 0 of the board, counting down: control, value, reload.
const CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
const VALUE: *mut u32 = 0x4000_0004 as *mut u32;
const RELOAD: *mut u32 = 0x4000_0008 as *mut u32;

/// The emulator makes each instruction one nanosecond long, and the timer ticks at 25 MHz.
const INSTRUCTIONS_PER_TICK: u64 = 40;

/// What `cortex-m-rt` paints the stack with before anything else.
const PAINT: u32 = 0xcccc_cccc;

unsafe extern "C" {
    static __sdata: u32;
    static __edata: u32;
    static __sidata: u32;
    static __ebss: u32;
    static _stack_start: u32;
    static _stack_end: u32;
}

/// Counts instructions; forty at a time.
#[derive(Clone, Copy)]
pub(crate) struct Clock(());

impl Clock {
    /// Starts the timer.
    pub(crate) fn start() -> Self {
        // SAFETY: registers of this board, which nothing else uses.
        unsafe {
            write_volatile(RELOAD, u32::MAX);
            write_volatile(VALUE, u32::MAX);
            write_volatile(CONTROL, 1);
        }
        Self(())
    }

    /// Does some work, and the instructions that it took: 171 · 10⁹ at most, then the timer comes round.
    pub(crate) fn count<T>(self, work: impl FnOnce() -> T) -> (T, u64) {
        let before = self.ticks();
        let done = work();
        let ticks = before.wrapping_sub(self.ticks());
        (done, u64::from(ticks) * INSTRUCTIONS_PER_TICK)
    }

    fn ticks(self) -> u32 {
        // SAFETY: as in `start`.
        unsafe { read_volatile(VALUE) }
    }
}

/// Instructions of one pass of [`pass`].
pub(crate) const INSTRUCTIONS_PER_PASS: u32 = 2;

/// A loop of known length: `passes` passes, at least one.
pub(crate) fn pass(passes: u32) {
    // SAFETY: counts a register down; no memory is touched.
    unsafe {
        core::arch::asm!("2:", "subs {n}, #1", "bne 2b", n = inout(reg) passes.max(1) => _, options(nomem, nostack));
    }
}

/// Nothing interrupts this program, so nothing need be kept out.
struct Uninterrupted;
critical_section::set_impl!(Uninterrupted);

// SAFETY: one processor, no interrupt enabled: no two pieces of code ever run at the same time.
unsafe impl critical_section::Impl for Uninterrupted {
    unsafe fn acquire() {}
    unsafe fn release((): ()) {}
}

/// Flash used: program, constants, and what is copied to RAM at the start.
pub(crate) fn flash_bytes() -> usize {
    // Flash starts at zero.
    addr_of!(__sidata) as usize + addr_of!(__edata) as usize - addr_of!(__sdata) as usize
}

/// RAM used by statics.
pub(crate) fn static_bytes() -> usize {
    addr_of!(__ebss) as usize - addr_of!(__sdata) as usize
}

/// RAM used by the stack so far, at its deepest.
pub(crate) fn stack_bytes() -> usize {
    let mut lowest = addr_of!(_stack_end);
    let top = addr_of!(_stack_start);
    // SAFETY: between the two symbols is RAM and nothing but the stack.
    while lowest < top && unsafe { read_volatile(lowest) } == PAINT {
        lowest = lowest.wrapping_add(1);
    }
    top as usize - lowest as usize
}
