//! Rows of batches as dictionaries of Python.

use arrow_array::cast::AsArray as _;
use arrow_array::types::{Float64Type, Int32Type, Int64Type, TimestampMicrosecondType};
use arrow_array::{
    Array as _, ArrayRef, BinaryArray, BooleanArray, Float64Array, Int32Array, Int64Array, RecordBatch,
    StringArray, TimestampMicrosecondArray,
};
use arrow_schema::{DataType, Schema};
use pyo3::IntoPyObjectExt as _;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyString};

/// Column that contains JSON.
const JSON: &str = "json";

/// Functions of Python that values need.
pub struct Converters {
    loads: Py<PyAny>,
    /// 1970, UTC.
    epoch: Py<PyAny>,
    duration: Py<PyAny>,
}

impl Converters {
    /// Imports the functions.
    ///
    /// # Errors
    /// If the standard library is incomplete.
    pub fn new(py: Python<'_>) -> PyResult<Self> {
        let datetime = py.import("datetime")?;
        let utc = datetime.getattr("timezone")?.getattr("utc")?;
        Ok(Self {
            loads: py.import("json")?.getattr("loads")?.unbind(),
            epoch: datetime.getattr("datetime")?.call1((1970, 1, 1, 0, 0, 0, 0, utc))?.unbind(),
            duration: datetime.getattr("timedelta")?.unbind(),
        })
    }

    fn time<'py>(&self, py: Python<'py>, micros: i64) -> PyResult<Bound<'py, PyAny>> {
        let since = self.duration.bind(py).call1((0, 0, micros))?;
        self.epoch.bind(py).add(since)
    }
}

/// A column of a batch.
enum BatchColumn {
    Times(TimestampMicrosecondArray),
    Numbers(Int64Array),
    Reals(Float64Array),
    Truths(BooleanArray),
    Names(Int32Array, StringArray),
    Texts(StringArray),
    Json(StringArray),
    Bytes(BinaryArray),
}

impl BatchColumn {
    fn of(name: &str, array: &ArrayRef) -> Option<Self> {
        Some(match array.data_type() {
            DataType::Timestamp(..) => {
                Self::Times(array.as_primitive_opt::<TimestampMicrosecondType>()?.clone())
            }
            DataType::Int64 => Self::Numbers(array.as_primitive_opt::<Int64Type>()?.clone()),
            DataType::Float64 => Self::Reals(array.as_primitive_opt::<Float64Type>()?.clone()),
            DataType::Boolean => Self::Truths(array.as_boolean_opt()?.clone()),
            DataType::Dictionary(..) => {
                let names = array.as_dictionary_opt::<Int32Type>()?;
                Self::Names(names.keys().clone(), names.values().as_string_opt::<i32>()?.clone())
            }
            DataType::Utf8 if name == JSON => Self::Json(array.as_string_opt::<i32>()?.clone()),
            DataType::Utf8 => Self::Texts(array.as_string_opt::<i32>()?.clone()),
            DataType::Binary => Self::Bytes(array.as_binary_opt::<i32>()?.clone()),
            _ => return None,
        })
    }

    fn get<'py>(&self, row: usize, py: Python<'py>, with: &Converters) -> PyResult<Bound<'py, PyAny>> {
        let none = || Ok(py.None().into_bound(py));
        match self {
            Self::Times(all) if all.is_valid(row) => with.time(py, all.value(row)),
            Self::Numbers(all) if all.is_valid(row) => all.value(row).into_bound_py_any(py),
            Self::Reals(all) if all.is_valid(row) => all.value(row).into_bound_py_any(py),
            Self::Truths(all) if all.is_valid(row) => all.value(row).into_bound_py_any(py),
            Self::Names(keys, names) if keys.is_valid(row) => {
                let key = usize::try_from(keys.value(row)).unwrap_or(usize::MAX);
                if key < names.len() { Ok(PyString::new(py, names.value(key)).into_any()) } else { none() }
            }
            Self::Texts(all) if all.is_valid(row) => Ok(PyString::new(py, all.value(row)).into_any()),
            Self::Json(all) if all.is_valid(row) => with.loads.bind(py).call1((all.value(row),)),
            Self::Bytes(all) if all.is_valid(row) => Ok(PyBytes::new(py, all.value(row)).into_any()),
            _ => none(),
        }
    }
}

/// A batch that is read by rows.
pub struct BatchRows {
    columns: Vec<(String, BatchColumn)>,
    count: usize,
    next: usize,
}

impl BatchRows {
    /// The rows of a batch.
    pub fn new(batch: &RecordBatch, schema: &Schema) -> Self {
        let columns = schema.fields().iter().zip(batch.columns());
        let columns = columns
            .filter_map(|(field, array)| Some((field.name().clone(), BatchColumn::of(field.name(), array)?)));
        Self { columns: columns.collect(), count: batch.num_rows(), next: 0 }
    }

    /// The next row.
    ///
    /// # Errors
    /// If Python has no memory, or a time is outside of its calendar.
    pub fn next<'py>(&mut self, py: Python<'py>, with: &Converters) -> PyResult<Option<Bound<'py, PyDict>>> {
        if self.next >= self.count {
            return Ok(None);
        }
        let row = PyDict::new(py);
        for (name, cells) in &self.columns {
            row.set_item(name, cells.get(self.next, py, with)?)?;
        }
        self.next += 1;
        Ok(Some(row))
    }
}
