//! The `cobscope` binary.

fn main() -> std::process::ExitCode {
    cobscope::run()
}
