//! Pages about actuators: recorded files -> one HTML file that needs nothing else. No clock, no network.
//!
//! [`History`] is what the files say of an actuator, [`page`] makes the text of one or several, with plots as inline SVG.
//! [`commissioning_page`] shows what was learnt of a unit.

mod axis;
mod clock_doubt;
mod commissioning;
mod doubt;
mod fault_table;
mod files;
mod history;
mod markup;
mod overview;
mod page;
mod plot;
mod quality;
mod recommendation;
mod replacements;
mod rules;
mod sections;
mod sources;
mod summary;
mod units;
mod words;
mod zone;

pub use commissioning::commissioning_page;
pub use files::{Files, RecordedLevels, ReportError};
pub use history::{History, Point};
pub use page::{View, page};
pub use replacements::Maintenance;
pub use zone::Zone;
