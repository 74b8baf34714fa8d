//! libFuzzer's entry to `harness::roadster`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::roadster(data));
