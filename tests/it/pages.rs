//! Pages of every command, and pages written again, tested with the real binary.

use std::fs;
use std::path::Path;

use crate::common::{Run, boresight, change_project, names, on_project, plane, simulated};

/// Checks that a page is complete and has these headings; returns its text.
fn assert_page(path: &Path, headings: &[&str]) -> String {
    let page = fs::read_to_string(path).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>"), "{}", path.display());
    assert!(page.trim_end().ends_with("</html>"), "incomplete page");
    for heading in headings {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "{heading}");
    }
    page
}

#[test]
fn a_page_written_again_is_the_same() {
    let (_temp, drive) = simulated();
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(
        run.out.contains("± is one standard deviation"),
        "{}",
        run.out
    );
    assert!(
        run.out.contains("RMSE is the root mean square"),
        "{}",
        run.out
    );
    let out = drive.join("out");
    let page = out.join("report.html");
    let made = fs::read(&page).unwrap();
    let files = names(&out);
    let again = || boresight(&["report", out.to_str().unwrap()]);

    for change in ["nothing", "settings", "page", "other results", "project"] {
        match change {
            // Changed settings do not change the finished results.
            "settings" => change_project(&drive, "sigma_m = 0.005", "sigma_m = 0.02"),
            "page" => fs::write(&page, "scribbled over").unwrap(),
            "other results" => fs::remove_file(out.join("result.json")).unwrap(),
            "project" => fs::remove_file(drive.join("project.toml")).unwrap(),
            _ => {}
        }
        let run = again();
        assert_eq!(run.code, 0, "{change}: {}", run.err);
        assert!(fs::read(&page).unwrap() == made, "{change}");
        assert!(run.out.starts_with("result: "), "{}", run.out);
    }
    let left: Vec<String> = files
        .into_iter()
        .filter(|name| name != "result.json")
        .collect();
    assert_eq!(names(&out), left);

    let stored = out.join("report.kept");
    let whole = fs::read(&stored).unwrap();
    let refused = |expected: &[&str]| {
        again().assert_failed_with(expected);
        assert!(fs::read(&page).unwrap() == made);
    };
    fs::write(&stored, &whole[..whole.len() / 2]).unwrap();
    refused(&["report.kept", "cut off", "run again"]);
    fs::write(&stored, "notes\n").unwrap();
    refused(&["report.kept, line 1", "another file"]);
    fs::remove_file(&stored).unwrap();
    refused(&["there is no report.kept", "run again"]);
    fs::write(drive.join("project.toml"), "").unwrap();
    fs::write(&stored, &whole).unwrap();
    let run = again();
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(
        run.err.contains("the project cannot be read"),
        "{}",
        run.err
    );
    assert!(fs::read(&page).unwrap() == made);
}

#[test]
fn a_calibration_writes_a_page() {
    let (_temp, drive) = simulated();
    let run = on_project(&drive, "calibrate", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.out.contains("calibration.html"), "{}", run.out);
    assert!(
        run.out.contains("± is one standard deviation"),
        "{}",
        run.out
    );
    let headings = [
        "Mounting",
        "What the data could determine",
        "Correlations of the parameters",
        "Trajectory",
        "Input",
    ];
    let page = assert_page(&drive.join("out/calibration.html"), &headings);
    for shown in ["initial", "± ", "tls.laz"] {
        assert!(page.contains(shown), "{shown}");
    }

    let run = on_project(&drive, "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert_page(&drive.join("out/trajectory.html"), &["Trajectory"]);
}

#[test]
fn a_comparison_writes_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    plane(&at("before <1>.csv"), 0.0);
    plane(&at("after.csv"), 0.03);
    let compare = |more: &[&str]| -> Run {
        let (cloud, reference) = (at("after.csv"), at("before <1>.csv"));
        let clouds = [
            "compare",
            cloud.to_str().unwrap(),
            reference.to_str().unwrap(),
        ];
        boresight(&[&clouds, more].concat())
    };
    let run = compare(&[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for expected in [
        "median               30.00 mm",
        "half a 95 % interval",
        "no error of the registration",
    ] {
        assert!(run.out.contains(expected), "{expected}: {}", run.out);
    }
    let headings = ["Distances between the clouds", "Input"];
    let page = assert_page(&at("out/compare.html"), &headings);
    for shown in [
        "<td>30.0\u{202f}mm</td>",
        "Map of distances",
        "Histogram of distances",
        "Map of the levels of detection",
        "before &lt;1&gt;.csv",
    ] {
        assert!(page.contains(shown), "{shown}");
    }
    let run = compare(&["--registration-error-m", "0.002"]);
    assert!(
        run.out.contains("2.00 mm for the registration"),
        "{}",
        run.out
    );
}
