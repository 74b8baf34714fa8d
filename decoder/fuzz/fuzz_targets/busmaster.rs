//! libFuzzer's entry to `harness::busmaster`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::busmaster(data));
