//! Tables in Parquet: plain columns of numbers and texts, uncompressed or by Snappy, Zstandard, gzip or LZ4.
//!
//! A unit stands behind a name as `name [unit]`; a column of time stamps counts as what its type says, since 1970. Decimals in whole numbers have
//! the scale of their type; other decimals are no plain column. Rows are read in
//! batches, so that of each column at most one page is held. A file may say of itself that it has any number of rows: no more are read
//! than a file of its size can hold. The crate that decodes panics at some damaged files: such a group of rows is lost like any other
//! that is damaged.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::{ByteArray, DataType, Int96};
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};

use super::decoder_panics::guarded;
use super::ended_once::EndedOnce;
use super::log::{Between, SignalInfo, SignalLog, TextValue, Unusable};
use super::parquet_columns::{decimals, info, is_plain, is_unsigned};
use super::parquet_headers::BoundedPages;
use super::parquet_pages::CheckedPages;
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
    reader: SerializedFileReader<BoundedPages<EndedOnce<R>>>,
    file: Arc<str>,
    signals: Vec<SignalInfo>,
    not_read: Vec<String>,
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
    is_unsigned: bool,
    /// Powers of ten by which a decimal is less than its whole number.
    decimals: i32,
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
        let (input, are_pages) = BoundedPages::new(EndedOnce(input));
        let reader = guarded(|| SerializedFileReader::new(input).map_err(|error| one_line(&error)))
            .map_err(|found| Unusable::new("a Parquet file", found))?;
        are_pages.store(true, Relaxed);
        let (mut signals, mut not_read, mut columns) = (Vec::new(), Vec::new(), Vec::new());
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
            } else {
                not_read.push(column.path().string());
            }
        }
        Ok(Self {
            reader,
            file: file.into(),
            signals,
            not_read,
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
                    let pages = group.get_column_page_reader(column).map_err(|error| one_line(&error))?;
                    let pages = CheckedPages::new(pages, self.length.saturating_mul(ROWS_PER_BYTE));
                    let about = schema.column(column);
                    self.cells.push(Cells {
                        reader: get_column_reader(about.clone(), Box::new(pages)),
                        is_required: about.max_def_level() == 0,
                        is_unsigned: is_unsigned(&about),
                        decimals: decimals(&about),
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

    fn not_read(&self) -> &[String] {
        &self.not_read
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
        let (required, unsigned, out) = (self.is_required, self.is_unsigned, &mut self.values);
        out.clear();
        let number = |value: f64| Cell::Number(value);
        let scale = f64::powi(10.0, self.decimals);
        match &mut self.reader {
            ColumnReader::BoolColumnReader(reader) => {
                read(reader, required, out, |&value| number(f64::from(u8::from(value))))
            }
            ColumnReader::Int32ColumnReader(reader) => read(reader, required, out, |&value| {
                let whole = if unsigned {
                    f64::from(value.cast_unsigned())
                } else {
                    f64::from(value)
                };
                number(whole / scale)
            }),
            ColumnReader::Int64ColumnReader(reader) => read(reader, required, out, |&value| {
                let whole = if unsigned {
                    value.cast_unsigned() as f64
                } else {
                    value as f64
                };
                number(whole / scale)
            }),
            ColumnReader::FloatColumnReader(reader) => read(reader, required, out, |&value| number(f64::from(value))),
            ColumnReader::DoubleColumnReader(reader) => read(reader, required, out, |&value| number(value)),
            ColumnReader::ByteArrayColumnReader(reader) => {
                read(reader, required, out, |value: &ByteArray| Cell::Text(value.clone()))
            }
            ColumnReader::Int96ColumnReader(reader) => read(reader, required, out, |stamp| number(int96_us(stamp))),
            ColumnReader::FixedLenByteArrayColumnReader(_) => Err("a column of another type".to_owned()),
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

/// A time stamp of older writers, µs since 1970: nanoseconds of the day, and the Julian day.
fn int96_us(stamp: &Int96) -> f64 {
    const DAY_OF_1970: f64 = 2_440_588.0;
    const DAY_US: f64 = 86_400e6;
    let [low, high, day] = <[u32; 3]>::try_from(stamp.data()).unwrap_or_default();
    let of_day_ns = u64::from(high) << 32 | u64::from(low);
    (f64::from(day) - DAY_OF_1970) * DAY_US + of_day_ns as f64 / 1e3
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

#[cfg(test)]
mod tests {
    use parquet::basic::{ConvertedType, Repetition, Type};
    use parquet::column::writer::ColumnWriter;
    use parquet::file::properties::WriterProperties;
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::types::Type as Node;

    use super::*;

    /// A file of one column of whole numbers, annotated as older writers do.
    fn file(physical: Type, converted: ConvertedType, decimals: i32, values: &[i64]) -> bytes::Bytes {
        let column = Node::primitive_type_builder("x", physical)
            .with_repetition(Repetition::REQUIRED)
            .with_converted_type(converted)
            .with_precision(if decimals > 0 { 9 } else { -1 })
            .with_scale(if decimals > 0 { decimals } else { -1 })
            .with_length(if physical == Type::FIXED_LEN_BYTE_ARRAY { 4 } else { -1 });
        let column = Arc::new(column.build().expect("a column"));
        let schema = Node::group_type_builder("schema").with_fields(vec![column]);
        let schema = Arc::new(schema.build().expect("a schema"));
        let mut out = Vec::new();
        let mut writer =
            SerializedFileWriter::new(&mut out, schema, WriterProperties::builder().build().into()).expect("a writer");
        let mut group = writer.next_row_group().expect("a group");
        let mut column = group.next_column().expect("a column").expect("a column");
        match column.untyped() {
            ColumnWriter::Int32ColumnWriter(writer) => {
                let values: Vec<i32> = values.iter().map(|&value| value as i32).collect();
                writer.write_batch(&values, None, None).expect("values");
            }
            ColumnWriter::Int64ColumnWriter(writer) => {
                writer.write_batch(values, None, None).expect("values");
            }
            ColumnWriter::Int96ColumnWriter(writer) => {
                const DAY_NS: i64 = 86_400_000_000_000;
                let stamp = |ns: &i64| {
                    let (day, of_day) = (ns.div_euclid(DAY_NS), ns.rem_euclid(DAY_NS));
                    let mut stamp = Int96::new();
                    stamp.set_data(of_day as u32, (of_day >> 32) as u32, (2_440_588 + day) as u32);
                    stamp
                };
                let stamps: Vec<Int96> = values.iter().map(stamp).collect();
                writer.write_batch(&stamps, None, None).expect("values");
            }
            ColumnWriter::FixedLenByteArrayColumnWriter(_) => {}
            _ => panic!("another type"),
        }
        column.close().expect("a column");
        group.close().expect("a group");
        writer.close().expect("a file");
        out.into()
    }

    fn read_back(file: bytes::Bytes) -> (Option<String>, Vec<f64>) {
        let mut log = ParquetLog::new(file, "a.parquet").expect("a table");
        let unit = log.signals()[0].unit.clone();
        log.select(&[(0, Between::Unknown)]).expect("a column");
        let (mut found, mut row) = (Vec::new(), [0.0]);
        while let Some(read) = log.next_row(&mut row, &|_, _| None) {
            read.expect("a row");
            found.push(row[0]);
        }
        (unit, found)
    }

    #[test]
    fn whole_numbers_are_what_their_converted_type_says() {
        use ConvertedType::{DECIMAL, NONE, TIMESTAMP_MICROS, TIMESTAMP_MILLIS, UINT_32, UINT_64};
        for (physical, converted, decimals, written, unit, expected) in [
            (Type::INT64, DECIMAL, 3, 1234, None, 1.234),
            (Type::INT32, DECIMAL, 2, -1234, None, -12.34),
            (Type::INT32, UINT_32, 0, 0xffff_fffe, None, 4_294_967_294.0),
            (Type::INT32, NONE, 0, -2, None, -2.0),
            (Type::INT64, UINT_64, 0, -1, None, 18_446_744_073_709_551_615.0),
            (Type::INT64, TIMESTAMP_MILLIS, 0, 5, Some("ms"), 5.0),
            (Type::INT64, TIMESTAMP_MICROS, 0, 5, Some("us"), 5.0),
            (
                Type::INT96,
                NONE,
                0,
                1_700_000_000_002_500_000,
                Some("us"),
                1_700_000_000_002_500.0,
            ),
            (Type::INT96, NONE, 0, -1500, Some("us"), -1.5),
        ] {
            let (found_unit, found) = read_back(file(physical, converted, decimals, &[written]));
            assert_eq!(found_unit.as_deref(), unit, "{converted:?}");
            let is_near = (found[0] - expected).abs() <= 1e-12 * f64::abs(expected);
            assert!(found.len() == 1 && is_near, "{converted:?}: {found:?}");
        }
    }

    #[test]
    fn a_column_that_is_not_read_is_named() {
        let file = file(Type::FIXED_LEN_BYTE_ARRAY, ConvertedType::NONE, 0, &[]);
        let log = ParquetLog::new(file, "a.parquet").expect("a table");
        assert!(log.signals().is_empty());
        assert_eq!(log.not_read(), ["x"]);
    }
}
