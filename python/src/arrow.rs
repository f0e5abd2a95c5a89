//! Rows of `hmd`'s tables as Arrow record batches; names, units and kinds of columns are those of `hmd export`.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, RecordBatchIterator, StringArray,
    TimestampNanosecondArray,
};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use hmd_report::export::{ExportError, Head, Kind, Sources, Table, Value};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::error::raised;

/// Rows of a batch.
const ROWS: usize = 65_536;

/// Gathers rows into batches.
pub(crate) struct Batches {
    schema: SchemaRef,
    heads: Vec<Head>,
    /// Values by column, of the batch that is being filled.
    held: Vec<Vec<Value>>,
    done: Result<Vec<RecordBatch>, ArrowError>,
}

impl Batches {
    pub(crate) fn new(heads: Vec<Head>) -> Self {
        let fields: Vec<Field> = heads.iter().map(field).collect();
        Self {
            schema: Arc::new(Schema::new(fields)),
            held: vec![Vec::new(); heads.len()],
            heads,
            done: Ok(Vec::new()),
        }
    }

    pub(crate) fn row(&mut self, row: Vec<Value>) {
        for (column, value) in self.held.iter_mut().zip(row) {
            column.push(value);
        }
        if self.held[0].len() >= ROWS {
            self.end_batch();
        }
    }

    /// The table of all rows so far; begins anew.
    pub(crate) fn finish(&mut self) -> PyResult<ArrowTable> {
        if !self.held[0].is_empty() {
            self.end_batch();
        }
        let batches = std::mem::replace(&mut self.done, Ok(Vec::new())).map_err(raised)?;
        Ok(ArrowTable {
            schema: self.schema.clone(),
            batches,
        })
    }

    fn end_batch(&mut self) {
        let columns = self.heads.iter().zip(&mut self.held);
        let columns = columns.map(|(head, values)| column(head.kind, std::mem::take(values)));
        let batch = RecordBatch::try_new(self.schema.clone(), columns.collect());
        // The first error stays.
        if let Ok(done) = &mut self.done {
            match batch {
                Ok(batch) => done.push(batch),
                Err(error) => self.done = Err(error),
            }
        }
    }
}

/// [`Batches`] behind the export's own door, which keeps what it is given.
#[derive(Clone)]
pub(crate) struct Shared(Arc<Mutex<Batches>>);

impl Shared {
    pub(crate) fn new(heads: Vec<Head>) -> Self {
        Self(Arc::new(Mutex::new(Batches::new(heads))))
    }

    /// The table, once the export has ended.
    pub(crate) fn into_table(self) -> PyResult<ArrowTable> {
        self.batches().finish()
    }

    fn batches(&self) -> MutexGuard<'_, Batches> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table for Shared {
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError> {
        self.batches().row(row);
        Ok(())
    }

    fn finish(self: Box<Self>, _: &Sources) -> Result<(), ExportError> {
        Ok(())
    }
}

/// A table that any library of the Arrow family takes (`__arrow_c_stream__`), without a copy.
#[pyclass(frozen)]
pub(crate) struct ArrowTable {
    schema: SchemaRef,
    batches: Vec<RecordBatch>,
}

#[pymethods]
impl ArrowTable {
    /// The Arrow PyCapsule interface. A schema that is asked for is not obeyed, as the interface allows.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        let batches = self.batches.clone().into_iter().map(Ok);
        let reader = RecordBatchIterator::new(batches, self.schema.clone());
        let stream = FFI_ArrowArrayStream::new(Box::new(reader));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }
}

fn field(head: &Head) -> Field {
    let kind = match head.kind {
        Kind::Time => DataType::Timestamp(TimeUnit::Nanosecond, Some("UTC".into())),
        // As Parquet files have them: no count comes near 2⁶³.
        Kind::Count | Kind::Signed => DataType::Int64,
        Kind::Text => DataType::Utf8,
        Kind::Flag => DataType::Boolean,
        Kind::Number => DataType::Float64,
    };
    let unit = (!head.unit.is_empty()).then(|| ("unit".to_owned(), head.unit.to_owned()));
    Field::new(head.name, kind, head.kind.may_be_absent()).with_metadata(HashMap::from_iter(unit))
}

/// Values of one kind; the heads say of which.
fn column(kind: Kind, values: Vec<Value>) -> ArrayRef {
    let values = values.into_iter();
    match kind {
        Kind::Time => {
            let times = values.map(|value| match value {
                // Until the year 2262.
                Value::Time(n) => i64::try_from(n).ok(),
                _ => None,
            });
            Arc::new(TimestampNanosecondArray::from_iter(times).with_timezone("UTC"))
        }
        Kind::Count | Kind::Signed => Arc::new(Int64Array::from_iter(values.map(|value| match value {
            Value::Count(n) => i64::try_from(n).ok(),
            Value::Signed(n) => Some(n),
            _ => None,
        }))),
        Kind::Text => Arc::new(StringArray::from_iter(values.map(|value| match value {
            Value::Text(text) => Some(text),
            _ => None,
        }))),
        Kind::Flag => Arc::new(BooleanArray::from_iter(values.map(|value| match value {
            Value::Flag(flag) => flag,
            _ => None,
        }))),
        Kind::Number => Arc::new(Float64Array::from_iter(values.map(|value| match value {
            Value::Number(number) => number,
            _ => None,
        }))),
    }
}
