//! Columns of a Parquet file: which are signals, in which unit, and what their numbers mean.
//!
//! Older writers say by the converted type alone what newer ones say by both.

use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type};
use parquet::schema::types::ColumnDescriptor;

use super::log::{SignalInfo, name_and_unit};

/// Whether a column has one number or text in each row, or none.
pub(super) fn is_plain(column: &ColumnDescriptor) -> bool {
    let is_known = match column.physical_type() {
        Type::FIXED_LEN_BYTE_ARRAY => false,
        Type::BYTE_ARRAY => !is_decimal(column),
        _ => true,
    };
    column.max_rep_level() == 0 && column.max_def_level() <= 1 && is_known
}

pub(super) fn is_decimal(column: &ColumnDescriptor) -> bool {
    let is_logical = matches!(column.logical_type_ref(), Some(LogicalType::Decimal(_)));
    is_logical || column.converted_type() == ConvertedType::DECIMAL
}

pub(super) fn decimals(column: &ColumnDescriptor) -> i32 {
    match column.logical_type_ref() {
        Some(LogicalType::Decimal(decimal)) => decimal.scale,
        _ if is_decimal(column) => column.type_scale(),
        _ => 0,
    }
}

pub(super) fn is_unsigned(column: &ColumnDescriptor) -> bool {
    use ConvertedType::{UINT_8, UINT_16, UINT_32, UINT_64};
    let is_logical = matches!(column.logical_type_ref(), Some(LogicalType::Integer(number)) if !number.is_signed);
    is_logical || matches!(column.converted_type(), UINT_8 | UINT_16 | UINT_32 | UINT_64)
}

pub(super) fn info(column: &ColumnDescriptor) -> SignalInfo {
    let named = name_and_unit(column.path().string().as_str());
    let unit = match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(stamp)), _) => match stamp.unit {
            TimeUnit::MILLIS => "ms",
            TimeUnit::MICROS => "us",
            TimeUnit::NANOS => "ns",
        },
        (_, ConvertedType::TIMESTAMP_MILLIS) => "ms",
        (_, ConvertedType::TIMESTAMP_MICROS) => "us",
        _ if column.physical_type() == Type::INT96 => "us",
        _ => return named,
    };
    SignalInfo {
        unit: Some(unit.to_owned()),
        ..named
    }
}
