//! Limits for rates that are still above those of the guide: `ceilings.toml`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use crate::support::workspace;

/// Rates by scope (`comments of decoder`, `README.md`) and expression. Only those above the limit are listed.
#[derive(Default)]
pub struct Ceilings(BTreeMap<String, BTreeMap<String, f64>>);

fn path() -> PathBuf {
    workspace().join("tests/decoder/language/ceilings.toml")
}

impl Ceilings {
    /// Reads the file; without it, the limits of the guide apply.
    pub fn read() -> Self {
        let text = fs::read_to_string(path()).unwrap_or_default();
        Self(toml::from_str(&text).unwrap())
    }

    pub fn get(&self, scope: &str, expression: &str) -> Option<f64> {
        self.0.get(scope)?.get(expression).copied()
    }

    pub fn set(&mut self, scope: &str, expression: &str, rate: f64) {
        self.0.entry(scope.to_owned()).or_default().insert(expression.to_owned(), rate);
    }

    /// Writes the file, or removes it if no rate is above its limit.
    pub fn write(&self) {
        if self.0.is_empty() {
            let _ = fs::remove_file(path());
            return;
        }
        let mut text = "# Rates above the limits of budget.toml. `COBSCOPE_BLESS=1` lowers them and never raises them.\n".to_owned();
        for (scope, rates) in &self.0 {
            writeln!(text, "\n[{scope:?}]").unwrap();
            for (expression, rate) in rates {
                writeln!(text, "{expression:?} = {rate:.2}").unwrap();
            }
        }
        fs::write(path(), text).unwrap();
    }
}
