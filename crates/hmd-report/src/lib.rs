//! What shows recorded health: a report page, tables for export, and the terminal view of a running daemon.

pub mod export;
pub mod pdf;
pub mod report;
pub mod top;
