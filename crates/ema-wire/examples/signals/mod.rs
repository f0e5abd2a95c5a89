//! A decoded frame as signals of the DBC file, by name and physical value. Shared by `examples/decode_candump.rs` and
//! `tests/all/dictionary.rs`.

use ema_wire::{FdSlot, Frame, quantity};

/// Name and value of every signal in use; `None` is "not measured".
pub(crate) fn signals(frame: &Frame) -> Vec<(String, Option<f64>)> {
    let mut out = Vec::new();
    let mut put = |name: String, value: f64| out.push((name, Some(value)));
    match frame {
        Frame::Currents(currents) => {
            put("i_a".into(), quantity::current_a(currents.i_a_ma));
            put("i_b".into(), quantity::current_a(currents.i_b_ma));
            put("i_c".into(), quantity::current_a(currents.i_c_ma));
            put("seq".into(), currents.seq.into());
        }
        Frame::Position(position) => {
            put("motor_counts".into(), position.motor_counts.into());
            put("output_counts".into(), position.output_counts.into());
            put("seq8".into(), position.seq8.into());
        }
        Frame::Command(command) => {
            put("setpoint".into(), command.setpoint.into());
            put("mode".into(), f64::from(command.mode as u8));
            put("time_us".into(), command.time_us.into());
            put("seq8".into(), command.seq8.into());
        }
        Frame::Status(status) => {
            put("dc_link".into(), quantity::dc_link_v(status.dc_link_dv));
            put(
                "winding_temp".into(),
                quantity::winding_temp_deg_c(status.winding_temp_dc),
            );
            put("fault_flags".into(), status.fault_flags.into());
            put("seq8".into(), status.seq8.into());
            out.push((
                "load_torque".into(),
                status.load_torque_dnm.map(quantity::load_torque_nm),
            ));
        }
        Frame::SampleFd(samples) => {
            put("seq".into(), samples.seq().into());
            put("count".into(), samples.slots().len() as f64);
            put("layout".into(), ema_wire::SampleFd::LAYOUT.into());
            for (k, slot) in samples.slots().iter().enumerate() {
                for (name, value) in slot_signals(slot) {
                    put(format!("s{k}_{name}"), value);
                }
            }
        }
    }
    out
}

fn slot_signals(slot: &FdSlot) -> [(&'static str, f64); 8] {
    [
        ("i_a", quantity::current_a(slot.i_a_ma)),
        ("i_b", quantity::current_a(slot.i_b_ma)),
        ("i_c", quantity::current_a(slot.i_c_ma)),
        ("motor_counts", slot.motor_counts.into()),
        ("output_counts", slot.output_counts.into()),
        ("mode", f64::from(slot.mode as u8)),
        ("setpoint", slot.setpoint.into()),
        ("time_us", slot.time_us.into()),
    ]
}
