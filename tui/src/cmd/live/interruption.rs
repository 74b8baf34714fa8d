//! The end of a session by Ctrl-C or by the system.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;

/// Flag that is set by Ctrl-C or a termination signal; a second one ends the program at once.
///
/// # Errors
/// The handler cannot be installed.
pub(super) fn interrupted() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    listen(&flag).context("cannot install the signal handler")?;
    Ok(flag)
}

#[cfg(unix)]
fn listen(flag: &Arc<AtomicBool>) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register_conditional_default(signal, Arc::clone(flag))?;
        signal_hook::flag::register(signal, Arc::clone(flag))?;
    }
    Ok(())
}

/// Ctrl-C, Ctrl-Break, a closed window, the end of the user's session.
#[cfg(windows)]
fn listen(flag: &Arc<AtomicBool>) -> Result<(), ctrlc::Error> {
    /// STATUS_CONTROL_C_EXIT (0xC000013A).
    const EXIT: i32 = -0x3FFF_FEC6;
    let flag = Arc::clone(flag);
    ctrlc::set_handler(move || {
        if flag.swap(true, std::sync::atomic::Ordering::Relaxed) {
            std::process::exit(EXIT);
        }
    })
}
