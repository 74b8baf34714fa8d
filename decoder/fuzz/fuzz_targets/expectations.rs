//! Entry point of libFuzzer for `harness::expectations`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::expectations(data));
