//! Fuzz targets of the decoder. Their checks are in [`harness`], which the tests of the workspace also
//! replay.

pub mod harness;
