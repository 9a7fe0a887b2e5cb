//! The simulated instrument and our client, tested against the PyPI package geocompy.

use std::path::Path;
use std::process::Command;

#[test]
#[ignore = "needs a Python with geocompy 1.0.0 and pyserial, named by BORESIGHT_GEOCOMPY, and the examples"]
fn geocompy_agrees() {
    let python = std::env::var("BORESIGHT_GEOCOMPY").expect("BORESIGHT_GEOCOMPY names no Python");
    let test = std::env::current_exe().unwrap();
    // target/debug/deps/… -> target/debug/examples
    let examples = test.ancestors().nth(2).unwrap().join("examples");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/geocom/geocompy_check.py");
    let ran = Command::new(python)
        .arg(script)
        .args(["geocom_simulated", "geocom_track"].map(|name| examples.join(name)))
        .output()
        .unwrap();
    println!("{}", String::from_utf8_lossy(&ran.stdout));
    assert!(
        ran.status.success(),
        "{}",
        String::from_utf8_lossy(&ran.stderr)
    );
}
