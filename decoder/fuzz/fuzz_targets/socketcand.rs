//! libFuzzer's entry to `harness::socketcand`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::socketcand(data));
