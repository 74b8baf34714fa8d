//! Entry point of libFuzzer for `harness::error_frame`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::error_frame(data));
