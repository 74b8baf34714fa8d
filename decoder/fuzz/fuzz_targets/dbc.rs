//! Entry point of libFuzzer for `harness::dbc`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::dbc(data));
