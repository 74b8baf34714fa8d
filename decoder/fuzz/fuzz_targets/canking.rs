//! libFuzzer's entry to `harness::canking`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::canking(data));
