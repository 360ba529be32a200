//! Images that are used again: the system takes longer to give new memory than a bench takes to fill it.

use std::sync::{Mutex, PoisonError};

/// At most so many numbers are kept: 256 MB.
const MOST: usize = 64 << 20;
/// Smaller ones are not worth it.
const LEAST: usize = 1 << 14;

/// Buffers that no one uses.
#[derive(Debug, Default)]
pub(crate) struct Buffers(Mutex<Vec<Vec<f32>>>);

impl Buffers {
    /// A buffer of `length` numbers of no meaning.
    pub(crate) fn take(&self, length: usize) -> Vec<f32> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = kept.iter().position(|buffer| buffer.len() == length);
        found.map_or_else(|| vec![0.0; length], |at| kept.swap_remove(at))
    }

    pub(crate) fn give_back(&self, buffer: Vec<f32>) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if buffer.len() >= LEAST && kept.iter().map(Vec::len).sum::<usize>() + buffer.len() <= MOST {
            kept.push(buffer);
        }
    }
}
