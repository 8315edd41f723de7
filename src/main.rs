//! Arguments -> a command.

fn main() -> std::process::ExitCode {
    pinstack::cli::main()
}
