//! Entry point of libFuzzer for the reader of the format that `COBSCOPE_FORMAT` names.
#![no_main]

use std::sync::LazyLock;

static FORMAT: LazyLock<String> =
    LazyLock::new(|| std::env::var("COBSCOPE_FORMAT").expect("COBSCOPE_FORMAT names a format"));

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cobscope_fuzz::harness::reader::holds_its_contract(&FORMAT, data);
});
