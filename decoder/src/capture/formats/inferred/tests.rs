//! Lines in various layouts.
