//! libFuzzer's entry to `harness::carbus`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::carbus(data));
