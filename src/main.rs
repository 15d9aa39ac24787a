//! The `sinew` program: parse, call, print what went wrong, exit.

use std::process::ExitCode;

fn main() -> ExitCode {
    sinew::main()
}
