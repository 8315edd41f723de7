//! The command line: one command per file.

pub mod access;
pub mod backup;
pub mod bundle;
pub mod calibrate;
pub mod demo;
pub mod doctor;
pub mod files;
pub mod fuse;
pub mod gc;
pub mod health;
pub mod hull;
mod local;
pub mod logging;
mod memory;
pub mod openapi;
mod option_flags;
pub mod output;
pub mod plan;
pub mod poses;
mod process;
pub mod reconstruct;
pub mod serve;
mod sheet;
pub mod store;
pub mod target;
pub mod tls;
pub mod token;
pub mod verify;
pub mod work;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::settings::Flags;

/// Calibrated focus stacking for photogrammetry, as a service.
#[derive(Debug, Parser)]
#[command(name = "pinstack", version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Without a command: serve.
    #[command(flatten)]
    serve: Flags,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the API and run jobs (the default)
    Serve(Box<Flags>),
    /// Run jobs without serving the API: more machines for the service whose database_url and data_dir this one shares
    Work(Box<Flags>),
    /// Calibrate and fuse a synthetic stack or scan through the service, and compare the results with the truth
    Demo(demo::Demo),
    Fuse(Box<fuse::Fuse>),
    Calibrate(Box<calibrate::Calibrate>),
    /// Print the OpenAPI document
    Openapi,
    Token(token::Token),
    Gc(gc::Gc),
    Verify(verify::Verify),
    Backup(backup::Backup),
    Restore(backup::Restore),
    Bundle(bundle::Bundle),
    Hull(hull::Hull),
    Plan(plan::Plan),
    Poses(poses::Poses),
    Reconstruct(reconstruct::Reconstruct),
    Target(target::Target),
    Doctor(doctor::Doctor),
    /// Check whether a running server is ready; the exit code is 0 if it is
    Health(health::Flags),
}

/// Parses the arguments and runs the command.
pub fn main() -> ExitCode {
    crate::store::failpoint::arm();
    let arguments = Arguments::parse();
    let done = match arguments.command {
        None => serve::run(arguments.serve),
        Some(Command::Serve(flags)) => serve::run(*flags),
        Some(Command::Work(flags)) => work::run(*flags),
        Some(Command::Demo(demo)) => demo.run(),
        Some(Command::Fuse(fuse)) => fuse.run(),
        Some(Command::Calibrate(calibrate)) => calibrate.run(),
        Some(Command::Openapi) => openapi::run(),
        Some(Command::Doctor(doctor)) => doctor.run(),
        Some(Command::Token(token)) => token.run(),
        Some(Command::Gc(gc)) => gc.run(),
        Some(Command::Verify(verify)) => verify.run(),
        Some(Command::Backup(backup)) => backup.run(),
        Some(Command::Restore(restore)) => restore.run(),
        Some(Command::Bundle(bundle)) => bundle.run(),
        Some(Command::Hull(hull)) => hull.run(),
        Some(Command::Plan(plan)) => plan.run(),
        Some(Command::Poses(poses)) => poses.run(),
        Some(Command::Reconstruct(reconstruct)) => reconstruct.run(),
        Some(Command::Target(target)) => target.run(),
        Some(Command::Health(flags)) => health::run(&flags),
    };
    logging::flush();
    match done.and_then(|()| output::require_complete()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output::note(format!("pinstack: {error:#}"));
            ExitCode::FAILURE
        }
    }
}
