use super::*;

const HEAD: &str = "date Tue Nov 14 22:13:20.000 2023\nbase hex  timestamps absolute\ninternal events logged\n";

fn read(text: &str) -> Vec<Result<RawFrame, Damage>> {
    AscReader::new(text.as_bytes(), "a.asc", BusNames::new()).collect()
}

fn as_candump(text: &str) -> String {
    let mut reader = AscReader::new(text.as_bytes(), "a.asc", BusNames::new());
    let mut out = Vec::new();
    while let Some(item) = reader.next() {
        let frame = item.unwrap();
        let name = reader.bus_names().name(frame.bus).unwrap();
        crate::candump::emit(&frame, name, crate::candump::Decimals::Six, &mut out);
    }
    String::from_utf8(out).unwrap()
}

#[test]
fn every_form_is_read() {
    let body = "   0.000000 Start of measurement\n   0.001000 1  1A0             Rx   d 3 01 0a FF  Length = 1 BitCount = 2\n\
        \u{20}  0.002000 2  123x            Tx   d 0\n   0.003000 1  7FF             Rx   r 4\n   0.004000 1  ErrorFrame\n\
        \u{20}  0.005000 CANFD   1 Rx        123                                   1 0 9 12 00 01 02 03 04 05 06 07 08 09 0a 0b        0    0     3000        0        0\n\
        \u{20}  0.006000 CANFD   2 Rx        124  Name                             0 0 2  2 aa bb        0    0        0        0\n\
        \u{20}  0.007000 1  Statistic: D 1 R 0\n   0.008 2  124   TxRq   d 1 00\nEnd TriggerBlock\n";
    assert_eq!(
        as_candump(&format!("{HEAD}{body}")),
        "(1700000000.001000) can0 1A0#010AFF\n(1700000000.002000) can1 00000123# T\n(1700000000.003000) can0 7FF#R4\n\
         (1700000000.004000) can0 20000080#0000000000000000\n(1700000000.005000) can0 123##1000102030405060708090A0B\n\
         (1700000000.006000) can1 124#AABB\n"
    );
}

#[test]
fn decimal_numbers_and_relative_stamps_are_read() {
    let text = "base dec timestamps relative\nBegin Triggerblock Tue Nov 14 10:13:20.500 pm 2023\n0.5 1 291 Rx d 2 16 255\n0.25 1 291x Rx d 1 7\n";
    assert_eq!(
        as_candump(text),
        "(1700000001.000000) can0 123#10FF\n(1700000001.250000) can0 00000123#07\n"
    );
}

#[test]
fn a_bad_line_is_one_clear_sentence() {
    for (line, expected) in [
        ("0.1 1 1A0 Rx d 2 01\n", r#"a data byte, found """#),
        ("0.1 1 1A0 Rx d 2 01 1FF\n", r#"a data byte, found "1FF""#),
        ("0.1 1 XY Rx d 0\n", r#"an identifier, found "XY""#),
        ("0.1 0 1A0 Rx d 0\n", "a channel, found 0, where they count from 1"),
        (
            "0.1 1 FFF Rx d 0\n",
            "a frame that can be, found identifier 0xfff is above 0x7ff",
        ),
        (
            "9999999999999999.0 1 1A0 Rx d 0\n",
            r#"a stamp in seconds, found "9999999999999999.0""#,
        ),
        (
            " 0.1 1 1A0 Rx d 1 01",
            "a line end, found the end of the file; the last frame may be cut and is not used",
        ),
        (
            "0.1 1 1A0 Rx d 1 01",
            "a line end, found the end of the file; the last frame may be cut and is not used",
        ),
        (
            "date yesterday\n",
            r#"a date, as "Tue Nov 14 10:13:20.000 pm 2023", found "yesterday""#,
        ),
    ] {
        let items = read(&format!("{HEAD}{line}"));
        let text = items.last().unwrap().as_ref().unwrap_err().to_string();
        assert_eq!(text, format!("a.asc:4: expected {expected}"), "{line}");
    }
}
