//! [`DriveJoiner`]: frames of a drive -> rows -> samples.
//!
//! Of CiA 402, objects that the master writes are overheard, and hold over those of the file.

use std::sync::Arc;

use ema_wire::ActuatorId;

use super::other_frames::OtherFrames;
use super::rows::Rows;
use super::sdo::SdoListener;
use super::{DriveBus, DriveMisfit, Preset};
use crate::dbc::DecodedUpdate;
use crate::frame::RawFrame;
use crate::log_map::LogMap;

/// Identifier of CANopen's SYNC.
const SYNC: u32 = 0x080;

/// Collects the frames of one drive into samples.
#[derive(Clone, Debug)]
pub struct DriveJoiner {
    actuator: ActuatorId,
    name: Arc<str>,
    bus: DriveBus,
    sdo: Option<SdoListener>,
    /// Whether objects were written that the layout does not know yet.
    is_rewritten: bool,
    rows: Option<Rows>,
    /// What came, until there is a sample.
    others: OtherFrames,
}

impl DriveJoiner {
    /// For one actuator.
    #[must_use]
    pub fn new(actuator: ActuatorId, name: &str, bus: DriveBus) -> Self {
        let settings = bus.settings();
        let sdo = (settings.preset == Preset::Cia402).then(|| SdoListener::new(settings.node));
        let rows = Rows::new(actuator, &bus);
        Self {
            actuator,
            name: name.into(),
            bus,
            sdo,
            is_rewritten: false,
            rows,
            others: OtherFrames::default(),
        }
    }

    /// Name of the actuator.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its preset and node.
    #[must_use]
    pub fn node(&self) -> (Preset, u8) {
        let settings = self.bus.settings();
        (settings.preset, settings.node)
    }

    /// The node that sends this frame, by the preset of this drive.
    #[must_use]
    pub fn node_of(&self, frame: &RawFrame) -> Option<(Preset, u8)> {
        let preset = self.bus.settings().preset;
        preset.node_of(frame).map(|node| (preset, node))
    }

    /// Its quantities, as the columns of a log.
    ///
    /// # Errors
    /// What a drive of CiA 402 lacks so far.
    pub fn map(&self) -> Result<&Arc<LogMap>, &DriveMisfit> {
        self.bus.map()
    }

    /// Why no sample ever came, where frames did: what is expected, and what was found.
    #[must_use]
    pub fn lacking(&self) -> Option<(String, String)> {
        let rows = match (&self.rows, self.map()) {
            (Some(rows), _) => rows,
            (None, Err(misfit)) => return Some((misfit.to_string(), "none".to_owned())),
            (None, Ok(_)) => return None,
        };
        if rows.was_whole || !rows.was_addressed {
            return None;
        }
        let layout = self.bus.layout();
        let missing = (0..layout.columns.len()).filter(|n| rows.awaited & !rows.heard & 1 << n != 0);
        let missing: Vec<String> = missing.map(|n| layout.shown(n)).collect();
        Some(if missing.is_empty() {
            let ms = rows.span_ns as f64 / 1e6;
            let expected = format!("the parts of a sample within {ms} ms, half a period of sample_rate_hz");
            (expected, "none".to_owned())
        } else {
            (format!("{} in each sample", missing.join(", ")), self.others.found())
        })
    }

    /// The frames that come are of another recording: no command and no condition holds, and nothing was heard. What its master wrote does.
    pub fn begin_recording(&mut self) {
        self.rows = Rows::new(self.actuator, &self.bus);
        self.others = OtherFrames::default();
    }

    /// Takes a frame that is for all drives of a bus, a SYNC; whether it is one.
    pub fn push_broadcast(&mut self, frame: &RawFrame) -> bool {
        let is_sync = self.sdo.is_some() && frame.id() == SYNC && !frame.is_extended() && !frame.is_remote();
        if let (true, Some(rows)) = (is_sync, self.rows.as_mut()) {
            rows.synchronise();
        }
        is_sync
    }

    /// Takes a frame of one drive: `None` if it is not this one's or not used, `Some(None)` if it cannot be decoded.
    pub fn push(&mut self, frame: &RawFrame) -> Option<Option<DecodedUpdate>> {
        if frame.is_remote() {
            return None;
        }
        if let Some(sdo) = self.sdo.as_mut() {
            if sdo.is_sdo(frame) {
                if let Some((index, sub, value)) = sdo.push(frame) {
                    self.is_rewritten |= self.bus.dictionary.write(index, sub, value);
                }
                return Some(Some(DecodedUpdate::default()));
            }
            if self.is_rewritten {
                self.is_rewritten = false;
                let before = (self.bus.layout().clone(), self.bus.map().ok().cloned());
                self.bus.lay_out();
                // A write may change nothing that is read: the row and its numbers then go on.
                if before != (self.bus.layout().clone(), self.bus.map().ok().cloned()) {
                    self.rows = Rows::new(self.actuator, &self.bus);
                }
            }
        }
        let (rows, layout) = (self.rows.as_mut()?, self.bus.layout());
        let mut states = 0;
        for message in &layout.messages {
            if message.is(frame) {
                if !rows.was_whole {
                    self.others.hear(layout, frame);
                }
                return Some(rows.take(layout, message, states, frame));
            }
            states += message.states();
        }
        None
    }

    /// Notes a frame that nobody on the bus reads, until there is a sample.
    pub fn hear_other(&mut self, frame: &RawFrame) {
        let is_waiting = self.rows.as_ref().is_some_and(|rows| !rows.was_whole);
        if is_waiting && !frame.is_remote() {
            self.others.hear(self.bus.layout(), frame);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive_bus::{DriveSettings, ObjectDictionary};
    use crate::frame::FrameFlags;
    use ema_models::ActuatorParams;
    use proptest::prelude::*;

    fn joiner(preset: Preset) -> DriveJoiner {
        joiner_written(preset, &[])
    }

    /// The same behind a master that wrote these objects.
    fn joiner_written(preset: Preset, written: &[(u16, u8, u64)]) -> DriveJoiner {
        let settings = DriveSettings {
            motor_units_per_rev: Some(65_536.0),
            output_encoder: Some(1),
            output_units_per_rev: Some(20_000.0),
            rated_current_a: Some(5.0),
            ..DriveSettings::new(preset, 1)
        };
        let dictionary = ObjectDictionary::parse(include_bytes!("../../../../fixtures/drives/drive.dcf"), 1);
        let mut dictionary = dictionary.expect("a fixture");
        for &(index, sub, value) in written {
            dictionary.write(index, sub, value);
        }
        let params = ActuatorParams::bench();
        let bus = DriveBus::new(settings, &params, dictionary).expect("a drive");
        DriveJoiner::new(ActuatorId::new(0).expect("a number"), "joint", bus)
    }

    /// Takes a frame so many µs after the start; its sample.
    fn hear(joiner: &mut DriveJoiner, id: u32, data: &[u8], stamp_us: u64) -> Option<ema_wire::Sample> {
        let stamp_ns = 1_700_000_000_000_000_000 + 1000 * stamp_us;
        let flags = FrameFlags::NONE.with(FrameFlags::EXTENDED, joiner.node().0 == Preset::Vesc);
        let frame = RawFrame::new(stamp_ns, 0, id, flags, data).expect("a frame");
        if joiner.push_broadcast(&frame) {
            return None;
        }
        let update = joiner.push(&frame).flatten()?;
        update.sample.map(|(sample, _)| sample)
    }

    proptest! {
        /// Whatever a bus sends: no panic, and no more samples than frames.
        #[test]
        fn any_frame_is_read_or_refused(
            frames in prop::collection::vec((any::<u8>(), any::<u64>(), prop::collection::vec(any::<u8>(), 0..=8)), 1..200),
            preset in prop::sample::select(Preset::NAMES.map(|(_, preset)| preset).to_vec()),
        ) {
            const IDS: [u32; 22] = [
                0x080, 0x181, 0x281, 0x381, 0x481, 0x201, 0x581, 0x601, 0x021, 0x029, 0x034, 0x025, 0x02c, 0x037, 0x100, 0x001,
                0x000, 0x101, 0x901, 0x1001, 0x1b01, 0x301,
            ];
            let mut joiner = joiner(preset);
            for (id, stamp_ns, data) in frames {
                let id = IDS[usize::from(id) % IDS.len()];
                let flags = FrameFlags::NONE.with(FrameFlags::EXTENDED, preset == Preset::Vesc || id > 0x7ff);
                let frame = RawFrame::new(stamp_ns % (1 << 62), 0, id, flags, &data).expect("a frame");
                joiner.push_broadcast(&frame);
                joiner.push(&frame);
            }
        }
    }

    #[test]
    fn a_write_that_changes_nothing_that_is_read_leaves_the_row() {
        let mut joiner = joiner(Preset::Cia402);
        let mut hear = |id: u32, data: &[u8], stamp_us: u64| {
            let stamp_ns = 1_700_000_000_000_000_000 + 1000 * stamp_us;
            let frame = RawFrame::new(stamp_ns, 0, id, FrameFlags::NONE, data).expect("a frame");
            joiner.push(&frame).flatten().and_then(|update| update.sample)
        };
        hear(0x281, &[0, 0, 1, 0, 0xe8, 3], 500);
        // The master writes the target position 607A, and the drive confirms.
        hear(0x601, &[0x23, 0x7a, 0x60, 0, 1, 2, 3, 4], 550);
        hear(0x581, &[0x60, 0x7a, 0x60, 0, 0, 0, 0, 0], 560);
        assert!(hear(0x381, &[0, 0, 0, 0], 600).is_some());
    }

    #[test]
    fn a_synchronous_command_holds_from_the_next_sync_on() {
        let mut joiner = joiner(Preset::Cia402);
        let mut hear = |id: u32, data: &[u8], stamp_us: u64| {
            let stamp_ns = 1_700_000_000_000_000_000 + 1000 * stamp_us;
            let frame = RawFrame::new(stamp_ns, 0, id, FrameFlags::NONE, data).expect("a frame");
            if joiner.push_broadcast(&frame) {
                return None;
            }
            joiner.push(&frame).flatten().and_then(|update| update.sample)
        };
        let turn = [0x0f, 0, 0, 0, 1, 0];
        let mut samples = Vec::new();
        for (sync_us, row_us) in [(None, 500), (Some(1000), 1500)] {
            match sync_us {
                Some(stamp_us) => hear(0x080, &[], stamp_us),
                None => hear(0x201, &turn, 0),
            };
            hear(0x281, &[0, 0, 1, 0, 0xe8, 3], row_us);
            let (sample, _) = hear(0x381, &[0, 0, 0, 0], row_us + 100).expect("a whole row");
            samples.push(sample);
        }
        let gear_ratio = ActuatorParams::bench().transmission.gear_ratio;
        let expected = ema_wire::quantity::position_setpoint_urad(core::f64::consts::TAU / gear_ratio);
        let commands = samples.iter().map(|sample| (sample.mode, sample.setpoint));
        let modes = [(ema_wire::Mode::Idle, 0), (ema_wire::Mode::Position, expected)];
        assert!(commands.eq(modes), "{samples:?}");
        assert_eq!(samples[1].motor_counts, 65_536);
    }
    #[test]
    fn what_a_drive_sends_with_a_sync_was_sampled_at_that_sync() {
        use ema_wire::Mode;
        // 6062, the demand, behind the statusword and the mode.
        let mut joiner = joiner_written(Preset::Cia402, &[(0x1A00, 0, 3), (0x1A00, 3, 0x6062_0020)]);
        let status = |demand: u8| [0x37, 6, 8, 0, 0, demand, 0];
        let mut samples = Vec::new();
        for (n, demand) in [(0, 1), (1, 2)] {
            let at_us = 2500 * n;
            hear(&mut joiner, 0x080, &[], at_us);
            hear(&mut joiner, 0x181, &status(demand), at_us + 100);
            hear(&mut joiner, 0x281, &[0, 0, 1, 0, 0xe8, 3], at_us + 200);
            samples.extend(hear(&mut joiner, 0x381, &[0, 0, 0, 0], at_us + 300));
        }
        let turn = core::f64::consts::TAU / ActuatorParams::bench().transmission.gear_ratio;
        let demands =
            [1.0, 2.0].map(|turns| (Mode::Position, ema_wire::quantity::position_setpoint_urad(turns * turn)));
        let found = samples.iter().map(|sample| (sample.mode, sample.setpoint));
        assert!(found.eq(demands), "{samples:?}");
    }

    #[test]
    fn a_frame_with_a_part_that_is_there_already_adds_its_other_parts() {
        // 60E4 and 6064 in the third TPDO, 6064 in the second too.
        let mut joiner = joiner_written(Preset::Cia402, &[(0x1A02, 0, 2), (0x1A02, 2, 0x6064_0020)]);
        for n in 0..3 {
            let at_us = 2500 * n;
            assert_eq!(hear(&mut joiner, 0x281, &[0, 0, 1, 0, 0xe8, 3], at_us), None);
            let sample = hear(&mut joiner, 0x381, &[7, 0, 0, 0, 0, 0, 1, 0], at_us + 100);
            assert_eq!(sample.map(|sample| sample.output_counts), Some(7), "{n}");
        }
    }

    #[test]
    fn a_multiplex_pdo_is_passed_over() {
        for count in [0xFE, 0xFF] {
            let mut joiner = joiner_written(Preset::Cia402, &[(0x1A03, 0, count)]);
            hear(&mut joiner, 0x281, &[0, 0, 1, 0, 0xe8, 3], 0);
            assert!(hear(&mut joiner, 0x381, &[0, 0, 0, 0], 100).is_some(), "{count}");
        }
    }

    #[test]
    fn a_command_of_something_else_ends_the_set_point() {
        use ema_wire::Mode;
        let quarter = 0.25_f32.to_le_bytes();
        let position = [quarter, [0; 4]].concat();
        let no_stiffness: &[u8] = &[0x80, 0, 0x7f, 0xf0, 0, 0, 8, 0xff];
        let stiff: &[u8] = &[0x80, 0, 0x7f, 0xf0, 0x10, 0, 8, 0];
        // Frames of a sample, the command of a set point, one of something else.
        for (preset, row, set_point, other, mode) in [
            (
                Preset::Odrive,
                vec![
                    (0x025, vec![0, 1, 0, 0, 0, 0, 0, 0]),
                    (0x029, vec![0; 8]),
                    (0x034, vec![0; 8]),
                ],
                (0x02C, position.as_slice()),
                (0x02E, &quarter[..]),
                Mode::Position,
            ),
            (
                Preset::Vesc,
                vec![(0x901, vec![0; 8]), (0x1001, vec![0; 8])],
                (0x301, &[0, 0, 1, 0][..]),
                (0x101, &[0, 0, 1, 0][..]),
                Mode::Speed,
            ),
            (
                Preset::Damiao,
                vec![(0x000, vec![0x11, 0, 0, 0, 0, 0, 20, 20])],
                (0x001, stiff),
                (0x001, no_stiffness),
                Mode::Position,
            ),
        ] {
            let mut joiner = joiner_written(preset, &[]);
            let mut modes = Vec::new();
            for (n, (id, data)) in [set_point, other, set_point].into_iter().enumerate() {
                let at_us = 2500 * n as u64;
                hear(&mut joiner, id, data, at_us);
                let row = row.iter().map(|(id, data)| hear(&mut joiner, *id, data, at_us + 100));
                modes.extend(row.flatten().map(|sample| sample.mode));
            }
            assert_eq!(modes, [mode, Mode::Idle, mode], "{preset:?}");
        }
    }

    #[test]
    fn nothing_of_a_recording_holds_in_the_next() {
        let mut joiner = joiner(Preset::Cia402);
        let turn = [0x0f, 0, 0, 0, 1, 0];
        let mut modes = Vec::new();
        for recording in 0..2 {
            let at_us = 1_000_000 * recording;
            if recording == 0 {
                hear(&mut joiner, 0x201, &turn, at_us);
                hear(&mut joiner, 0x080, &[], at_us + 10);
            }
            // The DC link, then a sample.
            let link = 48_000_u32.to_le_bytes();
            hear(&mut joiner, 0x481, &link, at_us + 20);
            hear(&mut joiner, 0x281, &[0, 0, 1, 0, 0xe8, 3], at_us + 100);
            let stamp_ns = 1_700_000_000_000_000_000 + 1000 * (at_us + 200);
            let frame = RawFrame::new(stamp_ns, 0, 0x381, FrameFlags::NONE, &[0; 4]).expect("a frame");
            let update = joiner.push(&frame).flatten().expect("a sample");
            assert_eq!(update.conditions.and_then(|of| of.dc_link_v), Some(48.0), "{recording}");
            modes.extend(update.sample.map(|(sample, _)| sample.mode));
            joiner.begin_recording();
        }
        assert_eq!(modes, [ema_wire::Mode::Position, ema_wire::Mode::Idle]);
    }
}
