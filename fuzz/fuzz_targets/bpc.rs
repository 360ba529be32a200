#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| retina_fuzz::bpc(bytes));
