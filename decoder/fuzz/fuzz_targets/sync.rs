//! Entry point of libFuzzer for `harness::sync`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::sync(data));
