//! libFuzzer's entry to `harness::candump`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::candump(data));
