//! The command line of Throng. Results go to stdout, progress and messages to stderr.
//! Exit status: 0 all is well, 1 a check failed, 2 an error.

#![forbid(unsafe_code)]

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
