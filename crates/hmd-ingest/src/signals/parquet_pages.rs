//! Pages of a column in a Parquet file whose numbers of values can be true.
//!
//! The crate that decodes makes room for as many values as a page says it has, before it looks for them: a file of 14 kB took 12 GB.

use parquet::basic::Encoding;
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};

/// The pages of a reader; one that says what cannot be is an error.
pub(super) struct CheckedPages {
    pages: Box<dyn PageReader>,
    values_max: u64,
}

impl CheckedPages {
    /// Of a file that holds no more than so many values in a column.
    pub(super) fn new(pages: Box<dyn PageReader>, values_max: u64) -> Self {
        Self { pages, values_max }
    }
}

impl Iterator for CheckedPages {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

impl PageReader for CheckedPages {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let page = self.pages.get_next_page()?;
        match page.as_ref().and_then(|page| fault(page, self.values_max)) {
            Some(fault) => Err(ParquetError::General(fault.to_owned())),
            None => Ok(page),
        }
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.pages.skip_next_page()
    }

    fn at_record_boundary(&mut self) -> Result<bool> {
        self.pages.at_record_boundary()
    }
}

/// What is wrong with a page.
fn fault(page: &Page, values_max: u64) -> Option<&'static str> {
    if let Page::DictionaryPage { buf, num_values, .. } = page {
        // Each value of a dictionary takes a byte or more.
        return (*num_values as usize > buf.len()).then_some("a dictionary of more values than it has bytes");
    }
    if u64::from(page.num_values()) > values_max {
        return Some("a page of more values than a file of its size can hold");
    }
    // How many lengths there are is said between the values.
    let is_delta = matches!(
        page.encoding(),
        Encoding::DELTA_LENGTH_BYTE_ARRAY | Encoding::DELTA_BYTE_ARRAY
    );
    is_delta.then_some("texts as differences (DELTA_BYTE_ARRAY), which are not read")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_says_no_more_than_its_bytes_can_hold() {
        let dictionary = |num_values| Page::DictionaryPage {
            buf: vec![0; 8].into(),
            num_values,
            encoding: Encoding::PLAIN,
            is_sorted: false,
        };
        assert_eq!(fault(&dictionary(2), 0), None);
        assert!(fault(&dictionary(9), u64::MAX).is_some());
        let data = |num_values, encoding| Page::DataPage {
            buf: vec![0; 8].into(),
            num_values,
            encoding,
            def_level_encoding: Encoding::RLE,
            rep_level_encoding: Encoding::RLE,
            statistics: None,
        };
        // One value over and over takes no room.
        assert_eq!(fault(&data(100, Encoding::RLE_DICTIONARY), 100), None);
        assert!(fault(&data(101, Encoding::RLE_DICTIONARY), 100).is_some());
        for encoding in [Encoding::DELTA_LENGTH_BYTE_ARRAY, Encoding::DELTA_BYTE_ARRAY] {
            assert!(fault(&data(1, encoding), 100).is_some());
        }
    }
}
