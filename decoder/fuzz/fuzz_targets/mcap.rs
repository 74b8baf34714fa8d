//! libFuzzer's entry to `harness::mcap`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::mcap(data));
