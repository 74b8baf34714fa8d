//! Accepted abort codes per situation, from `abort_codes.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

/// Kind of request that a server must refuse.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Situation {
    /// Identifier.
    pub(super) id: String,
    /// Description of the request.
    pub(super) text: String,
    /// Abort codes that are a correct response.
    pub(super) accepted: Vec<u32>,
    /// Cases of the conformance test with this situation.
    pub(super) ctt: Vec<String>,
    /// Source of the list of codes.
    #[expect(dead_code, reason = "for the reader of the table")]
    class: String,
    #[expect(dead_code, reason = "for the reader of the table")]
    origin: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AbortCodesFile {
    situation: Vec<Situation>,
}

/// Looks up a situation by its identifier.
pub(super) fn situation(id: &str) -> Option<&'static Situation> {
    static TABLE: OnceLock<Vec<Situation>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let file: Result<AbortCodesFile, _> = toml::from_str(include_str!("abort_codes.toml"));
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
