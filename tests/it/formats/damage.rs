//! Damaged files.

use crate::common::samples::*;

#[test]
fn the_error_of_a_truncated_recording_names_the_byte() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bin");
    write_recording(&path, 3);
    let whole = std::fs::read(&path).unwrap();
    let length = whole.len() / 3;
    for n in (length + 1)..(2 * length) {
        std::fs::write(&path, &whole[..n]).unwrap();
        let error = all_points(&path).unwrap_err().to_string();
        assert!(
            error.contains(&format!("starts at byte {length}")),
            "{error}"
        );
    }
    let mut wide = whole.clone();
    wide[length + 52..length + 56].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&path, &wide).unwrap();
    let error = all_points(&path).unwrap_err().to_string();
    assert!(error.contains(&format!(
        "byte {}: found a profile of 4294967295",
        length + 52
    )));
}
