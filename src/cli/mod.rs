//! Command line.

/// Runs the command line and maps the outcome to an exit code.
pub fn main() -> std::process::ExitCode {
    std::process::ExitCode::SUCCESS
}
