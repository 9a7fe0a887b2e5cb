//! Sparse Cholesky factorisation of normal equations whose unknowns come in small blocks.
//!
//! H = Pᵀ L Lᵀ P with P a fill-reducing order of the blocks. Blocks stay whole in it, so every
//! supernode of L (columns of one pattern, kept as one dense matrix) is a run of whole blocks.
//! One thread; the same bits on every run.

mod dissection;
mod factor;
mod inverse;
mod pattern;
mod structure;
mod system;
#[cfg(test)]
mod tests;

pub use factor::SparseFactor;
pub use pattern::BlockPattern;
pub use system::SparseSystem;
