//! From frames to samples and sensor states, all in memory; and the pages that the code writes.

mod dbc;
mod fallen_damage;
mod layouts;
mod learnt_part;
mod pages;
mod replaced_unit;
mod samples;
mod sensor_health;
