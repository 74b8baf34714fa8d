//! Entry point of libFuzzer for `harness::device_file`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::device_file(data));
