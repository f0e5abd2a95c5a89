use super::*;
use crate::any_frame::any_frame;
use hmd_core::frame::FrameFlags;
use proptest::prelude::*;
use std::io;

fn read(log: &[u8]) -> Vec<Result<RawFrame, BadLine>> {
    CandumpReader::new(log, "a.log", BusNames::new()).collect()
}

fn frame(line: &str) -> RawFrame {
    parse(line.as_bytes(), &mut BusNames::new()).unwrap()
}

fn fault(line: &str) -> String {
    let mut names = BusNames::new();
    let fault = parse(line.as_bytes(), &mut names).unwrap_err();
    assert!(names.is_empty(), "a bad line leaves no interface");
    fault.to_string()
}

#[test]
fn every_form_is_read() {
    let classic = frame("(1436509052.249713) vcan0 123#DEADBEEF");
    assert_eq!(classic.stamp_ns, 1_436_509_052_249_713_000);
    assert_eq!(
        (classic.id(), classic.data(), classic.flags()),
        (0x123, &[0xDE, 0xAD, 0xBE, 0xEF][..], FrameFlags::NONE)
    );
    assert_eq!(
        frame("(1436509052.249713000)   vcan0\t123#de.ad.be.ef R").data(),
        classic.data()
    );
    assert_eq!(frame("(1.000000001) c 123#").stamp_ns, 1_000_000_001);

    let fd = frame("(1.000000) c 12345678##3AABB");
    let bits = FrameFlags::BIT_RATE_SWITCH.union(FrameFlags::ERROR_STATE);
    assert_eq!((fd.id(), fd.data()), (0x1234_5678, &[0xAA, 0xBB][..]));
    assert_eq!(fd.flags(), FrameFlags::FD.union(FrameFlags::EXTENDED).union(bits));
    assert_eq!(frame("(1.000000) c 123##5AA"), frame("(1.000000) c 123##1AA"));
    assert!(frame("(1.000000) c 123##0").data().is_empty());

    let remote = frame("(1.000000) c 123#R8");
    assert!(remote.is_remote() && remote.announced_len() == 8 && remote.data().is_empty());
    assert_eq!(frame("(1.000000) c 123#R").announced_len(), 0);

    let error = frame("(1.000000) c 20000080#0011223344556677");
    assert!(error.is_error() && !error.is_extended() && error.id() == 0x80);
    assert!(frame("(1.000000) c 123# T").flags().contains(FrameFlags::SENT));
    assert_eq!(frame("(1.000000) c 123#0011223344556677_C").data().len(), 8);
}

#[test]
fn a_bad_line_is_one_clear_sentence() {
    let cases = [
        (
            "1.0 c 123#",
            r#"expected a stamp "(seconds.fraction)" with 6 or 9 decimals, found "1.0""#,
        ),
        (
            "(1.00000) c 123#",
            r#"expected a stamp "(seconds.fraction)" with 6 or 9 decimals, found "(1.00000)""#,
        ),
        (
            "(1.000000) c",
            r#"expected an identifier of 3 or 8 hexadecimal digits before "\#", found """#,
        ),
        (
            "(1.000000) c 1234#",
            r#"expected an identifier of 3 or 8 hexadecimal digits before "\#", found "1234""#,
        ),
        (
            "(1.000000) c 800#",
            r#"expected an identifier of 3 or 8 hexadecimal digits before "\#", found "800""#,
        ),
        (
            "(1.000000) c E0000080#",
            r#"expected an identifier of 3 or 8 hexadecimal digits before "\#", found "E0000080""#,
        ),
        (
            "(1.000000) c 123#1",
            r#"expected data bytes as pairs of hexadecimal digits, found "1""#,
        ),
        (
            "(1.000000) c 123#1g",
            r#"expected data bytes as pairs of hexadecimal digits, found "1g""#,
        ),
        (
            "(1.000000) c 123#00.",
            r#"expected data bytes as pairs of hexadecimal digits, found "00.""#,
        ),
        (
            "(1.000000) c 123##8",
            r#"expected one digit of FD flags, 0 to 7, after "\#\#", found "8""#,
        ),
        (
            "(1.000000) c 123##",
            r#"expected one digit of FD flags, 0 to 7, after "\#\#", found """#,
        ),
        (
            "(1.000000) c 123#R9",
            r#"expected a length of 0 to 8 after "\#R", found "9""#,
        ),
        (
            "(1.000000) c 123# X",
            r#"expected "R", "T" or the end of the line, found "X""#,
        ),
        (
            "(1.000000) c 123# R R",
            r#"expected "R", "T" or the end of the line, found "R""#,
        ),
        ("(1.000000) 123#00", r#"expected an interface name, found "123\#00""#),
    ];
    for (line, expected) in cases {
        assert_eq!(fault(line), expected.replace("\\#", "#"), "{line}");
    }
    assert!(fault("(1.000000) c 123#001122334455667788").ends_with("a classic CAN frame cannot carry 9 data bytes"));
    assert!(fault("(1.000000) c 123##0001122334455667788").ends_with("a CAN FD frame cannot carry 9 data bytes"));
    assert!(fault("(1.000000) c 20000080#R8").contains("exclude each other"));
    assert!(fault("(1.000000) c 20000080##1").contains("exclude each other"));
    assert!(fault("(99999999999.000000) c 123#").contains("stamp"));
}

#[test]
fn the_reader_goes_on_after_bad_lines() {
    let mut log = b"(1.000000) vcan0 123#00\r\n\n  \n(1.0000\xFF) vcan0 1#\n(0.500000) vc\xE4n 123#\n".to_vec();
    log.extend(std::iter::repeat_n(b'x', 100_000));
    log.extend(b"\n(0.000001) vcan1 123#01\n(2.000000) vcan0 123#02");
    let items = read(&log);
    let text: Vec<String> = items
        .iter()
        .map(|item| {
            item.as_ref()
                .map_or_else(ToString::to_string, |f| f.stamp_ns.to_string())
        })
        .collect();
    assert_eq!(text[0], "1000000000");
    assert!(
        text[1].starts_with("a.log:4: expected a stamp") && text[1].ends_with(r#"found "(1.0000\xff)""#),
        "{}",
        text[1]
    );
    assert!(
        text[2].starts_with("a.log:5: expected an interface, found \"vc\\xe4n\""),
        "{}",
        text[2]
    );
    assert_eq!(text[3], "a.log:6: expected at most 400 bytes in a line, found 100000");
    assert_eq!(text[4], "1000");
    assert!(text[5].starts_with("a.log:8: expected a line end"), "{}", text[5]);
    assert_eq!(items.len(), 6);
}

#[test]
fn a_cut_last_line_is_never_another_frame() {
    let log = b"(1.000000) vcan0 123#0011223344556677\n(2.000000) vcan0 124#8899AABBCCDDEEFF\n";
    let whole = read(log);
    for end in 0..log.len() {
        for (item, expected) in read(&log[..end]).iter().zip(&whole) {
            assert!(item.is_err() || item == expected, "cut at {end}: {item:?}");
        }
    }
    assert_eq!(
        read(&log[..log.len() - 1]),
        whole,
        "a whole frame without a line end is used"
    );
}

#[test]
fn an_interface_table_that_is_full_is_a_bad_line() {
    let log: String = (0..70).map(|bus| format!("(1.000000) can{bus} 123#\n")).collect();
    let items = read(log.as_bytes());
    assert_eq!(items.iter().filter(|item| item.is_ok()).count(), BusNames::CAPACITY);
    assert_eq!(items.len(), 70);
}

#[test]
fn a_line_is_written_as_candump_writes_it() {
    let lines = [
        "(1436509052.249713) vcan0 123#DEADBEEF\n",
        "(0000000001.000000) vcan0 12345678##3AABB\n",
        "(1436509052.249713) vcan0 123#R8 T\n",
        "(1436509052.249713) vcan0 123#R\n",
        "(1436509052.249713) vcan0 20000080#0000000000000000\n",
    ];
    for line in lines {
        let mut out = Vec::new();
        emit(&frame(line), "vcan0", Decimals::Six, &mut out);
        assert_eq!(String::from_utf8(out).unwrap(), line);
    }
}

proptest! {
    #[test]
    fn parse_inverts_emit(frame in any_frame(), ns in 0..1000u64) {
        let mut names = BusNames::new();
        let mut line = Vec::new();
        emit(&frame, "vcan0", Decimals::Six, &mut line);
        prop_assert_eq!(parse(&line, &mut names), Ok(frame));
        let mut frame = frame;
        frame.stamp_ns = frame.stamp_ns.saturating_add(ns);
        line.clear();
        emit(&frame, "vcan0", Decimals::Nine, &mut line);
        prop_assert!(line.len() <= MAX_LINE);
        prop_assert_eq!(parse(&line, &mut names), Ok(frame));
    }

    #[test]
    fn any_bytes_are_refused_or_read(log in prop::collection::vec(any::<u8>(), 0..2000)) {
        read(&log);
    }

    #[test]
    fn frames_do_not_depend_on_the_blocks_of_the_input(frames in prop::collection::vec(any_frame(), 1..20), block in 1..300usize) {
        let mut log = Vec::new();
        for frame in &frames {
            emit(frame, "vcan0", Decimals::Six, &mut log);
        }
        let blocks = io::BufReader::with_capacity(block, log.as_slice());
        let again: Result<Vec<_>, _> = CandumpReader::new(blocks, "a.log", BusNames::new()).collect();
        prop_assert_eq!(again, Ok(frames));
    }
}
