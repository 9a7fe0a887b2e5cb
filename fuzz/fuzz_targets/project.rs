#![no_main]

use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use boresight::project::{Project, scanners_to_toml};

/// Longest time that reading may take.
const LONGEST: Duration = Duration::from_secs(1);

/// Reads a project file, prints it and reads the result, which must be the same project.
fn read(path: &Path) {
    let Some(project) = read_one(path) else {
        return;
    };
    // The files that the project names do not exist.
    if let Err(error) = project.check_files() {
        assert!(!error.to_string().is_empty());
    }
    let _ = project.inputs();
    let printed = project.to_toml().expect("a path of text");
    std::fs::write(path, &printed).expect("the project is written");
    let again = read_one(path).unwrap_or_else(|| panic!("unreadable:\n{printed}"));
    assert_eq!(again, project, "{printed}");
    scanners_to_toml(&project.scanners).expect("a path of text");
}

fn read_one(path: &Path) -> Option<Project> {
    let start = Instant::now();
    let outcome = Project::read(path);
    let took = start.elapsed();
    assert!(took <= LONGEST, "Project::read takes {took:?}");
    let name = path.display().to_string();
    outcome
        .inspect_err(|error| assert!(error.to_string().contains(&name), "{error}"))
        .ok()
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    static FOLDER: OnceLock<std::path::PathBuf> = OnceLock::new();
    let path = FOLDER
        .get_or_init(boresight_fuzz::folder)
        .join("project.toml");
    std::fs::write(&path, bytes).expect("the input is written");
    boresight_fuzz::limited(bytes.len(), &mut || read(&path));
});
