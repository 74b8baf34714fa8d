//! A table for Python: an Arrow stream, and an iterator of rows.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use arrow_array::RecordBatch;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_schema::SchemaRef;
use arrow_schema::ffi::FFI_ArrowSchema;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict};

use crate::errors::capture_error;
use crate::rows::{BatchRows, Converters};
use crate::stream::{Batches, CapturePass, NextBatch};
use crate::tables::{EventsTable, FramesTable, GrowingTable, SignalsTable};

/// Time between looks at the signals of Python, such as Ctrl-C.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(100);

/// Name and constructor of a table that is decoded when it is read.
#[derive(Clone, Copy)]
pub enum TableKind {
    /// Values.
    Signals,
    /// Events.
    Events,
    /// Frames.
    Frames,
}

impl TableKind {
    fn grow(self, capture: &str) -> Box<dyn GrowingTable> {
        match self {
            Self::Signals => Box::new(SignalsTable::new(capture)),
            Self::Events => Box::new(EventsTable::new(capture)),
            Self::Frames => Box::new(FramesTable::new(capture)),
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Signals => "signals",
            Self::Events => "events",
            Self::Frames => "frames",
        }
    }
}

enum TableContent {
    /// Decoded again each time that the table is read.
    Capture(CapturePass, TableKind),
    Memory(&'static str, Vec<RecordBatch>),
}

/// A table: an Arrow stream for polars, pandas, DuckDB and pyarrow, and an iterator of rows.
///
/// Tables of a capture are decoded each time that they are read, in batches, so that memory is bounded.
#[pyclass(module = "cobscope", frozen)]
pub struct Table {
    schema: SchemaRef,
    content: TableContent,
}

impl Table {
    /// A table that is decoded when it is read.
    pub fn of_capture(pass: CapturePass, kind: TableKind) -> Self {
        Self { schema: kind.grow("").schema(), content: TableContent::Capture(pass, kind) }
    }

    /// A table in memory.
    pub fn of_batches(name: &'static str, schema: SchemaRef, batches: Vec<RecordBatch>) -> Self {
        Self { schema, content: TableContent::Memory(name, batches) }
    }

    fn batches(&self) -> Batches {
        match &self.content {
            TableContent::Capture(pass, kind) => Batches::start(pass.clone(), kind.grow(&pass.source.name())),
            TableContent::Memory(_, batches) => Batches::of(SchemaRef::clone(&self.schema), batches.clone()),
        }
    }
}

#[pymethods]
impl Table {
    /// Names of the columns.
    #[getter]
    fn columns(&self) -> Vec<String> {
        self.schema.fields().iter().map(|field| field.name().clone()).collect()
    }

    /// The Arrow C stream interface. `requested_schema` is ignored, as the interface permits.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        drop(requested_schema);
        let stream = FFI_ArrowArrayStream::new(Box::new(self.batches()));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    /// The Arrow C schema interface.
    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = FFI_ArrowSchema::try_from(self.schema.as_ref());
        let schema = schema.map_err(|error| PyValueError::new_err(error.to_string()))?;
        PyCapsule::new_with_value(py, schema, c"arrow_schema")
    }

    fn __iter__(&self, py: Python<'_>) -> PyResult<Rows> {
        let batches = Mutex::new(Some(self.batches()));
        let schema = SchemaRef::clone(&self.schema);
        Ok(Rows { schema, with: Converters::new(py)?, batches, current: None })
    }

    fn __repr__(&self) -> String {
        let name = match &self.content {
            TableContent::Capture(_, kind) => kind.name(),
            TableContent::Memory(name, _) => name,
        };
        format!("<cobscope.Table {name}: {}>", self.columns().join(", "))
    }
}

/// Iterator of the rows of a table.
#[pyclass(module = "cobscope")]
pub struct Rows {
    schema: SchemaRef,
    with: Converters,
    /// `None` after the end. The lock makes the type shareable and is never waited for.
    batches: Mutex<Option<Batches>>,
    current: Option<BatchRows>,
}

#[pymethods]
impl Rows {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        loop {
            if let Some(rows) = &mut self.current
                && let Some(row) = rows.next(py, &self.with)?
            {
                return Ok(Some(row));
            }
            self.current = None;
            let batches = self.batches.get_mut().unwrap_or_else(PoisonError::into_inner).take();
            let Some(batches) = batches else { return Ok(None) };
            // The receiver cannot be lent to a closure without the interpreter.
            let (batches, next) = py.detach(move || {
                let next = batches.next_within(SIGNAL_INTERVAL);
                (batches, next)
            });
            match next {
                NextBatch::Batch(batch) => self.current = Some(BatchRows::new(&batch, &self.schema)),
                NextBatch::Failure(reason) => return Err(capture_error(py, &reason)),
                NextBatch::End => return Ok(None),
                NextBatch::Waiting => py.check_signals()?,
            }
            self.batches = Mutex::new(Some(batches));
        }
    }
}
