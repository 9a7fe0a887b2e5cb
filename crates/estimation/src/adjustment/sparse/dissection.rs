//! A fill-reducing order of elimination, by METIS.

use std::ptr::null_mut;
use std::sync::{Mutex, PoisonError};

use metis_sys::{METIS_NodeND, idx_t as Idx, rstatus_et_METIS_OK as METIS_OK};

/// Order of elimination of the first blocks by nested dissection (George 1973; Karypis & Kumar 1998). `sizes` are
/// the sizes of these blocks; `later` lists for each block the coupled blocks of higher index, ascending. Blocks
/// that separate the others into two halves come after both. A few surfels separate two passes, whereas minimum
/// degree would couple the poses of both.
///
/// # Panics
/// With 2³¹ pairs of coupled blocks.
pub fn nested_dissection(later: &[Vec<u32>], sizes: &[usize]) -> Vec<usize> {
    let blocks = sizes.len();
    if blocks < 2 {
        return (0..blocks).collect();
    }
    let mut others: Vec<Vec<Idx>> = vec![Vec::new(); blocks];
    for (block, later) in later[..blocks].iter().enumerate() {
        for &neighbour in later
            .iter()
            .take_while(|&&neighbour| (neighbour as usize) < blocks)
        {
            others[block].push(neighbour as Idx);
            others[neighbour as usize].push(block as Idx);
        }
    }
    let mut ends: Vec<Idx> = vec![0];
    let mut coupled: Vec<Idx> = Vec::new();
    for others in &others {
        coupled.extend(others);
        ends.push(Idx::try_from(coupled.len()).expect("fewer than 2³¹ pairs of blocks"));
    }
    let mut weights: Vec<Idx> = sizes.iter().map(|&size| size as Idx).collect();
    let mut count = blocks as Idx;
    let (mut order, mut position) = (vec![0; blocks], vec![0; blocks]);
    // METIS draws from the C library's random numbers, which all threads share.
    static METIS: Mutex<()> = Mutex::new(());
    let lock = METIS.lock().unwrap_or_else(PoisonError::into_inner);
    // SAFETY: `ends` has one entry more than there are blocks and ends at the length of `coupled`, whose entries
    // are blocks; weights, order and position have one for each block. Null options are the defaults.
    #[allow(unsafe_code)]
    let status = unsafe {
        METIS_NodeND(
            &mut count,
            ends.as_mut_ptr(),
            coupled.as_mut_ptr(),
            weights.as_mut_ptr(),
            null_mut(),
            order.as_mut_ptr(),
            position.as_mut_ptr(),
        )
    };
    drop(lock);
    assert_eq!(status, METIS_OK, "memory for the order of elimination");
    order.into_iter().map(|block| block as usize).collect()
}
