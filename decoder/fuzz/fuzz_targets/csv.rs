//! libFuzzer's entry to `harness::csv`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::csv(data));
