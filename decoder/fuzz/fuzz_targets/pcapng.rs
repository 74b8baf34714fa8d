//! libFuzzer's entry to `harness::pcapng`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::pcapng(data));
