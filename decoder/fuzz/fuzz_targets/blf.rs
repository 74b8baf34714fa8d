//! libFuzzer's entry to `harness::blf`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::blf(data));
