//! The command line: parses, calls the library, prints. Exit status: 0 done, 1 a check said no, 2 wrong use or bad input.
#![forbid(unsafe_code)]

mod cli;

use afterimage::verdict::Outcome;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Validates temporal anti-aliasing: runs published systems on the GPU over dumped frames and compares with references.
#[derive(Parser)]
#[command(
    version,
    arg_required_else_help = true,
    after_help = "Exit status: 0 done, 1 a check said no, 2 wrong use or bad input."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Run(cli::run::Arguments),
    Bake(cli::bake::Arguments),
    Bench(cli::bench::Arguments),
    Compare(cli::compare::Arguments),
    Check(cli::check::Arguments),
    Ci(cli::ci::Arguments),
    Stress(cli::stress::Arguments),
    Serve(cli::serve::Arguments),
    Submit(cli::submit::Arguments),
    Regressions(cli::regressions::Arguments),
    Token(cli::token::Arguments),
    List(cli::list::Arguments),
    Openapi(cli::openapi::Arguments),
    Paper(cli::paper::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    cli::log_to_stderr();
    let outcome = match arguments.command {
        Command::Run(arguments) => cli::run::run(&arguments),
        Command::Bake(arguments) => cli::bake::run(&arguments),
        Command::Bench(arguments) => cli::bench::run(&arguments),
        Command::Compare(arguments) => cli::compare::run(&arguments),
        Command::Check(arguments) => cli::check::run(&arguments),
        Command::Stress(arguments) => cli::stress::run(&arguments),
        Command::Serve(arguments) => cli::serve::run(arguments),
        Command::Submit(arguments) => cli::submit::run(&arguments),
        Command::Ci(arguments) => match cli::ci::run(&arguments) {
            Ok(Outcome::Unknown) => return ExitCode::from(2),
            other => other.map(|outcome| outcome == Outcome::Ok),
        },
        Command::Regressions(arguments) => cli::regressions::run(&arguments),
        Command::Token(arguments) => cli::token::run(&arguments),
        Command::List(arguments) => cli::list::run(&arguments),
        Command::Openapi(arguments) => cli::openapi::run(&arguments),
        Command::Paper(arguments) => cli::paper::run(&arguments),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            cli::complain(&format!("{error:#}"));
            ExitCode::from(2)
        }
    }
}
