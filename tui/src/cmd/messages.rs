//! Messages on stderr.

use std::cell::RefCell;
use std::io::Write as _;

use cobscope_decoder::sink::escape;

use crate::exit_code::Exit;

/// An error with its exit status.
pub(super) type Refusal = (Exit, anyhow::Error);

thread_local! {
    /// Messages of this thread, if another program runs a command and prints them itself.
    static COLLECTED: RefCell<Option<Vec<String>>> = const { RefCell::new(None) };
}

/// Reports an error, with its context.
pub(super) fn complain(error: &anyhow::Error) {
    warn(&format!("{error:#}"));
}

/// Reports a problem that does not end the command, in several lines.
pub(super) fn warn(text: &str) {
    let lines: Vec<_> = text.lines().map(escape).collect();
    report(lines.join("\n"));
}

/// Reports information in one line.
pub(super) fn note(text: &str) {
    report(escape(text).into_owned());
}

/// Runs `work`, and returns its messages in place of printing them.
pub(super) fn collected<T>(work: impl FnOnce() -> T) -> (T, Vec<String>) {
    let outer = COLLECTED.replace(Some(Vec::new()));
    let result = work();
    (result, COLLECTED.replace(outer).unwrap_or_default())
}

fn report(message: String) {
    let printed = COLLECTED.with_borrow_mut(|collected| match collected {
        Some(messages) => {
            messages.push(message);
            None
        }
        None => Some(message),
    });
    if let Some(message) = printed {
        let _ = writeln!(std::io::stderr(), "cobscope: {message}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_collected_within_the_call_only() {
        let (inner, messages) = collected(|| {
            warn("one\x1b\ntwo");
            let (value, inner) = collected(|| {
                note("three");
                7
            });
            note("four");
            (value, inner)
        });
        assert_eq!(inner, (7, vec!["three".to_owned()]));
        assert_eq!(messages, ["one\\u{1b}\ntwo", "four"]);
        assert!(COLLECTED.with_borrow(Option::is_none));
    }
}
