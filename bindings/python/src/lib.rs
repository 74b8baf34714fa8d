//! The Python module `cobscope._cobscope`; `python/cobscope/__init__.py` completes it.
//!
//! ```text
//! open(path, …) ─▶ Capture ─▶ events(), signals(), frames()        decoded on another thread, in batches ─▶ Arrow, rows
//!                          └▶ findings(), stories(), objects()     of one pass
//! Decoder.push(frame) ─▶ events(), signals()                       since the last call
//! ```

mod capture;
mod columns;
mod errors;
mod live;
mod records;
mod rows;
mod stream;
mod table;
mod tables;

use std::ffi::OsString;

use cobscope::embedded;
use pyo3::prelude::*;

use errors::to_exception;

/// Lines of `check -f jsonl`, their findings as a table, messages, and the exit status.
#[pyfunction]
fn check(py: Python<'_>, words: Vec<OsString>) -> PyResult<(String, table::Table, Vec<String>, u8)> {
    let answer = py.detach(|| embedded::check(&words)).map_err(|error| to_exception(py, &error))?;
    let (text, lines, exit) = answer.value;
    Ok((text, capture::findings_of(&lines)?, answer.messages, exit as u8))
}

/// The object of `diff -f json`, and messages.
#[pyfunction]
fn diff(py: Python<'_>, words: Vec<OsString>) -> PyResult<(String, Vec<String>)> {
    let answer = py.detach(|| embedded::diff(&words)).map_err(|error| to_exception(py, &error))?;
    Ok((answer.value, answer.messages))
}

/// The text of `explain`.
#[pyfunction]
fn explain(py: Python<'_>, words: Vec<OsString>) -> PyResult<String> {
    let answer = py.detach(|| embedded::explain(&words)).map_err(|error| to_exception(py, &error))?;
    Ok(answer.value)
}

/// Runs the program; returns its exit status.
#[pyfunction]
fn run(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| cobscope::run_embedded(words) as u8)
}

#[pymodule]
fn _cobscope(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", py.get_type::<errors::Error>())?;
    module.add("ArgumentError", py.get_type::<errors::ArgumentError>())?;
    module.add("ProfileError", py.get_type::<errors::ProfileError>())?;
    module.add("CaptureError", py.get_type::<errors::CaptureError>())?;
    module.add_class::<capture::Capture>()?;
    module.add_class::<table::Table>()?;
    module.add_class::<table::Rows>()?;
    module.add_class::<live::Decoder>()?;
    module.add_function(wrap_pyfunction!(check, module)?)?;
    module.add_function(wrap_pyfunction!(diff, module)?)?;
    module.add_function(wrap_pyfunction!(explain, module)?)?;
    module.add_function(wrap_pyfunction!(run, module)?)
}
