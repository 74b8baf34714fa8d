//! libFuzzer's entry to `harness::microchip`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::microchip(data));
