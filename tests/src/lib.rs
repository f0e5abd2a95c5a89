//! End-to-end stories; see the files beside this package's manifest.
