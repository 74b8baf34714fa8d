//! Messages on stderr.

use std::cell::RefCell;
use std::fmt;
use std::io::Write as _;

use cobscope_decoder::sink::escape;

use crate::exit_code::ExitStatus;

/// An error with its exit status.
pub type Refusal = (ExitStatus, anyhow::Error);

/// Value of an option that does not exist in a capture, such as the number of a story.
#[derive(Debug)]
struct AbsentValue(String);

impl fmt::Display for AbsentValue {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for AbsentValue {}

/// Error for the value of an option that does not exist in a capture. The end of an incomplete capture may contain it:
/// then the error is `failure`, which ended reading.
pub fn absent_value(text: String, failure: Option<&anyhow::Error>) -> anyhow::Error {
    match failure {
        Some(failure) => anyhow::anyhow!("{text}; {failure:#}"),
        None => AbsentValue(text).into(),
    }
}

/// Exit status for an error of one capture: an option names an absent value, or the capture cannot be read.
pub fn exit_of(error: &anyhow::Error) -> ExitStatus {
    if error.is::<AbsentValue>() { ExitStatus::Usage } else { ExitStatus::Capture }
}

thread_local! {
    /// Messages of this thread, if another program runs a command and prints them itself.
    static COLLECTED: RefCell<Option<Vec<String>>> = const { RefCell::new(None) };
}

/// Reports an error, with its context.
pub fn print_error(error: &anyhow::Error) {
    print_warning(&format!("{error:#}"));
}

/// Reports a problem that does not end the command, in several lines.
pub fn print_warning(text: &str) {
    let lines: Vec<_> = text.lines().map(escape).collect();
    report_message(lines.join("\n"));
}

/// Reports information in one line.
pub fn print_note(text: &str) {
    report_message(escape(text).into_owned());
}

/// Runs `work`, and returns its messages in place of printing them.
pub fn collect_messages<T>(work: impl FnOnce() -> T) -> (T, Vec<String>) {
    let outer = COLLECTED.replace(Some(Vec::new()));
    let result = work();
    (result, COLLECTED.replace(outer).unwrap_or_default())
}

fn report_message(message: String) {
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
        let (inner, messages) = collect_messages(|| {
            print_warning("one\x1b\ntwo");
            let (value, inner) = collect_messages(|| {
                print_note("three");
                7
            });
            print_note("four");
            (value, inner)
        });
        assert_eq!(inner, (7, vec!["three".to_owned()]));
        assert_eq!(messages, ["one\\u{1b}\ntwo", "four"]);
        assert!(COLLECTED.with_borrow(Option::is_none));
    }
}
