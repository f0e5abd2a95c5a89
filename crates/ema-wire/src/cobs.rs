//! COBS decoding in place.
//!
//! Postcard's COBS flavor encodes. Postcard's decoder is not used, because it deserialises before the CRC is checked.

/// Decodes one frame, without the 0x00 that ends it, in place and returns the number of decoded bytes.
///
/// `None` when a code byte points past the end. An empty frame decodes to zero bytes.
pub(crate) fn decode_in_place(frame: &mut [u8]) -> Option<usize> {
    let (mut read, mut written) = (0, 0);
    while let Some(&code) = frame.get(read) {
        // Code byte n: n-1 literal bytes, then a zero. Code byte 0xFF: 254 literal bytes, no zero. The zero after the last
        // run is not part of the data. A code byte 0 is invalid.
        let run = usize::from(code).checked_sub(1)?;
        let (start, end) = (read + 1, read + 1 + run);
        if end > frame.len() {
            return None;
        }
        frame.copy_within(start..end, written);
        written += run;
        if code != u8::MAX && end < frame.len() {
            frame[written] = 0;
            written += 1;
        }
        read = end;
    }
    Some(written)
}

#[cfg(test)]
mod tests {
    use super::decode_in_place;

    #[test]
    fn decodes_the_examples_of_the_definition() {
        for (encoded, decoded) in [
            (&[1, 1][..], &[0][..]),
            (&[1, 1, 1], &[0, 0]),
            (&[3, 0x11, 0x22, 2, 0x33], &[0x11, 0x22, 0, 0x33]),
            (&[2, 0x11, 1, 1, 1], &[0x11, 0, 0, 0]),
            (&[], &[]),
        ] {
            let mut buffer = [0; 8];
            let frame = &mut buffer[..encoded.len()];
            frame.copy_from_slice(encoded);
            let length = decode_in_place(frame).expect("valid");
            assert_eq!(&frame[..length], decoded);
        }
        assert_eq!(decode_in_place(&mut [3, 0x11]), None);
    }

    #[test]
    fn no_zero_follows_a_run_of_254_bytes() {
        let mut frame = [7; 256];
        frame[0] = 0xff;
        frame[255] = 1;
        assert_eq!(decode_in_place(&mut frame), Some(254));
    }
}
