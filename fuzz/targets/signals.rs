//! Any bytes as a log of measured signals, CSV, Parquet or MF4 by their beginning: every signal in every row.
#![no_main]

use std::io::Cursor;

use hmd_ingest::mdf::{self, MdfSignals};
use hmd_ingest::signals::{Between, CsvLog, PARQUET_MAGIC, ParquetLog, SignalLog, Unusable};
use libfuzzer_sys::fuzz_target;

fn log(bytes: &[u8]) -> Result<Box<dyn SignalLog>, Unusable> {
    let bytes = bytes.to_vec();
    Ok(if bytes.starts_with(PARQUET_MAGIC) {
        Box::new(ParquetLog::new(bytes::Bytes::from(bytes), "a.parquet")?)
    } else if mdf::MAGICS.iter().any(|magic| bytes.starts_with(magic)) {
        Box::new(MdfSignals::new(Cursor::new(bytes), "a.mf4")?)
    } else {
        Box::new(CsvLog::new(Cursor::new(bytes), "a.csv")?)
    })
}

fuzz_target!(|bytes: &[u8]| {
    let Ok(mut log) = log(bytes) else { return };
    for group in log.groups() {
        let selected: Vec<_> = group.iter().map(|&n| (n, Between::Held)).collect();
        let mut row = vec![0.0; group.len()];
        if log.select(&selected).is_ok() {
            while log.next_row(&mut row, &|_, _| None).is_some() {}
        }
    }
});
