//! What several integration tests need.

use std::path::PathBuf;

/// The file or folder `name` of the data that lie beside the repository; prints `skipped` and
/// returns `None` where they are not there.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if path.exists() {
        Some(path)
    } else {
        println!("skipped: {} is not there", path.display());
        None
    }
}
