//! libFuzzer's entry to `harness::isotp`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::isotp(data));
