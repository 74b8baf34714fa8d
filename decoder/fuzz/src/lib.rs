//! Fuzz targets of the decoder. What they check is in [`harness`], which the tests of the workspace
//! replay as well.

pub mod harness;
