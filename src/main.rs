//! Arguments -> a command.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    pinstack::cli::main()
}
