//! Tables in Parquet: plain columns of numbers and texts, uncompressed or by Snappy, Zstandard, gzip or LZ4.
//!
//! A unit stands behind a name as `name [unit]`; a column of time stamps counts as what its type says, since 1970. Rows are read in
//! batches, so that of each column at most one page is held. A file may say of itself that it has any number of rows: no more are read
//! than a file of its size can hold. The crate that decodes panics at some damaged files: such a group of rows is lost like any other
//! that is damaged.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use parquet::basic::{LogicalType, TimeUnit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;

use super::log::{Between, SignalInfo, SignalLog, TextValue, Unusable, name_and_unit};
use crate::damage::{Damage, Place};

/// First bytes of such a file.
pub const MAGIC: &[u8] = b"PAR1";

/// Rows that are read at once.
const BATCH: usize = 1024;

/// Most rows for each byte of a file. Of what pandas writes a row of a log takes some bytes; columns without end that take none are an attack.
const ROWS_PER_BYTE: u64 = 100;

/// Longest text that is looked at, bytes.
const TEXT_MAX: usize = 256;

/// Reads a table from a file.
pub struct ParquetLog<R: ChunkReader + 'static> {
    reader: SerializedFileReader<R>,
    file: Arc<str>,
    signals: Vec<SignalInfo>,
    /// Of each signal: its column in the file.
    columns: Vec<usize>,
    selected: Vec<usize>,
    /// Row group to come.
    group: usize,
    cells: Vec<Cells>,
    /// Next row of the batch, and their number.
    next: usize,
    batch: usize,
    row: u64,
    /// Bytes of the file.
    length: u64,
    ended: bool,
}

/// A batch of one column.
struct Cells {
    reader: ColumnReader,
    is_required: bool,
    values: Vec<Cell>,
}

#[derive(Clone)]
enum Cell {
    Number(f64),
    Text(ByteArray),
}

impl<R: ChunkReader + 'static> ParquetLog<R> {
    /// A reader of `input`; `file` names it in errors.
    ///
    /// # Errors
    /// There is no table of plain columns.
    pub fn new(input: R, file: &str) -> Result<Self, Unusable> {
        let length = input.len();
        let reader = guarded(|| SerializedFileReader::new(input).map_err(|error| one_line(&error)))
            .map_err(|found| Unusable::new("a Parquet file", found))?;
        let (mut signals, mut columns) = (Vec::new(), Vec::new());
        for (n, column) in reader
            .metadata()
            .file_metadata()
            .schema_descr()
            .columns()
            .iter()
            .enumerate()
        {
            if is_plain(column) {
                signals.push(info(column));
                columns.push(n);
            }
        }
        Ok(Self {
            reader,
            file: file.into(),
            signals,
            columns,
            selected: Vec::new(),
            group: 0,
            cells: Vec::new(),
            next: 0,
            batch: 0,
            row: 0,
            length,
            ended: false,
        })
    }

    /// Whether the columns of a row group lie in the file: the crate takes that for granted.
    fn check_places(&self, group: usize) -> Result<(), String> {
        let group = self.reader.metadata().row_group(group);
        for &column in &self.selected {
            let column = group.columns().get(column).ok_or("fewer columns")?;
            let start = column.dictionary_page_offset().unwrap_or(column.data_page_offset());
            let place = u64::try_from(start)
                .ok()
                .zip(u64::try_from(column.compressed_size()).ok());
            let end = place.and_then(|(start, size)| start.checked_add(size));
            if end.is_none_or(|end| end > self.length) {
                return Err("a column beyond the end of the file".to_owned());
            }
        }
        Ok(())
    }

    /// Reads the next batch; false at the end.
    fn read_batch(&mut self) -> Result<bool, String> {
        loop {
            if self.cells.is_empty() {
                if self.group >= self.reader.num_row_groups() {
                    return Ok(false);
                }
                // It is left behind, whatever becomes of it.
                let number = self.group;
                self.group += 1;
                self.check_places(number)?;
                let group = self.reader.get_row_group(number).map_err(|error| one_line(&error))?;
                let schema = self.reader.metadata().file_metadata().schema_descr();
                for &column in &self.selected {
                    let reader = group.get_column_reader(column).map_err(|error| one_line(&error))?;
                    self.cells.push(Cells {
                        reader,
                        is_required: schema.column(column).max_def_level() == 0,
                        values: Vec::with_capacity(BATCH),
                    });
                }
            }
            let mut lengths = self.cells.iter_mut().map(Cells::read).collect::<Result<Vec<_>, _>>()?;
            lengths.dedup();
            match lengths.as_slice() {
                [0] | [] => self.cells.clear(),
                [length] => {
                    (self.next, self.batch) = (0, *length);
                    return Ok(true);
                }
                _ => return Err("columns of several lengths".to_owned()),
            }
        }
    }
}

impl<R: ChunkReader + 'static> SignalLog for ParquetLog<R> {
    fn signals(&self) -> &[SignalInfo] {
        &self.signals
    }

    fn select(&mut self, signals: &[(usize, Between)]) -> Result<(), Unusable> {
        self.selected = signals.iter().map(|&(n, _)| self.columns[n]).collect();
        Ok(())
    }

    fn next_row(&mut self, row: &mut [f64], text: TextValue<'_>) -> Option<Result<(), Damage>> {
        if self.ended {
            return None;
        }
        if self.next == self.batch {
            let fault = match guarded(|| self.read_batch()) {
                Ok(true) if self.row < self.length.saturating_mul(ROWS_PER_BYTE) => None,
                Ok(true) => Some("more rows than a file of its size can hold".to_owned()),
                Ok(false) => {
                    self.ended = true;
                    return None;
                }
                Err(found) => Some(found),
            };
            if let Some(found) = fault {
                // Where the next row group is does not depend on this one; what of it was read does.
                self.cells.clear();
                self.ended = self.row >= self.length.saturating_mul(ROWS_PER_BYTE);
                let (file, place) = (self.file.clone(), self.place());
                let expected = "a group of rows that can be read";
                return Some(Err(Damage {
                    file,
                    place,
                    expected,
                    found,
                }));
            }
        }
        for (n, (value, cells)) in row.iter_mut().zip(&self.cells).enumerate() {
            *value = match &cells.values[self.next] {
                Cell::Number(number) => *number,
                Cell::Text(bytes) => {
                    let cell = bytes.data().get(..TEXT_MAX).unwrap_or(bytes.data());
                    std::str::from_utf8(cell)
                        .ok()
                        .and_then(|cell| text(n, cell))
                        .unwrap_or(f64::NAN)
                }
            };
        }
        self.next += 1;
        self.row += 1;
        Some(Ok(()))
    }

    fn place(&self) -> Place {
        Place::Row(self.row)
    }

    fn position(&self) -> Option<u64> {
        let groups = self.reader.metadata().row_groups();
        Some(
            groups
                .iter()
                .take(self.group)
                .map(|group| group.compressed_size().max(0).cast_unsigned())
                .sum(),
        )
    }
}

impl Cells {
    /// Reads a batch; its length.
    fn read(&mut self) -> Result<usize, String> {
        let (required, out) = (self.is_required, &mut self.values);
        out.clear();
        let number = |value: f64| Cell::Number(value);
        match &mut self.reader {
            ColumnReader::BoolColumnReader(reader) => {
                read(reader, required, out, |&value| number(f64::from(u8::from(value))))
            }
            ColumnReader::Int32ColumnReader(reader) => read(reader, required, out, |&value| number(f64::from(value))),
            ColumnReader::Int64ColumnReader(reader) => read(reader, required, out, |&value| number(value as f64)),
            ColumnReader::FloatColumnReader(reader) => read(reader, required, out, |&value| number(f64::from(value))),
            ColumnReader::DoubleColumnReader(reader) => read(reader, required, out, |&value| number(value)),
            ColumnReader::ByteArrayColumnReader(reader) => {
                read(reader, required, out, |value: &ByteArray| Cell::Text(value.clone()))
            }
            ColumnReader::Int96ColumnReader(_) | ColumnReader::FixedLenByteArrayColumnReader(_) => {
                Err("a column of another type".to_owned())
            }
        }
    }
}

/// Reads a batch of one type; where there is no value, none.
fn read<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    is_required: bool,
    out: &mut Vec<Cell>,
    cell: impl Fn(&T::T) -> Cell,
) -> Result<usize, String> {
    let (mut values, mut levels) = (Vec::with_capacity(BATCH), Vec::new());
    let wanted = (!is_required).then_some(&mut levels);
    let (records, _, _) = reader
        .read_records(BATCH, wanted, None, &mut values)
        .map_err(|error| one_line(&error))?;
    let mut values = values.iter();
    for n in 0..records {
        let is_there = is_required || levels.get(n).is_some_and(|&level| level > 0);
        let value = if is_there { values.next() } else { None };
        out.push(value.map_or(Cell::Number(f64::NAN), &cell));
    }
    Ok(records)
}

/// Whether a column has one number or text in each row, or none.
fn is_plain(column: &ColumnDescriptor) -> bool {
    let is_known = !matches!(column.physical_type(), Type::INT96 | Type::FIXED_LEN_BYTE_ARRAY);
    let is_scaled = matches!(column.logical_type_ref(), Some(LogicalType::Decimal(_)));
    column.max_rep_level() == 0 && column.max_def_level() <= 1 && is_known && !is_scaled
}

fn info(column: &ColumnDescriptor) -> SignalInfo {
    let named = name_and_unit(column.path().string().as_str());
    match column.logical_type_ref() {
        Some(LogicalType::Timestamp(stamp)) => SignalInfo {
            unit: Some(
                match stamp.unit {
                    TimeUnit::MILLIS => "ms",
                    TimeUnit::MICROS => "us",
                    TimeUnit::NANOS => "ns",
                }
                .to_owned(),
            ),
            ..named
        },
        _ => named,
    }
}

/// What a decoder finds, or that it gave up.
fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    // What it was at is dropped, or never used again.
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err("damage that its decoder gave up at".to_owned()))
}

fn one_line(error: &dyn fmt::Display) -> String {
    error.to_string().lines().collect::<Vec<_>>().join(" ")
}

impl<R: ChunkReader + 'static> fmt::Debug for ParquetLog<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ParquetLog")
            .field("row", &self.row)
            .finish_non_exhaustive()
    }
}
