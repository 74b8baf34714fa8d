//! libFuzzer's entry to `harness::trc`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::trc(data));
