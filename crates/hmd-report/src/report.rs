//! One page about one actuator: recorded files -> one HTML file that needs nothing else. No clock, no network.
//!
//! [`History`] is what the files say of the actuator, [`page`] makes the text, with plots as inline SVG. [`commissioning_page`] shows
//! what was learnt of a unit.

mod commissioning;
mod history;
mod markup;
mod page;
mod plot;
mod sections;

pub use commissioning::commissioning_page;
pub use history::{Files, History, Point, ReportError};
pub use page::page;
