//! Text of canboat: lines of `actisense-serial` and `candump2analyzer`, and JSON of the analyzer.
//!
//! JSON of canboat's `analyzer -json -data` and of canboatjs, one message per line.
//!
//! ```text
//! {"timestamp":"2011-11-24-22:42:04.388","prio":2,"src":36,"dst":255,"pgn":127251,"description":"Rate of Turn",
//!  "data":"7D0B7D0200FFFFFF","fields":{…}}
//! {"prio":2,"src":36,"dst":255,"pgn":127251,"timestamp":"…","input":["2011-11-24T22:42:04.388Z,2,127251,36,255,8,7d,…"]}
//! ```
//!
//! Without `-data` the analyzer writes values only, from which no frame can be made. Source: canboat, `analyzer/analyzer.c`.

use super::message::{ADDRESS, DATA, MessageTime, PGN, ParsedMessage, PgnMessage};
use crate::capture::calendar::from_utc;
use crate::capture::text::columns::{NumberBase, time_of_day};

/// Parses a line of JSON.
pub(super) fn parse_json(line: &[u8]) -> ParsedMessage {
    const OBJECT: &str = "expected a JSON object with timestamp, prio, src, dst, pgn, and data or input";
    let object = line.strip_prefix(b"{").and_then(|rest| rest.strip_suffix(b"}")).ok_or(OBJECT)?;
    // Members of the object in `fields` have other names.
    if let Some(input) = member(object, b"\"input\":[\"") {
        return parse_text(input);
    }
    let time = member(object, b"\"timestamp\":\"").and_then(parse_date).ok_or(OBJECT)?;
    let number = |name: &[u8]| member(object, name).and_then(|text| NumberBase::Decimal.parse_number(text));
    let byte = |name: &[u8]| number(name).and_then(|number| u8::try_from(number).ok()).ok_or(ADDRESS);
    let pgn = number(b"\"pgn\":").ok_or(PGN)?;
    let digits = member(object, b"\"data\":\"").ok_or(OBJECT)?;
    let digits: Vec<u8> = digits.iter().copied().filter(|byte| !byte.is_ascii_whitespace()).collect();
    let bytes = digits.chunks(2).map(|pair| NumberBase::Hex.parse_byte(pair).filter(|_| pair.len() == 2));
    let data = bytes.collect::<Option<Vec<u8>>>().ok_or(DATA)?;
    let message = PgnMessage::new(byte(b"\"prio\":")?, pgn, byte(b"\"src\":")?, byte(b"\"dst\":")?, data)?;
    Ok((time, message))
}

/// Value of a member, up to the end of a number or of a string without escapes.
fn member<'a>(object: &'a [u8], name: &[u8]) -> Option<&'a [u8]> {
    let at = memchr::memmem::find(object, name)? + name.len();
    let value = object.get(at..)?;
    let is_text = name.ends_with(b"\"");
    let is_end = |byte: &u8| if is_text { *byte == b'"' } else { !byte.is_ascii_digit() };
    value.get(..value.iter().position(is_end).unwrap_or(value.len()))
}

/// Parses a line of text.
pub(super) fn parse_text(line: &[u8]) -> ParsedMessage {
    const TIME: &str = "time: expected a date such as 2011-11-24-22:42:04.388";
    const LENGTH: &str = "length: expected as many bytes as follow";
    let mut fields = line.split(|byte| *byte == b',').map(<[u8]>::trim_ascii);
    let time = fields.next().and_then(parse_date).ok_or(TIME)?;
    let mut number = || fields.next().and_then(|field| NumberBase::Decimal.parse_number(field));
    let priority = number().and_then(|number| u8::try_from(number).ok()).ok_or(ADDRESS)?;
    let pgn = number().ok_or(PGN)?;
    let mut address = || number().and_then(|number| u8::try_from(number).ok());
    let (source, destination) = (address().ok_or(ADDRESS)?, address().ok_or(ADDRESS)?);
    let length = number().ok_or(LENGTH)?;
    let data: Option<Vec<u8>> =
        fields.map(|field| NumberBase::Hex.parse_byte(field).filter(|_| field.len() == 2)).collect();
    let data = data.ok_or(DATA)?;
    if u32::try_from(data.len()) != Ok(length) {
        return Err(LENGTH);
    }
    Ok((time, PgnMessage::new(priority, pgn, source, destination, data)?))
}

/// Parses `2011-11-24-22:42:04.388`, or with T or Z between date and time, and Z at the end.
fn parse_date(field: &[u8]) -> Option<MessageTime> {
    let (text, is_utc) = match field.strip_suffix(b"Z") {
        Some(text) => (text, true),
        None => (field, false),
    };
    let (date, clock) = text.split_at_checked(10)?;
    let (mark, clock) = clock.split_first()?;
    let is_utc = is_utc || *mark == b'Z';
    let [y3, y2, y1, y0, b'-', o1, o0, b'-', d1, d0] = date else { return None };
    let number = |digits: &[u8]| NumberBase::Decimal.parse_number(digits).map(i64::from);
    let (year, month, day) = (number(&[*y3, *y2, *y1, *y0])?, number(&[*o1, *o0])?, number(&[*d1, *d0])?);
    let midnight = from_utc([year, month, day, 0, 0, 0], 0)?;
    let of_day = time_of_day(clock).filter(|_| matches!(mark, b'-' | b'T' | b'Z' | b' '))?;
    Some(MessageTime::Date(midnight.checked_add(of_day)?, is_utc))
}

#[cfg(test)]
mod tests {
    use crate::capture::testing::read_capture;

    #[test]
    fn both_programs_write_the_same_message() {
        // PGN 1F113h from 36 with priority 2: 2 << 26 | 1F113h << 8 | 24h.
        let expected = "{1} (1322174524.388000000) bus0 09F11324#7D0B7D0200FFFFFF flags=00 dlc=0";
        for line in [
            r#"{"timestamp":"2011-11-24T22:42:04.388Z","prio":2,"src":36,"dst":255,"pgn":127251,"description":"Rate of Turn","data":"7D0B7D0200FFFFFF","fields":{"SID":125}}"#,
            r#"{"timestamp":"2011-11-24T22:42:04.388Z","prio":2,"src":36,"dst":255,"pgn":127251,"data":"7d 0b 7d 02 00 ff ff ff"}"#,
            r#"{"canId":166793764,"prio":2,"src":36,"dst":255,"pgn":127251,"input":["2011-11-24T22:42:04.388Z,2,127251,36,255,8,7d,0b,7d,02,00,ff,ff,ff"],"fields":{"sid":125}}"#,
        ] {
            assert_eq!(read_capture(line.as_bytes()).items, [expected], "{line}");
        }
    }
}
