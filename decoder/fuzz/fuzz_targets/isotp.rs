//! Entry point of libFuzzer for `harness::isotp`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::isotp(data));
