//! Sparse Cholesky factorisation of normal equations whose unknowns come in small blocks.
//!
//! H = Pᵀ L Lᵀ P with P a fill-reducing order of the blocks. P does not split blocks, so every
//! supernode of L (columns of one pattern, stored as one dense matrix) is a run of whole blocks.
//! Supernodes that do not depend on each other are worked on in parallel; every run gives the same bits.

mod dense;
mod dissection;
mod factor;
mod inverse;
mod lists;
mod pattern;
mod structure;
mod supernodes;
mod system;
#[cfg(test)]
mod tests;

pub use factor::SparseFactor;
pub use inverse::SelectedInverse;
pub use pattern::BlockPattern;
pub use system::SparseSystem;
