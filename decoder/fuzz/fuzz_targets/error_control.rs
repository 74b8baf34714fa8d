//! Entry point of libFuzzer for `harness::error_control`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::error_control(data));
