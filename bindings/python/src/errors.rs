//! Exceptions. Each has the attributes `place` and `reason`.

use cobscope::ExitStatus;
use cobscope::embedded::CommandError;
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(cobscope, Error, PyException, "Base of all errors of this module: `place` and `reason`.");
create_exception!(cobscope, ArgumentError, Error, "An argument is not valid.");
create_exception!(
    cobscope,
    ProfileError,
    Error,
    "A profile, bus file, device file or database is not valid."
);
create_exception!(cobscope, CaptureError, Error, "A capture cannot be read, or not to its end.");

/// The exception for an error of a command.
pub fn to_exception(py: Python<'_>, error: &CommandError) -> PyErr {
    match error.exit {
        ExitStatus::Usage => with_place(py, ArgumentError::new_err(error.text.clone()), (None, &error.text)),
        ExitStatus::Profile => {
            with_place(py, ProfileError::new_err(error.text.clone()), split_message(&error.text))
        }
        _ => capture_error(py, &error.text),
    }
}

/// The exception for an argument that the module itself checks.
pub fn argument_error(text: &str) -> PyErr {
    Python::attach(|py| with_place(py, ArgumentError::new_err(text.to_owned()), (None, text)))
}

/// The exception for a capture.
pub fn capture_error(py: Python<'_>, text: &str) -> PyErr {
    with_place(py, CaptureError::new_err(text.to_owned()), split_message(text))
}

/// Place and reason of a message, such as `run.log: contains no frames`.
fn split_message(text: &str) -> (Option<&str>, &str) {
    text.split_once(": ").map_or((None, text), |(place, reason)| (Some(place), reason))
}

fn with_place(py: Python<'_>, error: PyErr, (place, reason): (Option<&str>, &str)) -> PyErr {
    let value = error.value(py);
    match value.setattr("place", place).and_then(|()| value.setattr("reason", reason)) {
        Ok(()) => error,
        Err(other) => other,
    }
}
