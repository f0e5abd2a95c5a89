//! Wrong sensors, wires and configured numbers: what tells them from worn parts.
//!
//! In: a window and what is known of its actuator. Out: what is suspected ([`Suspicion`]), each a sentence with its numbers, and what
//! the window is where the mistake is taken out ([`Finding`]).
//!
//! | file | evidence |
//! |---|---|
//! | `wiring` | share of the current on the torque axis: order and sign of phases, direction and counts of the resolver, pole pairs |
//! | `currents` | by the equations of `current_equations`: sum of the currents, direct current: offsets, gain of a phase, zero of the resolver, samples of another instant |
//! | `offset_by_torque` | torque balance against that of commissioning: offsets that no sum shows |
//! | `offset_of_sum` | torque balance of the shaft: which phase has the offset of the sum |
//! | `control_law` | current that the drive asks for: gain of all currents, link of a vector drive |
//! | `current_limit` | current that lasts beyond the limit of the drive: gain of all currents |
//! | `torque` | balance of the shaft: sign and gain of the currents, load |
//! | `angles` | output against motor and set point: gear ratio, encoder, unit and delay of the set point |
//! | `setpoint_time` | law of the speed loop: set point before or after its effect |
//! | `gear_ratio` | line between the two angles: gear ratio to parts in a thousand |
//! | `motor_time` | both angles, and currents or torque: a motor angle of another instant |
//! | `other_unit` | reference of the position loop against the set point, torque of the motion against that of the currents: another unit |
//! | `motions_without_window` | motion that begins no window where nothing is commanded: a creep before it |
//! | `unseen_motion` | motion that no window has: unit of the set point, mode |
//! | `moved` | travel and current that are a motion, for both of these |
//! | `readings` | offsets, gains, latency, resolver errors and link voltage of every window, for their drift (`sensor_health`) |
//!
//! After an estimate, a reading may contradict what the motion says without it ([`contradictions`]), or compete with the faults ([`rivals`]).

mod angles;
mod contradictions;
mod control_law;
mod correction;
mod current_equations;
mod current_limit;
mod currents;
mod findings;
mod flank;
mod gear_ratio;
mod least_squares;
mod motions_without_window;
mod motor_time;
mod moved;
mod offset_by_torque;
mod offset_of_sum;
mod other_unit;
mod readings;
pub mod rivals;
mod setpoint_time;
mod signals;
mod suspect;
mod torque;
mod unseen_motion;
mod wiring;

pub use contradictions::{Contradiction, contradictions};
pub use correction::Correction;
pub(crate) use currents::OFFSET_SHARE;
pub use findings::{Finding, current_unit, examine};
pub use motions_without_window::MotionsWithoutWindow;
pub use offset_by_torque::offset_by_torque;
pub use readings::{Reading, SensorReadings, has_no_sum, sensor_readings};
pub use setpoint_time::setpoint_time;
pub use suspect::{Suspect, Suspicion};
pub use unseen_motion::UnseenMotion;
