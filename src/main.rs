//! The `pinstack` binary: parses the command line and runs the command.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    pinstack::cli::main()
}
