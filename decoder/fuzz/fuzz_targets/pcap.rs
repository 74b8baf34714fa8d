//! libFuzzer's entry to `harness::pcap`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| cobscope_fuzz::harness::pcap(data));
