//! A capture for Python.

use std::ffi::OsString;
use std::sync::{Arc, OnceLock};

use cobscope::embedded::{CaptureResults, CaptureSource};
use cobscope_decoder::query::Filter;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::Value;

use crate::errors::{argument_error, capture_error, to_exception};
use crate::records::{FINDINGS, OBJECTS, RecordTable, STORIES};
use crate::stream::{CapturePass, PassMessages};
use crate::table::{Table, TableKind};

/// A capture with the options to decode it. Nothing is decoded before a table is read.
#[pyclass(module = "cobscope", frozen)]
pub struct Capture {
    source: Arc<CaptureSource>,
    messages: Arc<PassMessages>,
    allows_incomplete: bool,
    whole: OnceLock<CaptureResults>,
}

impl Capture {
    fn pass(&self, filter: Option<&str>, has_rules: bool) -> PyResult<CapturePass> {
        let filter = filter.map(str::parse::<Filter>).transpose();
        let filter = filter.map_err(|error| argument_error(&format!("filter: {error}")))?;
        Ok(CapturePass {
            source: Arc::clone(&self.source),
            messages: Arc::clone(&self.messages),
            allows_incomplete: self.allows_incomplete,
            has_rules,
            filter: filter.map(Arc::new),
        })
    }

    /// Results of the whole capture, which is read once for all of them.
    fn whole(&self, py: Python<'_>) -> PyResult<&CaptureResults> {
        let whole = if let Some(whole) = self.whole.get() {
            whole
        } else {
            let read = py.detach(|| self.source.results()).map_err(|error| to_exception(py, &error))?;
            self.messages.add_messages(read.end.messages.clone());
            self.whole.get_or_init(|| read)
        };
        match &whole.end.failure {
            Some(failure) if !self.allows_incomplete => Err(capture_error(py, failure)),
            Some(failure) => {
                self.messages.add_messages(vec![failure.clone()]);
                Ok(whole)
            }
            None => Ok(whole),
        }
    }
}

/// A table of records in memory.
pub fn table_of(table: &RecordTable, records: &[Value]) -> PyResult<Table> {
    let batch = table.build_batch(records).map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(Table::of_batches(table.name, table.schema(), vec![batch]))
}

/// Findings among the lines of `check -f jsonl`.
pub fn findings_of(lines: &[Value]) -> PyResult<Table> {
    let findings: Vec<_> =
        lines.iter().filter(|line| line.get("kind").is_some_and(|kind| kind == "finding")).cloned().collect();
    table_of(&FINDINGS, &findings)
}

#[pymethods]
impl Capture {
    #[staticmethod]
    #[pyo3(name = "_open")]
    fn open(py: Python<'_>, words: Vec<OsString>, allows_incomplete: bool) -> PyResult<Self> {
        let opened = py.detach(|| CaptureSource::open(&words)).map_err(|error| to_exception(py, &error))?;
        let messages = PassMessages::default();
        messages.add_messages(opened.messages);
        Ok(Self {
            source: Arc::new(opened.value),
            messages: Arc::new(messages),
            allows_incomplete,
            whole: OnceLock::new(),
        })
    }

    /// Name of the capture: its path, or the first and last path of a series.
    #[getter]
    fn name(&self) -> String {
        self.source.name()
    }

    /// Files of the capture, in order.
    #[getter]
    fn parts(&self) -> Vec<String> {
        self.source.parts()
    }

    /// Warnings so far, such as unreadable lines. They are complete after a table was read to its end.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.messages.all_messages()
    }

    /// All events in the order of time, also those that the text output omits.
    ///
    /// filter: a condition such as "kind == emcy && node == 4". rules: findings are among the events.
    #[pyo3(signature = (filter=None, *, rules=true))]
    fn events(&self, filter: Option<&str>, rules: bool) -> PyResult<Table> {
        Ok(Table::of_capture(self.pass(filter, rules)?, TableKind::Events))
    }

    /// All values of PDOs, of J1939 messages and of frames described by a DBC, one row per value.
    ///
    /// filter: a condition for their events, such as "node == 4".
    #[pyo3(signature = (filter=None))]
    fn signals(&self, filter: Option<&str>) -> PyResult<Table> {
        Ok(Table::of_capture(self.pass(filter, false)?, TableKind::Signals))
    }

    /// All frames.
    fn frames(&self) -> PyResult<Table> {
        Ok(Table::of_capture(self.pass(None, false)?, TableKind::Frames))
    }

    /// Findings of all rules, one row per finding.
    fn findings(&self, py: Python<'_>) -> PyResult<Table> {
        findings_of(&self.whole(py)?.findings)
    }

    /// Stories: a cause with its effects, most likely cause first.
    fn stories(&self, py: Python<'_>) -> PyResult<Table> {
        let whole = self.whole(py)?;
        let stories = whole.why.get("stories").and_then(Value::as_array);
        let mut stories = stories.cloned().unwrap_or_default();
        for story in &mut stories {
            if let Some(members) = story.as_object_mut() {
                members.insert("capture".into(), self.source.name().into());
            }
        }
        table_of(&STORIES, &stories)
    }

    /// Object values of all nodes at the end of the capture.
    fn objects(&self, py: Python<'_>) -> PyResult<Table> {
        table_of(&OBJECTS, &self.whole(py)?.objects)
    }

    #[pyo3(name = "_statistics")]
    fn statistics(&self, py: Python<'_>) -> PyResult<String> {
        Ok(self.whole(py)?.statistics.to_string())
    }

    fn __repr__(&self) -> String {
        format!("<cobscope.Capture {}>", self.source.name())
    }
}
