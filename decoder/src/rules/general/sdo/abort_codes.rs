//! `abort_codes.toml`: which abort codes answer what.

use std::sync::OnceLock;

use serde::Deserialize;

/// Something a server must refuse.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Situation {
    /// Name.
    pub(super) id: String,
    /// What was asked for.
    pub(super) text: String,
    /// Codes that answer it.
    pub(super) accepted: Vec<u32>,
    /// Cases of the conformance test that bring it.
    pub(super) ctt: Vec<String>,
    /// Who says so.
    #[expect(dead_code, reason = "for the reader of the table")]
    class: String,
    #[expect(dead_code, reason = "for the reader of the table")]
    origin: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    situation: Vec<Situation>,
}

/// A situation by its name.
pub(super) fn situation(id: &str) -> Option<&'static Situation> {
    static TABLE: OnceLock<Vec<Situation>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let file: Result<File, _> = toml::from_str(include_str!("abort_codes.toml"));
        file.map(|file| file.situation).unwrap_or_default()
    });
    table.iter().find(|situation| situation.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_read() {
        let situation = situation("read-only-written").unwrap();
        assert!(situation.accepted.contains(&0x0601_0002) && situation.ctt.contains(&"2.3".to_owned()));
        assert!(super::situation("nothing").is_none());
    }
}
