//! libFuzzer's entry to `harness::lss`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::lss(data));
