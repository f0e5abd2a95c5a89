//! The program `hmd` as a whole: its verbs, the daemon on all its sources and in real time, and what its requirements name.

mod check_config;
mod cli_live;
mod damaged_log;
mod drives;
mod export;
mod folder;
mod foreign_log;
mod inputs;
mod learning;
mod lines;
mod live;
mod measured_log;
mod outputs;
mod printed;
mod refusals;
mod report;
mod safety;
mod serial;
mod serial_rig;
mod service;
mod settings;
mod simulate;
mod terminal_rig;
mod top;
mod unit_commissioning;
mod wrong_map;
