//! Any text as a configuration: refused in one line, or accepted with a meaning.
#![no_main]

use hmd_core::config::Config;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match Config::from_toml_str(text, "hmd.toml") {
        Ok(config) => {
            assert_eq!(config.hash().len(), 64);
            assert!(config.describe().ends_with('\n'));
        }
        Err(error) => {
            let said = error.to_string();
            assert!(said.starts_with("hmd.toml") && !said.contains('\n'), "{said:?}");
        }
    }
});
