//! The command line: one file a command; here they are parsed, run, and mapped to exit codes.

mod allan;
mod calibrate;
mod compare;
mod demo;
mod describe;
mod features;
mod georeference;
mod inspect;
mod online;
mod run;
mod simulate;
mod terminal;
mod thin;
mod trajectory;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use serde_json::{Value, json};

use crate::error::{Error, Location, Result};
use crate::output;
use crate::pipeline::{Options, Outcome};
use crate::project::Project;
use terminal::Terminal;

/// Calibrates laser profile scanners on a moving platform and proves how good the calibration is.
///
/// `boresight demo` shows everything on simulated drives; `boresight run project.toml` does
/// everything with yours. Exit codes: 0 done, 1 failed, 2 wrong use.
#[derive(Debug, Parser)]
#[command(name = "boresight", version, max_term_width = 100)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

#[derive(Debug, Args)]
struct Global {
    /// Print the result as one JSON document on stdout
    #[arg(long, global = true)]
    json: bool,
    /// Work on N threads [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Seed of every random draw [default: the scenario's, 1]
    #[arg(long, global = true, value_name = "N")]
    seed: Option<u64>,
    /// Print nothing but the result and errors
    #[arg(long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Say what each stage finds and decides
    #[arg(short, long, global = true)]
    verbose: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Simulate(simulate::Simulate),
    Inspect(inspect::Inspect),
    Trajectory(trajectory::Trajectory),
    Calibrate(calibrate::Calibrate),
    Georeference(georeference::Georeference),
    Compare(compare::Compare),
    Features(features::Features),
    Thin(thin::Thin),
    Run(run::Run),
}

/// A project to work on and where its results go.
#[derive(Debug, Args)]
struct OnProject {
    /// The project file
    project: PathBuf,
    /// Folder of the results [default: `out` beside the project]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// The file of what a command reports.
const LOG: &str = "log.txt";

/// What every command is given.
struct Context {
    seed: Option<u64>,
    terminal: Terminal,
}

impl Context {
    fn options(&self, out: &Path) -> Options {
        Options {
            out: out.to_owned(),
            seed: self.seed,
        }
    }

    /// Reads a project, looks for its files, runs `stage` on it and keeps the log.
    fn on_project(
        &self,
        on: &OnProject,
        stage: fn(&Project, &Options, &dyn crate::progress::Progress) -> Result<Outcome>,
    ) -> Result<Outcome> {
        let project = Project::read(&on.project)?;
        project.check_files()?;
        let out = out_folder(&on.out, &on.project);
        self.logged(&out, &project.inputs(), |options| {
            stage(&project, options, &self.terminal)
        })
    }

    /// Runs `work`, which reads `inputs`, and writes what it reported to `log.txt` in `out`, also when
    /// it failed there.
    fn logged(
        &self,
        out: &Path,
        inputs: &[PathBuf],
        work: impl FnOnce(&Options) -> Result<Outcome>,
    ) -> Result<Outcome> {
        output::keep_inputs(out, inputs, &[LOG])?;
        let outcome = work(&self.options(out));
        if let Err(error) = &outcome {
            self.terminal.note(&format!("error: {error}"));
        }
        if out.is_dir() {
            let written = self.terminal.write_log(&out.join(LOG));
            // The error of the work matters more than one of its log.
            outcome.and_then(|outcome| written.map(|()| outcome))
        } else {
            outcome
        }
    }
}

/// The folder that was asked for, or `out` beside `file`.
fn out_folder(asked: &Option<PathBuf>, file: &Path) -> PathBuf {
    asked.clone().unwrap_or_else(|| file.with_file_name("out"))
}

/// Runs the command line and maps the outcome to an exit code.
pub fn main() -> ExitCode {
    let line = match CommandLine::try_parse() {
        Ok(line) => line,
        Err(error) => {
            // Nothing is left to do where the terminal does not take the message.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let json = line.global.json;
    let printed = execute(line).and_then(|(outcome, complete)| {
        print_outcome(&outcome, json)?;
        Ok(complete)
    });
    match printed {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            print_error(&error, json);
            ExitCode::from(1)
        }
    }
}

/// What the command found, and whether that is all that it was asked for.
fn execute(line: CommandLine) -> Result<(Outcome, bool)> {
    let global = line.global;
    let threads = usize::from(global.threads.unwrap_or(0));
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| {
            Error::data(
                format!("the system refuses {threads} threads: {error}"),
                "ask for fewer with --threads",
            )
        })?;
    let context = Context {
        seed: global.seed,
        terminal: Terminal::new(global.quiet, global.verbose),
    };
    let complete = |outcome| (outcome, true);
    pool.install(|| match line.command {
        Command::Inspect(command) => command.execute(),
        Command::Demo(command) => command.execute(&context).map(complete),
        Command::Simulate(command) => command.execute(&context).map(complete),
        Command::Trajectory(command) => command.execute(&context).map(complete),
        Command::Calibrate(command) => command.execute(&context).map(complete),
        Command::Georeference(command) => command.execute(&context).map(complete),
        Command::Compare(command) => command.execute(&context).map(complete),
        Command::Features(command) => command.execute(&context).map(complete),
        Command::Thin(command) => command.execute(&context).map(complete),
        Command::Run(command) => command.execute(&context).map(complete),
    })
}

fn print_outcome(outcome: &Outcome, json: bool) -> Result<()> {
    let mut text = if json {
        format!("{:#}\n", outcome.result)
    } else {
        format!("{}\n", outcome.summary.trim_end())
    };
    if !json {
        if !outcome.files.is_empty() && outcome.summary.contains('\n') {
            text.push('\n');
        }
        for file in &outcome.files {
            text.push_str(&format!("wrote {}\n", file.display()));
        }
    }
    match std::io::stdout().write_all(text.as_bytes()) {
        // Whoever reads has seen enough.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(|error| Error::io("stdout", error)),
    }
}

/// Says once what went wrong; nothing is left to do where that cannot be written.
fn print_error(error: &Error, json: bool) {
    let _ = if json {
        writeln!(std::io::stdout(), "{:#}", error_json(error))
    } else {
        writeln!(std::io::stderr(), "error: {error}")
    };
}

fn error_json(error: &Error) -> Value {
    let mut details = match error {
        Error::Io { path, source } => {
            json!({ "file": path.display().to_string(), "problem": source.to_string() })
        }
        Error::Format {
            path,
            at,
            found,
            expected,
        } => {
            let mut details = json!({
                "file": path.display().to_string(),
                "found": found,
                "expected": expected,
            });
            match at {
                Location::Whole => {}
                Location::Line(line) => details["line"] = json!(line),
                Location::Byte(byte) => details["byte"] = json!(byte),
            }
            details
        }
        Error::Data { problem, remedy } => json!({ "problem": problem, "remedy": remedy }),
    };
    details["message"] = json!(error.to_string());
    json!({ "error": details })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        CommandLine::command().debug_assert();
    }

    #[test]
    fn errors_as_json_name_file_and_line() {
        let error = Error::format("a.toml", Location::Line(3), "x", "y");
        let json = error_json(&error);
        assert_eq!(json["error"]["file"], "a.toml");
        assert_eq!(json["error"]["line"], 3);
        assert_eq!(
            json["error"]["message"],
            "a.toml, line 3: found x, expected y"
        );
    }
}
