//! `cobscope`: the binary.

fn main() -> std::process::ExitCode {
    cobscope::run()
}
