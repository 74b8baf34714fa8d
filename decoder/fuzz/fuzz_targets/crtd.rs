//! libFuzzer's entry to `harness::crtd`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::crtd(data));
