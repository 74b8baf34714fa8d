//! Entry point of libFuzzer for `harness::trouble_codes`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::trouble_codes(data));
