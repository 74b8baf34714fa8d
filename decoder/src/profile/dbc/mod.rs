//! Databases of messages the user gives: DBC files, and the JSON form of pretty_j1939.
//!
//! A DBC tells for each identifier which bits of its payload are which signal, with scale, unit and names of
//! values. Messages of 29 bits also count for their parameter group, whoever sends it: priority, source and
//! (PDU1 format, SAE J1939-21 §5.2) destination are no part of what a message is.
//!
//! What can be read is read. What cannot is a [`Problem`] with its place, and nothing else is lost to it.
//!
//! ```text
//! bytes ─┬─statement, read─▶ Raw ─messages─┐
//!        └─pretty_j1939────────────────────┴─▶ DatabaseFile ─▶ Database
//! ```

mod database;
mod file;
mod limits;
mod messages;
mod pretty_j1939;
mod problem;
mod read;
mod signal;
mod statement;

use crate::profile::device_file::decode;
use problem::Problems;

pub use database::Database;
pub use file::{DatabaseFile, DatabaseMessage, Parameter};
pub(crate) use limits::LONGEST_STRING;
pub use limits::{LONGEST_MESSAGE, MOST_MESSAGES, MOST_PROBLEMS, MOST_RANGES, MOST_SIGNALS};
pub use problem::Problem;

/// Reads a DBC, or the JSON of pretty_j1939, recognised by its content: JSON begins with `{`. Text is UTF-8 or
/// UTF-16 if it says or can be so, else Windows-1252. Time and memory are linear in the length of `bytes`.
///
/// # Errors
/// If there is nothing of a database in it.
pub fn parse(bytes: &[u8]) -> Result<DatabaseFile, Problem> {
    let text = decode(bytes);
    if text.trim_start().starts_with('{') {
        return pretty_j1939::parse(&text);
    }
    let text = if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n").into() } else { text };
    let mut problems = Problems::of(&text);
    let raw = read::Raw::of(&text, &mut problems);
    if raw.statements == 0 {
        return Err(Problem::new(1, 1, "no DBC: not one statement like BO_ or VERSION, and no JSON"));
    }
    let mut file = messages::file(raw, &mut problems);
    file.problems = problems.finish();
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::read::spn;
    use super::*;
    use crate::frame::CanId;
    use crate::wire::j1939::Pgn;

    #[test]
    fn a_suspect_parameter_has_19_bits_and_is_not_0() {
        assert_eq!((spn(0), spn(524_287), spn(524_288)), (None, Some(524_287), None));
    }

    #[test]
    fn what_is_no_database_says_why() {
        let why = |bytes: &[u8]| parse(bytes).unwrap_err().to_string();
        assert_eq!(why(b""), "1:1: no DBC: not one statement like BO_ or VERSION, and no JSON");
        assert_eq!(
            why(b"(1.0) can0 123#00"),
            "1:1: no DBC: not one statement like BO_ or VERSION, and no JSON"
        );
        assert_eq!(why(b"{\n \"x\": 1}"), "2:8: no JSON of pretty_j1939: missing field `J1939PGNdb`");
        assert_eq!(why(b"{\"J1939PGNdb\": {"), "1:16: no JSON of pretty_j1939: EOF while parsing an object");
    }

    #[test]
    fn of_two_files_the_first_counts() {
        let file = |name: &str| {
            parse(format!("BO_ 1 {name}: 8 N\nBO_ 2566849022 {name}: 8 N\n SG_ {name} : 0|8@1+ (1,0) [0|0] \"\" N\nBA_ \"SPN\" SG_ 2566849022 {name} 7;").as_bytes())
                .unwrap()
        };
        let mut database = Database::default();
        assert!(database.is_empty());
        database.add(file("A"));
        database.add(file("B"));
        let name = |message: Option<&Arc<DatabaseMessage>>| message.map(|it| it.name.clone());
        assert_eq!(name(database.frame(CanId::Standard(1))).as_deref(), Some("A"));
        // 0x18FF01FE of any source.
        assert_eq!(name(database.message(Pgn::new(0xFF01))).as_deref(), Some("A"));
        assert_eq!(name(database.frame(CanId::extended(0x18FF_0100))), None);
        assert_eq!(database.parameter(7).map(|it| it.name.as_str()), Some("A"));
    }
}
