//! What takes memory from the heap, and how much, by an allocator that counts.

mod allocation;
mod bounded;
#[path = "../counting_allocator/mod.rs"]
mod counting_allocator;

use std::sync::Mutex;

/// Held by each test: what is held is that of the whole process.
static ALONE: Mutex<()> = Mutex::new(());
