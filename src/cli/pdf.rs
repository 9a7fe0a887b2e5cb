//! Prints a page as PDF with a browser on this machine.

use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::interrupt;
use crate::error::{Error, Result};
use crate::output::{refuse_kept, write_whole};
use crate::pipeline::Outcome;

/// Environment variable with the program to use in place of the default ones.
const VARIABLE: &str = "BORESIGHT_CHROMIUM";
/// Programs that can print, in the order of the search.
const NAMES: [&str; 8] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "microsoft-edge-stable",
    "msedge",
];
/// Time after which a browser counts as hung.
const TIMEOUT: Duration = Duration::from_secs(180);
const POLL: Duration = Duration::from_millis(50);
/// Number of attempts to remove the browser's files.
const REMOVALS: usize = 40;

/// Whether the page is also printed.
#[derive(Debug, clap::Args)]
pub(super) struct Pdf {
    /// Also print the page as PDF, with Chromium, Chrome or Edge on PATH, or the program named by BORESIGHT_CHROMIUM
    #[arg(long)]
    pdf: bool,
}

impl Pdf {
    /// The browser, if the page is to be printed.
    ///
    /// # Errors
    /// No browser was found.
    pub fn printer(&self) -> Result<Printer> {
        let program = if self.pdf {
            Some(find(
                std::env::var_os(VARIABLE),
                std::env::var_os("PATH").unwrap_or_default(),
            )?)
        } else {
            None
        };
        Ok(Printer { program })
    }
}

/// Prints pages, or does nothing if printing was not asked for.
pub(super) struct Printer {
    program: Option<PathBuf>,
}

impl Printer {
    /// Prints `page` to a PDF beside it, if printing was asked for, and adds the PDF to the files of `outcome`.
    ///
    /// # Errors
    /// The PDF would replace one of the files `kept` in the folder of the page; the browser fails, or takes too long;
    /// [`Error::Cancelled`].
    pub fn print(&self, page: &Path, kept: &[PathBuf], mut outcome: Outcome) -> Result<Outcome> {
        if let Some(program) = &self.program {
            let pdf = page.with_extension("pdf");
            let folder = pdf.parent().unwrap_or(Path::new(""));
            refuse_kept(folder, &[pdf.file_name().unwrap_or_default()], kept)?;
            write_whole(&pdf, &printed(program, page)?)?;
            outcome.files.push(pdf);
        }
        Ok(outcome)
    }
}

/// The program that the variable names, or the first known one on the path.
fn find(named: Option<OsString>, path: OsString) -> Result<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let on_path = |name: &Path| {
        let name = name.with_extension(std::env::consts::EXE_EXTENSION);
        folders
            .iter()
            .map(|folder| folder.join(&name))
            .find(|path| path.is_file())
    };
    if let Some(named) = named.filter(|named| !named.is_empty()) {
        let named = PathBuf::from(named);
        let program = if named.is_file() {
            Some(named.clone())
        } else {
            on_path(&named)
        };
        return program.ok_or_else(|| {
            Error::data(
                format!(
                    "--pdf: {VARIABLE} names {}, which is not a program",
                    named.display()
                ),
                "set it to the path of a Chromium, Chrome or Edge, or unset it",
            )
        });
    }
    let program = NAMES.iter().find_map(|name| on_path(Path::new(name)));
    program.ok_or_else(|| {
        Error::data(
            format!("--pdf: no browser that can print on PATH: none of {}", NAMES.join(", ")),
            format!("install one of them, or set {VARIABLE} to its path; or print the page from any browser"),
        )
    })
}

/// A temporary folder. It is not hidden, because browsers in sandboxes cannot see hidden folders.
struct Workplace(PathBuf);

impl Drop for Workplace {
    fn drop(&mut self) {
        // Processes of the browser may still be writing.
        for _ in 0..REMOVALS {
            if fs::remove_dir_all(&self.0).is_ok() || !self.0.exists() {
                return;
            }
            std::thread::sleep(POLL);
        }
    }
}

/// The page as PDF.
fn printed(program: &Path, page: &Path) -> Result<Vec<u8>> {
    let page = page
        .canonicalize()
        .map_err(|error| Error::io(page, error))?;
    let folder = page.with_file_name(format!("printing-{}", std::process::id()));
    fs::create_dir_all(&folder).map_err(|error| Error::io(&folder, error))?;
    let workplace = Workplace(folder);
    let (pdf, output) = (workplace.0.join("page.pdf"), workplace.0.join("stderr.txt"));
    let output_file = File::create(&output).map_err(|error| Error::io(&output, error))?;
    let mut child = Command::new(program)
        .args(arguments(&workplace.0, &pdf, &page))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(output_file)
        .spawn()
        .map_err(|error| Error::io(program, error))?;
    let began = Instant::now();
    let ended = loop {
        if let Some(status) = child
            .try_wait()
            .map_err(|error| Error::io(program, error))?
        {
            break Some(status);
        }
        if interrupt::is_asked() || began.elapsed() > TIMEOUT {
            // The browser may have ended in the meantime.
            let _ = child.kill();
            let _ = child.wait();
            break None;
        }
        std::thread::sleep(POLL);
    };
    if interrupt::is_asked() {
        return Err(Error::Cancelled);
    }
    let bytes = fs::read(&pdf).unwrap_or_default();
    if ended.is_some() && is_whole(&bytes) {
        return Ok(bytes);
    }
    let how = match ended {
        Some(status) => format!("ended with {status} and printed nothing"),
        None => format!("did not end within {} s", TIMEOUT.as_secs()),
    };
    let output = fs::read(&output).unwrap_or_default();
    let output = String::from_utf8_lossy(&output);
    let last = output.lines().rfind(|line| !line.trim().is_empty());
    let last = last.map_or(String::new(), |line| {
        format!("; its last message: {}", line.trim())
    });
    Err(Error::data(
        format!("{}: {} {how}{last}", page.display(), program.display()),
        format!("the page itself was written; use another browser with {VARIABLE}"),
    ))
}

/// Whether a PDF is complete: it has its first and last bytes.
fn is_whole(bytes: &[u8]) -> bool {
    let end = &bytes[bytes.len().saturating_sub(32)..];
    bytes.starts_with(b"%PDF-") && end.windows(5).any(|window| window == b"%%EOF")
}

/// The arguments with which a browser prints a page, without the user's profile and without network.
fn arguments(folder: &Path, pdf: &Path, page: &Path) -> Vec<OsString> {
    let with_path = |option: &str, path: &Path| {
        let mut argument = OsString::from(option);
        argument.push(path);
        argument
    };
    let mut all: Vec<OsString> = [
        "--headless=new",
        "--disable-gpu",
        "--no-first-run",
        "--no-default-browser-check",
        "--disable-extensions",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-pings",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--no-pdf-header-footer",
        "--virtual-time-budget=5000",
    ]
    .map(OsString::from)
    .into();
    if is_root() {
        // Chromium refuses to run its sandbox as root. The page is our own.
        all.push("--no-sandbox".into());
    }
    all.push(with_path("--user-data-dir=", &folder.join("profile")));
    all.push(with_path("--print-to-pdf=", pdf));
    all.push(file_url(page).into());
    all
}

#[cfg(unix)]
fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt;
    // On systems without `/proc`, the user is assumed not to be root.
    fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}

#[cfg(not(unix))]
fn is_root() -> bool {
    false
}

/// The address of a file, an absolute path.
fn file_url(path: &Path) -> String {
    let text = path.to_string_lossy().replace('\\', "/");
    // Canonical paths on Windows begin with this prefix.
    let text = text.strip_prefix("//?/").unwrap_or(&text);
    let mut url = String::from("file://");
    if !text.starts_with('/') {
        url.push('/');
    }
    for byte in text.bytes() {
        match byte {
            b'/' | b':' | b'.' | b'-' | b'_' | b'~' => url.push(byte as char),
            byte if byte.is_ascii_alphanumeric() => url.push(byte as char),
            byte => url.push_str(&format!("%{byte:02X}")),
        }
    }
    url
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_names_the_programs_that_were_searched() {
        let folder = tempfile::tempdir().unwrap();
        let path = || folder.path().as_os_str().to_owned();
        let error = find(None, path()).unwrap_err().to_string();
        for name in NAMES.iter().chain(&[VARIABLE, "PATH"]) {
            assert!(error.contains(name), "{name}: {error}");
        }
        let error = find(Some("no-such-browser".into()), path()).unwrap_err();
        assert!(error.to_string().contains("no-such-browser"), "{error}");

        let exe = |name: &str| {
            folder
                .path()
                .join(name)
                .with_extension(std::env::consts::EXE_EXTENSION)
        };
        for name in ["msedge", "chromium"] {
            fs::write(exe(name), "").unwrap();
        }
        assert_eq!(find(None, path()).unwrap(), exe("chromium"));
        assert_eq!(find(Some("msedge".into()), path()).unwrap(), exe("msedge"));
        let named = exe("msedge").into_os_string();
        assert_eq!(find(Some(named), OsString::new()).unwrap(), exe("msedge"));
        assert_eq!(
            find(Some(OsString::new()), path()).unwrap(),
            exe("chromium")
        );
    }

    #[test]
    fn any_path_becomes_a_valid_address() {
        let url = file_url(Path::new("/a b/50 %/grün#1.html"));
        assert_eq!(url, "file:///a%20b/50%20%25/gr%C3%BCn%231.html");
    }

    #[test]
    fn an_incomplete_pdf_is_recognised() {
        assert!(is_whole(b"%PDF-1.4 ... %%EOF\n"));
        for bytes in [&b""[..], b"%PDF-1.4 ...", b"... %%EOF", b"<html>"] {
            assert!(!is_whole(bytes));
        }
    }
}
