//! The command line: parses arguments, runs commands and sets exit codes. Commands with more
//! arguments than a project have their own files.

mod allan;
mod calibrate;
mod campaign;
mod compare;
mod completions;
mod context;
mod convert;
mod demo;
mod describe;
mod evaluate;
mod features;
mod georeference;
mod init;
mod inspect;
mod interrupt;
mod pdf;
mod picture;
mod print;
mod record;
mod replay;
mod report;
mod run;
mod salvage;
mod simulate;
mod terminal;
mod thin;
mod tracker;
mod trajectory;
mod values;
mod watch;

use std::process::ExitCode;

use clap::{Args, CommandFactory, Parser, Subcommand};

use crate::error::{Error, Result};
use crate::pipeline::Outcome;
use crate::verdict::Headline;
use context::Context;
use print::{print_error, print_outcome};
use terminal::Terminal;

/// Calibrates laser profile scanners on a moving platform and validates the result.
///
/// `boresight demo` runs everything on simulated drives; `boresight run project.toml` runs it
/// on yours. Exit codes: 0 done, 1 failed, 2 wrong use, 3 not usable (with --strict), 130 stopped by Ctrl-C.
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
    /// Use N threads [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Seed of all random numbers [default: the scenario's, 1]
    #[arg(long, global = true, value_name = "N")]
    seed: Option<u64>,
    /// Exit with code 3 if the result is not usable
    #[arg(long, global = true)]
    strict: bool,
    /// Print only the result and errors
    #[arg(long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Print what each stage finds and decides
    #[arg(short, long, global = true)]
    verbose: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Simulate(simulate::Simulate),
    Init(init::Init),
    Inspect(inspect::Inspect),
    Salvage(salvage::Salvage),
    Trajectory(trajectory::Trajectory),
    Calibrate(calibrate::Calibrate),
    Georeference(georeference::Georeference),
    Compare(compare::Compare),
    #[command(visible_alias = "compare-trajectories")]
    Evaluate(evaluate::Evaluate),
    Convert(convert::Convert),
    Features(features::Features),
    Thin(thin::Thin),
    Run(run::Run),
    Report(report::Report),
    Campaign(campaign::Campaign),
    #[command(hide = true)]
    CampaignItem(campaign::CampaignItem),
    Record(record::Record),
    Replay(replay::Replay),
    Completions(completions::Completions),
    Man(completions::Man),
}

/// Runs the command line and maps the outcome to an exit code.
pub fn main() -> ExitCode {
    let line = match CommandLine::try_parse() {
        Ok(line) => line,
        Err(error) => {
            // A message that cannot be printed is lost.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let (json, strict) = (line.global.json, line.global.strict);
    let printed = execute(line).and_then(|(outcome, complete)| {
        print_outcome(&outcome, json)?;
        let verdicts = outcome.verdicts.unwrap_or_default();
        Ok((complete, Headline::of(&verdicts)))
    });
    match printed {
        Ok((false, _)) => ExitCode::from(1),
        Ok((true, Headline::Unusable)) if strict => ExitCode::from(3),
        Ok((true, _)) => ExitCode::SUCCESS,
        // The reader of the output has closed the pipe and needs no more.
        Err(Error::Io { path, source })
            if path.as_os_str() == "stdout" && source.kind() == std::io::ErrorKind::BrokenPipe =>
        {
            ExitCode::SUCCESS
        }
        Err(error) => {
            print_error(&error, json);
            match error {
                Error::Cancelled => ExitCode::from(interrupt::EXIT_CODE),
                _ => ExitCode::from(1),
            }
        }
    }
}

/// Returns the outcome of the command and whether it is complete.
fn execute(line: CommandLine) -> Result<(Outcome, bool)> {
    let global = line.global;
    let threads = usize::from(global.threads.unwrap_or(0));
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| {
            Error::data(
                format!("{threads} threads cannot be started: {error}"),
                "use fewer with --threads",
            )
        })?;
    let context = Context {
        seed: global.seed,
        terminal: Terminal::new(global.quiet, global.verbose),
    };
    pool.install(|| {
        // A command that never checks for interrupts is ended by Ctrl-C at once, which is the default.
        let is_brief = matches!(
            line.command,
            Command::Inspect(_)
                | Command::Init(_)
                | Command::Salvage(_)
                | Command::Completions(_)
                | Command::Man(_)
        );
        if !is_brief {
            interrupt::listen();
        }
        let outcome = match line.command {
            Command::Inspect(command) => return command.execute(&context),
            Command::Init(command) => command.execute(),
            Command::Campaign(command) => {
                return command.execute(&context, rayon::current_num_threads());
            }
            Command::CampaignItem(command) => command.execute(),
            Command::Salvage(command) => return command.execute(),
            Command::Demo(command) => command.execute(&context),
            Command::Simulate(command) => command.execute(&context),
            Command::Trajectory(command) => command.execute(&context),
            Command::Calibrate(command) => command.execute(&context),
            Command::Georeference(command) => command.execute(&context),
            Command::Compare(command) => command.execute(&context),
            Command::Evaluate(command) => command.execute(&context),
            Command::Convert(command) => command.execute(&context),
            Command::Features(command) => command.execute(&context),
            Command::Thin(command) => command.execute(&context),
            Command::Run(command) => command.execute(&context),
            Command::Report(command) => command.execute(&context),
            Command::Record(command) => command.execute(&context),
            Command::Replay(command) => command.execute(&context),
            Command::Completions(command) => Ok(command.execute(CommandLine::command())),
            Command::Man(command) => command.execute(CommandLine::command()),
        };
        outcome.map(|outcome| (outcome, true))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        CommandLine::command().debug_assert();
    }
}
