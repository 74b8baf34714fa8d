//! Writers for events and findings, one per file format.

mod csv;
mod csv_wide;
mod event_sink;
pub mod exact_json;
pub mod findings;
pub mod jsonl;
mod line_key;
#[cfg(feature = "mcap")]
mod mcap;
mod options;
#[cfg(feature = "parquet")]
mod parquet;
pub mod rows;
pub mod table;
pub mod text;
mod values;

pub use crate::escape::{escape, escape_json};
#[cfg(feature = "parquet")]
pub use parquet::lake;

pub use event_sink::{EventContent, EventFormat, EventSink, Output, OutputFiles, SpoolFile};

pub use options::SinkOptions;

/// All event formats.
pub const EVENT_FORMATS: &[EventFormat] = &[
    text::FORMAT,
    jsonl::FORMAT,
    csv::FORMAT,
    csv_wide::FORMAT,
    #[cfg(feature = "mcap")]
    mcap::FORMAT,
    #[cfg(feature = "parquet")]
    parquet::FORMAT,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::WRITABLE;

    #[test]
    fn names_and_suffixes_are_of_one_format() {
        let of_frames = WRITABLE.iter().map(|format| (format.suffix, ""));
        let mut suffixes: Vec<_> =
            EVENT_FORMATS.iter().map(|format| (format.suffix, format.name)).chain(of_frames).collect();
        suffixes.sort_unstable();
        assert!(suffixes.is_sorted_by(|one, next| one.0 < next.0), "{suffixes:?}");
        let mut names: Vec<_> = EVENT_FORMATS.iter().map(|format| format.name).collect();
        names.sort_unstable();
        assert!(names.is_sorted_by(|one, next| one < next), "{names:?}");
    }
}
