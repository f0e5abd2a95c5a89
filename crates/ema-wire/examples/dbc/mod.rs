//! The CAN dictionary as a table of signals, and its DBC text. Shared by `examples/make_dbc.rs` and `tests/all/dictionary.rs`.
//!
//! The table is independent of the byte code in `src/can`: the test decodes random frames by both and compares.

use std::fmt::Write as _;

use ema_wire::can::{CLASSIC_LEN, FD_LEN};
use ema_wire::{ActuatorId, Message, SampleFd};

/// One signal: unsigned or two's complement, little-endian, physical = raw / 10^decimals.
pub(crate) struct Signal {
    pub(crate) name: String,
    pub(crate) start_bit: usize,
    pub(crate) bits: u32,
    pub(crate) signed: bool,
    pub(crate) decimals: u32,
    raw_range: Option<(i64, i64)>,
    unit: &'static str,
    comment: &'static str,
    values: &'static [(i64, &'static str)],
}

const MODES: &[(i64, &str)] = &[(0, "idle"), (1, "position"), (2, "speed")];
const NOT_MEASURED: &[(i64, &str)] = &[(-32768, "not_measured")];
const SEQ8: &str = "Low byte of the sample counter; joins the frames of one sample";

/// The signals of one message, by position.
pub(crate) fn signals(message: Message) -> Vec<Signal> {
    let mut builder = Builder::default();
    match message {
        Message::Currents => {
            builder.currents();
            builder.add(
                "seq",
                16,
                "",
                "Sample counter, wraps; all of one sample was latched at t0 + seq/f_s",
            );
        }
        Message::Position => {
            builder.counts();
            builder.add("seq8", 8, "", SEQ8);
        }
        Message::Command => {
            builder.setpoint();
            builder.mode();
            builder.time_us();
            builder.add("seq8", 8, "", SEQ8);
        }
        Message::Status => {
            builder.add("dc_link", 16, "V", "DC link voltage").decimals = 1;
            builder.add("winding_temp", -16, "degC", "Winding temperature").decimals = 1;
            let comment = "Load torque at the output, positive when it opposes positive motion; raw 0x8000 (-3276.8) = not measured";
            let torque = builder.add("load_torque", -16, "Nm", comment);
            torque.decimals = 1;
            torque.values = NOT_MEASURED;
            builder.add(
                "fault_flags",
                8,
                "",
                "Flags of the device, 0 = none; recorded, not interpreted",
            );
            builder.add("seq8", 8, "", "Low byte of the counter of the latest sample");
        }
        Message::SampleFd => {
            builder.add("seq", 16, "", "Counter of the first sample, wraps; slot k has seq + k");
            let count = "Slots in use; the other slots are zero and mean nothing";
            builder.add("count", 8, "", count).raw_range = Some((1, SampleFd::MAX_SAMPLES as i64));
            let layout = i64::from(SampleFd::LAYOUT);
            let comment = "Layout number of this frame; any other number is another layout: do not read on";
            builder.add("layout", 8, "", comment).raw_range = Some((layout, layout));
            for k in 0..SampleFd::MAX_SAMPLES {
                builder.prefix = format!("s{k}_");
                builder.currents();
                builder.counts();
                builder.mode();
                builder.setpoint();
                builder.time_us();
            }
        }
    }
    builder.signals
}

/// The whole DBC file.
pub(crate) fn dbc() -> String {
    render().expect("writing to a String does not fail")
}

fn render() -> Result<String, std::fmt::Error> {
    let mut out = String::from("VERSION \"ema-wire 1\"\n\nNS_ :\n\nBS_:\n\nBU_: HMD");
    for actuator in ActuatorId::all() {
        write!(out, " EMA{}", actuator.index())?;
    }
    out += "\n\nVAL_TABLE_ Mode";
    values(&mut out, MODES)?;
    out += "\n";

    for (actuator, message) in all() {
        let n = actuator.index();
        writeln!(
            out,
            "BO_ {} EMA{n}_{}: {} EMA{n}",
            message.id(actuator),
            message.name(),
            len(message)
        )?;
        for signal in signals(message) {
            let (min, max) = signal.raw_range();
            writeln!(
                out,
                " SG_ {} : {}|{}@1{} ({},0) [{}|{}] \"{}\" HMD",
                signal.name,
                signal.start_bit,
                signal.bits,
                if signal.signed { '-' } else { '+' },
                decimal(1, signal.decimals),
                decimal(min, signal.decimals),
                decimal(max, signal.decimals),
                signal.unit,
            )?;
        }
        out += "\n";
    }

    out += "CM_ \"One sample = Currents, Position, Command with the same counter, in this order, all latched together; \
            or a slot of SampleFd. Actuator n has base 0x100 + 0x10 n.\";\n";
    for (actuator, message) in all() {
        let id = message.id(actuator);
        writeln!(out, "CM_ BO_ {id} \"{}\";", comment(message))?;
        for signal in signals(message) {
            writeln!(out, "CM_ SG_ {id} {} \"{}\";", signal.name, signal.comment)?;
        }
    }

    out += "\nBA_DEF_ \"BusType\" STRING ;\nBA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 65535;\n";
    out += "BA_DEF_ BO_ \"CANFD_BRS\" ENUM \"0\",\"1\";\nBA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\"";
    for reserved in 2..14 {
        write!(out, ",\"reserved{reserved}\"")?;
    }
    out += ",\"StandardCAN_FD\",\"ExtendedCAN_FD\";\n";
    out += "BA_DEF_DEF_ \"BusType\" \"CAN FD\";\nBA_DEF_DEF_ \"GenMsgCycleTime\" 0;\n";
    out += "BA_DEF_DEF_ \"CANFD_BRS\" \"0\";\nBA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\nBA_ \"BusType\" \"CAN FD\";\n";
    for (actuator, message) in all() {
        let id = message.id(actuator);
        match message {
            Message::Status => writeln!(out, "BA_ \"GenMsgCycleTime\" BO_ {id} 100;")?,
            Message::SampleFd => {
                writeln!(out, "BA_ \"CANFD_BRS\" BO_ {id} 1;\nBA_ \"VFrameFormat\" BO_ {id} 14;")?;
            }
            _ => {}
        }
    }
    out += "\n";
    for (actuator, message) in all() {
        for signal in signals(message).iter().filter(|signal| !signal.values.is_empty()) {
            write!(out, "VAL_ {} {}", message.id(actuator), signal.name)?;
            values(&mut out, signal.values)?;
        }
    }
    Ok(out)
}

fn all() -> impl Iterator<Item = (ActuatorId, Message)> {
    ActuatorId::all().flat_map(|actuator| Message::ALL.map(|message| (actuator, message)))
}

fn len(message: Message) -> usize {
    if message == Message::SampleFd {
        FD_LEN
    } else {
        CLASSIC_LEN
    }
}

fn comment(message: Message) -> &'static str {
    match message {
        Message::Currents => "First frame of a sample, at the sampling rate (400 Hz or 2 kHz)",
        Message::Position => "Second frame of a sample, at the sampling rate",
        Message::Command => "Third frame of a sample, at the sampling rate; invalid when mode is above 2",
        Message::Status => "Slow quantities, 10 Hz",
        Message::SampleFd => {
            "CAN FD, 64 bytes: up to three consecutive whole samples instead of nine classic frames. \
             Header seq, count, layout; slot k at byte 4 + 20 k, used when count > k. \
             Invalid when layout is not 1, count is not 1 to 3, or the mode of a used slot is above 2"
        }
    }
}

fn values(out: &mut String, values: &[(i64, &str)]) -> std::fmt::Result {
    for (raw, name) in values {
        write!(out, " {raw} \"{name}\"")?;
    }
    out.write_str(" ;\n")
}

/// `raw / 10^decimals`, exactly, in digits.
fn decimal(raw: i64, decimals: u32) -> String {
    if decimals == 0 {
        return raw.to_string();
    }
    let unit = 10_u64.pow(decimals);
    let (sign, magnitude) = (if raw < 0 { "-" } else { "" }, raw.unsigned_abs());
    format!(
        "{sign}{}.{:0width$}",
        magnitude / unit,
        magnitude % unit,
        width = decimals as usize
    )
}

impl Signal {
    fn raw_range(&self) -> (i64, i64) {
        let half = 1_i64 << (self.bits - 1);
        self.raw_range.unwrap_or(if self.signed {
            (-half, half - 1)
        } else {
            (0, 2 * half - 1)
        })
    }
}

/// Appends signals at consecutive bits.
#[derive(Default)]
struct Builder {
    prefix: String,
    next_bit: usize,
    signals: Vec<Signal>,
}

impl Builder {
    /// Negative `bits`: two's complement.
    fn add(&mut self, name: &str, bits: i32, unit: &'static str, comment: &'static str) -> &mut Signal {
        let (start_bit, signed, bits) = (self.next_bit, bits < 0, bits.unsigned_abs());
        self.next_bit += bits as usize;
        let name = format!("{}{name}", self.prefix);
        self.signals.push(Signal {
            name,
            start_bit,
            bits,
            signed,
            decimals: 0,
            raw_range: None,
            unit,
            comment,
            values: &[],
        });
        self.signals.last_mut().expect("just pushed")
    }

    fn currents(&mut self) {
        self.add("i_a", -16, "A", "Current of phase A, positive into the motor")
            .decimals = 3;
        self.add("i_b", -16, "A", "Current of phase B, positive into the motor")
            .decimals = 3;
        self.add("i_c", -16, "A", "Current of phase C, positive into the motor")
            .decimals = 3;
    }

    fn counts(&mut self) {
        self.add(
            "motor_counts",
            -32,
            "counts",
            "Motor angle, resolver, 65536 counts/rev, multi-turn, wraps",
        );
        self.add(
            "output_counts",
            -24,
            "counts",
            "Output angle, encoder, 20000 counts/rev, multi-turn, wraps",
        );
    }

    fn mode(&mut self) {
        let mode = self.add("mode", 8, "", "What the setpoint means; above 2 the frame is invalid");
        mode.raw_range = Some((0, 2));
        mode.values = MODES;
    }

    fn setpoint(&mut self) {
        let comment =
            "By mode: position 1 urad at the output shaft; speed 1 mrad/s at the motor shaft; idle: no meaning";
        self.add("setpoint", -32, "", comment);
    }

    fn time_us(&mut self) {
        self.add(
            "time_us",
            16,
            "us",
            "Low 16 bits of the device time when the sample was latched; wraps every 65.536 ms",
        );
    }
}
