//! Entry point of libFuzzer for `harness::j1939`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::j1939(data));
