//! libFuzzer's entry to `harness::mdf4`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::mdf4(data));
