//! Words of which names of signals are made.

use crate::dbc::Role;
use crate::log_map::Quantity;

/// Names that are a quantity, in lower case without signs between their letters.
pub(super) const NAMES: [(Quantity, &[&str]); 15] = [
    (Quantity::Time, &["t", "time", "timestamp", "timestamps", "zeit"]),
    (
        Quantity::Counter,
        &[
            "seq",
            "counter",
            "samplecounter",
            "samplecount",
            "samplenumber",
            "sampleindex",
            "cycle",
            "alive",
        ],
    ),
    (
        Quantity::Of(Role::Time),
        &["clock", "timeus", "devicetime", "deviceclock"],
    ),
    (
        Quantity::Of(Role::CurrentA),
        &[
            "ia",
            "iu",
            "i1",
            "currenta",
            "currentu",
            "iphasea",
            "phaseacurrent",
            "currentphasea",
        ],
    ),
    (
        Quantity::Of(Role::CurrentB),
        &[
            "ib",
            "iv",
            "i2",
            "currentb",
            "currentv",
            "iphaseb",
            "phasebcurrent",
            "currentphaseb",
        ],
    ),
    (
        Quantity::Of(Role::CurrentC),
        &[
            "ic",
            "iw",
            "i3",
            "currentc",
            "currentw",
            "iphasec",
            "phaseccurrent",
            "currentphasec",
        ],
    ),
    (
        Quantity::CurrentD,
        &["id", "idact", "idmeas", "currentd", "idmeasured", "idactual"],
    ),
    (
        Quantity::CurrentQ,
        &["iq", "iqact", "iqmeas", "currentq", "iqmeasured", "iqactual"],
    ),
    (Quantity::MODE, &["mode", "state", "controlmode", "drivestate", "modus"]),
    (
        Quantity::Of(Role::DcLink),
        &[
            "udc",
            "vdc",
            "vbus",
            "ubus",
            "dclink",
            "dclinkvoltage",
            "busvoltage",
            "zwischenkreis",
            "zwischenkreisspannung",
        ],
    ),
    (
        Quantity::Of(Role::WindingTemp),
        &[
            "tw",
            "windingtemp",
            "windingtemperature",
            "motortemp",
            "motortemperature",
            "tempmotor",
        ],
    ),
    (
        Quantity::Of(Role::LoadTorque),
        &["mload", "tload", "load", "loadtorque", "torqueload", "lastmoment"],
    ),
    (
        Quantity::Of(Role::MotorPosition),
        &[
            "thetam",
            "motorangle",
            "motorposition",
            "motorpos",
            "motorcounts",
            "rotorangle",
            "resolver",
        ],
    ),
    (
        Quantity::Of(Role::OutputPosition),
        &[
            "thetao",
            "thetaout",
            "outputangle",
            "outputposition",
            "outputpos",
            "outputcounts",
            "encoder",
        ],
    ),
    (
        Quantity::Of(Role::CommandPosition),
        &[
            "phiset",
            "thetaset",
            "setpoint",
            "positionsetpoint",
            "commandposition",
            "positioncommand",
        ],
    ),
];

/// Parts of the names of what is commanded, and whole words of them.
pub(super) const COMMANDED: [&str; 10] = [
    "set", "cmd", "command", "demand", "target", "ref", "soll", "desired", "request", "goal",
];
pub(super) const COMMANDED_WORDS: [&str; 4] = ["sp", "des", "dmd", "req"];

/// Parts of the names of what is computed of a signal, and whole words of them: such a signal is not the one that its name has too.
pub(super) const DERIVED: [&str; 8] = [
    "error",
    "deviation",
    "residual",
    "offset",
    "reset",
    "fehler",
    "abweichung",
    "differen",
];
pub(super) const DERIVED_WORDS: [&str; 34] = [
    "err",
    "dev",
    "delta",
    "diff",
    "rms",
    "eff",
    "min",
    "max",
    "peak",
    "limit",
    "lim",
    "mean",
    "avg",
    "average",
    "std",
    "var",
    "lag",
    "bias",
    "zero",
    "status",
    "valid",
    "ok",
    "flag",
    "fault",
    "faults",
    "alarm",
    "warning",
    "enable",
    "enabled",
    "quality",
    "crc",
    "tolerance",
    "range",
    "hysteresis",
];

/// Words in the names of signals that are one of several of a quantity, rather the other.
pub(super) const SECOND: [&str; 14] = [
    "est",
    "estimate",
    "estimated",
    "sim",
    "model",
    "predicted",
    "expected",
    "filt",
    "filtered",
    "raw",
    "old",
    "prev",
    "redundant",
    "backup",
];

/// Parts of the names of angles of the motor and of the output, and whole words of them.
pub(super) const MOTOR: [&str; 3] = ["motor", "rotor", "resolver"];
pub(super) const MOTOR_WORDS: [&str; 2] = ["mot", "mtr"];
pub(super) const OUTPUT: [&str; 14] = [
    "output", "shaft", "ausgang", "joint", "surface", "load", "flap", "aileron", "elevator", "rudder", "spoiler",
    "slat", "abtrieb", "klappe",
];
/// The same that may be of either, rather of the output, rather of the motor.
pub(super) const RATHER_OUTPUT: [&str; 3] = ["encoder", "actuator", "servo"];
pub(super) const RATHER_MOTOR: [&str; 1] = ["mech"];

/// Parts of the names of angles, which need no unit to say so.
pub(super) const ANGLE: [&str; 8] = ["angle", "pos", "theta", "phi", "count", "enc", "resolver", "winkel"];

/// Words and ends of names of the electrical angle, which turns once for each pair of poles.
pub(super) const ELECTRICAL_WORDS: [&str; 6] = ["el", "elec", "elect", "electric", "commutation", "flux"];
pub(super) const ELECTRICAL_STARTS: [&str; 2] = ["electrical", "elektr"];
pub(super) const ELECTRICAL_ENDS: [&str; 7] = ["thetael", "thetae", "anglee", "angleel", "elangle", "phiel", "phie"];

/// Parts of the names of temperatures of the winding, and of other parts of a motor.
pub(super) const WINDING: [&str; 6] = ["winding", "wicklung", "wdg", "wndg", "stator", "coil"];
pub(super) const BESIDE_WINDING: [&str; 12] = [
    "housing", "case", "ambient", "bearing", "inverter", "driver", "board", "fet", "gear", "oil", "encoder", "magnet",
];

/// Words in the names of currents that do not say which.
pub(super) const OF_CURRENTS: [&str; 26] = [
    "current",
    "cur",
    "inv",
    "inverter",
    "drive",
    "phase",
    "ph",
    "motor",
    "stator",
    "meas",
    "measured",
    "act",
    "actual",
    "foc",
    "i",
    "fb",
    "fbk",
    "feedback",
    "sens",
    "sensed",
    "value",
    "ist",
    "strom",
    "phasenstrom",
    "motorstrom",
    "phasecurrent",
];

/// The same of currents of which there may be another that is meant.
pub(super) const OF_SECOND_CURRENTS: [&str; 3] = ["filt", "filtered", "raw"];

/// Units that names end with in lower case, too.
pub(super) const UNITS: [&str; 10] = ["mA", "A", "mV", "V", "Nm", "degC", "C", "rad/s", "counts", "Hz"];

/// Words before a name of a signal that say of which of several actuators it is.
pub(super) const SIDES: [&str; 8] = ["l", "r", "left", "right", "lh", "rh", "port", "starboard"];
