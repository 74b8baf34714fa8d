//! Other programs read what is written.
