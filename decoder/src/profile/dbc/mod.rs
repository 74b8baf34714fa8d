//! Message databases supplied by the user: DBC files, and the JSON format of pretty_j1939.
//!
//! A DBC defines the signals of each identifier: bits, scale, unit and names of values. A 29-bit message also
//! defines its parameter group for any priority, source and (PDU1 format, SAE J1939-21 §5.2) destination.
//!
//! A part that cannot be parsed is reported as a [`DbcProblem`] with its position; all other parts are used.
//!
//! ```text
//! bytes ─┬─statement, read─▶ Raw ─messages─┐
//!        └─pretty_j1939────────────────────┴─▶ DatabaseFile ─▶ Database
//! ```

mod database;
mod file;
mod group;
mod limits;
mod messages;
mod pretty_j1939;
mod problem;
mod read;
mod signal;
mod statement;

use crate::profile::device_file::decode_text;
use problem::DbcProblems;

pub use database::Database;
pub use file::{DatabaseFile, DatabaseMessage, SuspectParameter};
pub(crate) use limits::LONGEST_STRING;
pub use limits::{LONGEST_MESSAGE, MOST_MESSAGES, MOST_PROBLEMS, MOST_RANGES, MOST_SIGNALS};
pub use problem::DbcProblem;
pub(crate) use signal::{fraction_digits, shown_digits};

/// Parses a DBC, or the JSON of pretty_j1939, which starts with `{`. The text is UTF-16 with a byte order
/// mark, UTF-8 if valid, otherwise Windows-1252. Time and memory are linear in the length of `bytes`.
///
/// # Errors
/// The file contains no part of a database.
pub fn parse_database(bytes: &[u8]) -> Result<DatabaseFile, DbcProblem> {
    let text = decode_text(bytes);
    if text.trim_start().starts_with('{') {
        return pretty_j1939::parse_json(&text);
    }
    let text = if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n").into() } else { text };
    let mut problems = DbcProblems::problems_in(&text);
    let raw = read::RawDbc::parse_dbc(&text, &mut problems);
    if raw.statements == 0 {
        return Err(DbcProblem::new(
            1,
            1,
            "neither DBC nor JSON; expected a statement such as BO_ or VERSION, or {",
        ));
    }
    let mut file = messages::convert_file(raw, &mut problems);
    file.problems = problems.finish();
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::read::valid_spn;
    use super::*;
    use crate::frame::CanId;
    use crate::wire::j1939::Pgn;

    #[test]
    fn a_suspect_parameter_has_19_bits_and_is_not_0() {
        assert_eq!((valid_spn(0), valid_spn(524_287), valid_spn(524_288)), (None, Some(524_287), None));
    }

    #[test]
    fn what_is_no_database_says_why() {
        let why = |bytes: &[u8]| parse_database(bytes).unwrap_err().to_string();
        assert_eq!(why(b""), "1:1: neither DBC nor JSON; expected a statement such as BO_ or VERSION, or {");
        assert_eq!(
            why(b"(1.0) can0 123#00"),
            "1:1: neither DBC nor JSON; expected a statement such as BO_ or VERSION, or {"
        );
        assert_eq!(why(b"{\n \"x\": 1}"), "2:8: not valid pretty_j1939 JSON: missing field `J1939PGNdb`");
        assert_eq!(
            why(b"{\"J1939PGNdb\": {"),
            "1:16: not valid pretty_j1939 JSON: EOF while parsing an object"
        );
    }

    /// The limit of a 64-bit float is 1.8e308: 1e400 and 1e999 overflow, 1e308 × 2^32 as well, 1e300 × 2^8 not.
    #[test]
    fn a_factor_that_overflows_is_reported_with_its_position() {
        let signals = [
            "Big : 0|8@1+ (1e400,0)",
            "Off : 8|8@1+ (1,-1e999)",
            "Edge : 16|32@1+ (1e308,0)",
            "Fine : 48|8@1+ (1e300,0)",
        ];
        let lines = signals.map(|text| format!(" SG_ {text} [0|0] \"\" N\n")).concat();
        let file = parse_database(format!("BO_ 1 M: 8 N\n{lines}").as_bytes()).unwrap();
        let problems: Vec<_> = file.problems.iter().map(ToString::to_string).collect();
        let expected = [
            "2:20: signal \"Big\" skipped: factor \"1e400\" exceeds the range of 64-bit floats",
            "3:22: signal \"Off\" skipped: offset \"-1e999\" exceeds the range of 64-bit floats",
            "4:23: signal \"Edge\" skipped: factor \"1e308\" exceeds the range of 64-bit floats",
        ];
        assert_eq!(problems, expected);
        let (_, message) = file.messages().next().unwrap();
        assert_eq!(message.layout.fields.len(), 1);
    }

    #[test]
    fn of_two_files_the_first_counts() {
        let file = |name: &str| {
            parse_database(format!("BO_ 1 {name}: 8 N\nBO_ 2566849022 {name}: 8 N\n SG_ {name} : 0|8@1+ (1,0) [0|0] \"\" N\nBA_ \"SPN\" SG_ 2566849022 {name} 7;").as_bytes())
                .unwrap()
        };
        let mut database = Database::default();
        assert!(database.is_empty());
        database.add_file(file("A"));
        database.add_file(file("B"));
        let name = |message: Option<&Arc<DatabaseMessage>>| message.map(|it| it.name.clone());
        assert_eq!(name(database.message_by_id(CanId::Standard(1))).as_deref(), Some("A"));
        // 0x18FF01FE from any source.
        assert_eq!(name(database.message_by_pgn(Pgn::new(0xFF01))).as_deref(), Some("A"));
        assert_eq!(name(database.message_by_id(CanId::from_extended(0x18FF_0100))), None);
        assert_eq!(database.parameter_by_spn(7).map(|it| it.name.as_str()), Some("A"));
    }
}
