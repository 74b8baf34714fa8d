//! Origin of each table: where its facts are from, in which version, under which licence.

use super::table::{FILES, TableFile};

/// Origin of a part of a table file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TableSource {
    /// File below `decoder/standards/`.
    pub file: &'static str,
    /// Address of the project, or title of the standard.
    pub source: &'static str,
    /// Version of the source.
    pub version: &'static str,
    /// Licence of the source.
    pub licence: &'static str,
}

/// Origins of all tables, in the order of the files.
pub fn table_sources() -> Vec<TableSource> {
    FILES.iter().flat_map(sources_of).collect()
}

/// Origins that the head of a file names; each starts with a `#source` line.
fn sources_of(file: &TableFile) -> Vec<TableSource> {
    let mut found: Vec<TableSource> = Vec::new();
    for line in file.text.lines().take_while(|line| line.starts_with('#')) {
        let Some((key, text)) = line.split_once('\t') else { continue };
        match (key, found.last_mut()) {
            ("#source", _) => {
                found.push(TableSource { file: file.name, source: text, version: "", licence: "" });
            }
            ("#version", Some(last)) => last.version = text,
            ("#licence", Some(last)) => last.licence = text,
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_names_its_source_version_and_licence() {
        for file in &FILES {
            let sources = sources_of(file);
            assert!(!sources.is_empty(), "{}: no source", file.name);
            for source in sources {
                let parts = [source.source, source.version, source.licence];
                assert!(parts.iter().all(|part| !part.trim().is_empty()), "{}: {source:?}", file.name);
            }
        }
        // A folder with another table would escape the check above.
        assert_eq!(
            FILES.each_ref().map(|file| file.name),
            ["j1939.tsv", "nmea2000.tsv", "rv-c.tsv", "names.tsv"]
        );
    }

    #[test]
    fn the_notice_names_every_source() {
        let notice = include_str!("../../standards/NOTICE");
        for source in table_sources() {
            assert!(notice.contains(source.file), "{} is missing in NOTICE", source.file);
            assert!(notice.contains(source.source), "{} is missing in NOTICE", source.source);
            assert!(notice.contains(source.version), "{} is missing in NOTICE", source.version);
        }
    }
}
