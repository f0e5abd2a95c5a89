//! Bounds of what the reader of an MCAP file accepts and holds.

/// Longest record and longest decompressed chunk that is read, bytes.
pub(super) const RECORD_BYTES_MAX: usize = 64 << 20;
/// Bytes of expanded chunks that are read for each byte of a file, and twice [`RECORD_BYTES_MAX`] besides. Frames of 64 bytes that never
/// change, at the pace of a clock, come to 1709 in five minutes of ours; a bomb of zstd to 7000 and more.
pub(super) const EXPANSION_MAX: u64 = 2500;
/// Most definitions of schemas and channels in one file, repetitions apart: five channels for each of 1024 actuators, and more.
pub(super) const DEFINITIONS_MAX: usize = 8192;
/// Most bytes of all definitions together, as in the file; a map of many small entries takes some ten times that.
pub(super) const DEFINITION_BYTES_MAX: usize = 4 << 20;
/// Most metadata records that are held, definitions apart; each further one is a loss.
pub(super) const METADATA_MAX: usize = 1024;
/// Most bytes of all metadata records together, as in the file; they take some ten times that in memory.
pub(super) const METADATA_BYTES_MAX: usize = 1 << 20;
