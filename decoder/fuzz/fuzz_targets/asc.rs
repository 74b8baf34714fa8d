//! libFuzzer's entry to `harness::asc`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::asc(data));
