//! Several drives on one bus.

use std::sync::Arc;

use hmd_core::config::Config;
use hmd_core::demux::Demux;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};

#[test]
fn what_a_drive_lacks_is_told_with_frames_that_nobody_reads_and_none_of_another_drive() {
    let drive = |node: u8, keys: &str| {
        format!(
            "[[actuator]]\nid = {node}\nname = \"joint{node}\"\nbus = \"can0\"\n[actuator.drive]\npreset = \"odrive\"\n{keys}\n"
        )
    };
    let (lacking, whole) = (drive(1, "output_encoder = 490"), drive(2, ""));
    for actuators in [[&*lacking, &whole], [&whole, &lacking]] {
        let text = format!("{}[type.bench.sensors]\nsample_rate_hz = 400\n", actuators.concat());
        let config = Config::from_toml_str(&text, "hmd.toml").unwrap();
        let mut demux = Demux::new(Arc::new(config));
        let mut names = BusNames::new();
        names.intern("can0").unwrap();
        // Positions and currents of both, and a frame of the first that is of no use.
        for id in [0x049, 0x054, 0x029, 0x034, 0x024] {
            let frame = RawFrame::new(1_700_000_000_000_000_000, 0, id, FrameFlags::NONE, &[0; 8]).unwrap();
            demux.push(&frame, &names);
        }
        demux.finish();
        let notices: Vec<String> = demux.take_notices().into_iter().map(|notice| notice.message).collect();
        let expected = "joint1: not monitored: expected TxSdo.Value (identifier 025, number 490) in each sample, found none, but \
                        identifiers that are not read: 024";
        assert_eq!(notices, [expected], "{text}");
    }
}
