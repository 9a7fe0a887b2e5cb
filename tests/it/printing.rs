//! Pages printed as PDF, tested with the real binary.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{Run, boresight, names, plane, simulated};

#[test]
fn a_missing_browser_is_an_error_before_the_work_begins() {
    let (temp, drive) = simulated();
    let out = temp.path().join("new");
    let run = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .args(["run", "--pdf", "--out"])
        .args([&out, &drive.join("project.toml")])
        .env("PATH", temp.path())
        .env_remove("BORESIGHT_CHROMIUM")
        .output()
        .unwrap();
    let err = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(1), "{err}");
    for expected in ["chromium", "google-chrome", "msedge", "BORESIGHT_CHROMIUM"] {
        assert!(err.contains(expected), "{expected}: {err}");
    }
    assert!(!out.exists());
}

/// Prints a page with a shell script as the browser, which gets the arguments as `$@` and the output file as `$pdf`.
#[cfg(unix)]
fn print_with(script: &str, page: &Path) -> Run {
    use std::os::unix::fs::PermissionsExt;
    let browser = page.with_file_name("browser");
    let begin = "#!/bin/sh\nfor a in \"$@\"; do case \"$a\" in --print-to-pdf=*) pdf=\"${a#*=}\";; esac; done\n";
    fs::write(&browser, format!("{begin}{script}\n")).unwrap();
    fs::set_permissions(&browser, fs::Permissions::from_mode(0o755)).unwrap();
    let folder = page.parent().unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .args(["compare", "after.csv", "before.csv", "--pdf", "--out", "."])
        .current_dir(folder)
        .env("BORESIGHT_CHROMIUM", &browser)
        .output()
        .unwrap();
    Run {
        code: run.status.code().unwrap_or(-1),
        out: String::from_utf8(run.stdout).unwrap(),
        err: String::from_utf8(run.stderr).unwrap(),
    }
}

#[cfg(unix)]
#[test]
fn a_printed_page_is_complete_or_absent() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    plane(&at("before.csv"), 0.0);
    plane(&at("after.csv"), 0.03);
    let (page, pdf) = (at("compare.html"), at("compare.pdf"));

    let run = print_with(
        "printf '%%PDF-1.4 ' > \"$pdf\"; echo out of paper >&2; exit 3",
        &page,
    );
    run.assert_failed_with(&[
        "exit status: 3",
        "out of paper",
        "the page itself was written",
    ]);
    assert!(page.is_file() && !pdf.exists());

    let arguments = at("arguments");
    let script = format!(
        "printf '%%PDF-1.4 %%%%EOF\\n' > \"$pdf\"; printf '%s\\n' \"$@\" > '{}'",
        arguments.display()
    );
    let run = print_with(&script, &page);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.out.contains("compare.pdf"), "{}", run.out);
    assert_eq!(fs::read(&pdf).unwrap(), b"%PDF-1.4 %%EOF\n");
    let arguments = fs::read_to_string(arguments).unwrap();
    for argument in [
        "--headless=new",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "file:///",
    ] {
        assert!(arguments.contains(argument), "{argument}: {arguments}");
    }
    assert!(
        !names(folder.path())
            .iter()
            .any(|name| name.starts_with("printing-"))
    );
}

/// Uses the browser installed on this machine, if there is one.
#[test]
fn an_installed_browser_prints_a_page_and_a_missing_one_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    plane(&at("before.csv"), 0.0);
    plane(&at("after.csv"), 0.03);
    let (cloud, reference) = (at("after.csv"), at("before.csv"));
    let run = boresight(&[
        "compare",
        cloud.to_str().unwrap(),
        reference.to_str().unwrap(),
        "--pdf",
    ]);
    match run.code {
        0 => {
            let pdf = fs::read(at("out/compare.pdf")).unwrap();
            assert!(
                pdf.starts_with(b"%PDF-") && pdf.len() > 10_000,
                "{} bytes",
                pdf.len()
            );
        }
        _ => run.assert_failed_with(&["--pdf", "no browser that can print"]),
    }
}
