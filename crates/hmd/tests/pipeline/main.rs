//! From configuration and frames to samples, windows and forecasts, all in memory; and the pages that the code writes.

mod config;
mod dbc;
mod layouts;
mod pages;
mod rul;
mod samples;
mod sensor_health;
mod window;
mod window_properties;
