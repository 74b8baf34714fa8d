//! Parser of one line of candump text, in all forms of can-utils.
//!
//! ```text
//! (1700000000.123456) can0 701#05                      log: -l, -L
//! (1700000000.123456789) can0 123##1112233 R           nanoseconds, FD, direction
//!  (000.000000)  can0  RX - -  701   [1]  05   '.'     screen: -t z, -x, -a
//!   can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME
//! ```

use nom::branch::alt;
use nom::bytes::complete::{tag, take_while_m_n, take_while1};
use nom::character::complete::{char, digit1, space1};
use nom::combinator::opt;
use nom::sequence::{delimited, terminated};
use nom::{IResult, Parser};

use super::stamp::{decimal_value, leading_stamp};
use crate::capture::text::lines::is_ellipsis;
use crate::frame::{CanId, FrameFlags, MAX_DATA, is_fd_length};

/// Error frame flag of SocketCAN in a 32-bit identifier.
const ERROR_FLAG: u32 = 0x2000_0000;

/// Content of a line.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture::formats) enum CandumpLine<'a> {
    Frame(CandumpFrameLine<'a>),
    /// candump -d: the socket of an interface lost this many frames.
    Dropped {
        count: u64,
        bus: &'a [u8],
    },
    /// A line without data: blank, comment, marker, detail of an error frame.
    Nothing,
    /// Text around the capture: a shell prompt, or a Markdown fence.
    Around,
    /// A mark of lines that were left out: `...`.
    Ellipsis,
}

/// Content of a line with a frame.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture::formats) struct CandumpFrameLine<'a> {
    /// Timestamp in nanoseconds, if any.
    pub(in crate::capture::formats) stamp: Option<i64>,
    /// Whether the timestamp is a date without time zone (`-t A`).
    pub(in crate::capture::formats) is_date: bool,
    /// Whether the line has the log form (`-l`, `-L`), whose timestamps are always absolute.
    pub(in crate::capture::formats) is_log: bool,
    /// Interface name.
    pub(in crate::capture::formats) bus: &'a [u8],
    pub(in crate::capture::formats) id: CanId,
    pub(in crate::capture::formats) flags: FrameFlags,
    pub(in crate::capture::formats) length: u8,
    pub(in crate::capture::formats) raw_dlc: u8,
    pub(in crate::capture::formats) bytes: [u8; MAX_DATA],
}

/// Reason why a line has no frame.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture::formats) enum LineError {
    /// The line is not candump text.
    NotCandump,
    /// A CAN XL frame: up to 2,048 bytes, not supported.
    CanXl,
    /// A line of a frame with an unreadable part; contains the description.
    Broken(&'static str),
}

type Parsed<'a, T> = IResult<&'a [u8], T>;

/// Parses one line without its end.
pub(in crate::capture::formats) fn parse_line(line: &[u8]) -> Result<CandumpLine<'_>, LineError> {
    match parse_output(line) {
        found @ (Ok(CandumpLine::Around) | Err(_)) => sent_frame(line).map_or(found, parse_output),
        found => found,
    }
}

/// Parses a line that candump prints.
fn parse_output(line: &[u8]) -> Result<CandumpLine<'_>, LineError> {
    if is_nothing(line) {
        return Ok(CandumpLine::Nothing);
    }
    if is_fence(line) {
        return Ok(CandumpLine::Around);
    }
    if is_ellipsis(line) {
        return Ok(CandumpLine::Ellipsis);
    }
    if let Ok((_, (count, bus))) = drop_count(line) {
        return Ok(CandumpLine::Dropped { count, bus });
    }
    let Ok((rest, (stamp, is_date))) = leading_stamp(line) else {
        return Err(LineError::Broken("timestamp: expected (seconds.fraction) or (date time.fraction)"));
    };
    let has_stamp = stamp.is_some();
    let Ok((rest, bus)) = parse_interface(rest) else {
        return match (has_stamp, is_prompt(line)) {
            (true, _) => Err(LineError::Broken("interface: expected a name")),
            (false, true) => Ok(parse_prompt(line)),
            (false, false) => Err(LineError::NotCandump),
        };
    };
    if !has_stamp && is_other_column(bus) {
        return if is_prompt(line) { Ok(parse_prompt(line)) } else { Err(LineError::NotCandump) };
    }
    let body = match log_body(rest) {
        // `C#` in a text is a short identifier too.
        Some(_) if !has_stamp && memchr::memchr(b'#', rest).is_some_and(|hash| hash < 3) => {
            return Err(LineError::NotCandump);
        }
        Some(result) => result,
        // In pasted text, quote marks and times in other forms precede the identifier.
        None if !has_stamp && (!is_name(bus) || is_count(bus)) => {
            return if is_prompt(line) { Ok(parse_prompt(line)) } else { Err(LineError::NotCandump) };
        }
        None => screen_body(rest),
    };
    match body {
        Ok(body) => Ok(CandumpLine::Frame(CandumpFrameLine { stamp, is_date, bus, ..body })),
        Err(LineError::NotCandump) if !has_stamp && is_prompt(line) => Ok(parse_prompt(line)),
        Err(LineError::NotCandump) if has_stamp => {
            Err(LineError::Broken("expected an identifier of 1 to 8 hex digits after the interface"))
        }
        Err(error) => Err(error),
    }
}

/// Parses `DROPCOUNT: dropped 55 CAN frames on 'vcan0' socket (total drops 55)`.
fn drop_count(line: &[u8]) -> Parsed<'_, (u64, &[u8])> {
    let (rest, digits) = delimited(tag("DROPCOUNT: dropped "), digit1, tag(" CAN frame")).parse(line)?;
    let bus = rest.split(|byte| *byte == b'\'').nth(1).unwrap_or_default();
    Ok((rest, (u64::try_from(decimal_value(digits)).unwrap_or(0), bus)))
}

/// Removes the colours of `candump -c` from a line.
pub(in crate::capture::formats) fn without_colors(line: &[u8]) -> std::borrow::Cow<'_, [u8]> {
    const ESCAPE: u8 = 0x1B;
    let mut parts = line.split(|byte| *byte == ESCAPE);
    let Some(first) = parts.next().filter(|first| first.len() < line.len()) else { return line.into() };
    let mut plain = first.to_vec();
    for part in parts {
        // `[`, parameters and a letter are a colour; other text is kept.
        let end = part.iter().position(u8::is_ascii_alphabetic).filter(|_| part.starts_with(b"["));
        plain.extend_from_slice(end.and_then(|end| part.get(end + 1..)).unwrap_or(part));
    }
    plain.into()
}

fn parse_interface(input: &[u8]) -> Parsed<'_, &[u8]> {
    terminated(take_while1(|c: u8| !c.is_ascii_whitespace()), space1).parse(input)
}

/// Whether the word is an interface name, neither quote marks nor a number with a decimal point.
fn is_name(word: &[u8]) -> bool {
    let is_decimal = word.contains(&b'.') && word.iter().all(|byte| byte.is_ascii_digit() || *byte == b'.');
    !is_decimal && word.iter().any(|byte| *byte != b'>')
}

/// Whether the word before an identifier is a column of another program: a time or a direction. As the name of a bus, it
/// would make one bus of each line.
pub(super) fn is_other_column(word: &[u8]) -> bool {
    let is_time = word.first().is_some_and(u8::is_ascii_digit)
        && word.last().is_some_and(u8::is_ascii_digit)
        && word.iter().any(|byte| !byte.is_ascii_digit())
        && word.iter().all(|byte| byte.is_ascii_digit() || matches!(byte, b':' | b'.' | b','));
    is_time || word.eq_ignore_ascii_case(b"rx") || word.eq_ignore_ascii_case(b"tx")
}

/// Whether the word is a number, such as the count of a line, not the name of an interface.
fn is_count(word: &[u8]) -> bool {
    word.iter().all(u8::is_ascii_digit) || word.starts_with(b"0x")
}

/// Starts of the lines in which `candump -e` explains an error frame (can-utils, lib.c).
const DETAILS: &[&[u8]] = &[
    b"tx-timeout",
    b"lost-arbitration",
    b"controller-problem",
    b"protocol-violation",
    b"transceiver-status",
    b"no-acknowledgement-on-tx",
    b"bus-off",
    b"bus-error",
    b"restarted-after-bus-off",
    b"error-counter-tx-rx",
];

fn is_nothing(line: &[u8]) -> bool {
    match line.iter().find(|byte| !byte.is_ascii_whitespace()) {
        None | Some(b'#' | b'*' | b';') => true,
        Some(_) => {
            let text = line.trim_ascii();
            line.first() == Some(&b'\t')
                && (DETAILS.iter().any(|detail| text.starts_with(detail)) || is_repeated_error_frame(text))
        }
    }
}

/// Whether the line repeats an error frame without its interface: `candump -e` prints that for classes that it cannot
/// explain.
fn is_repeated_error_frame(text: &[u8]) -> bool {
    let id = text.iter().take_while(|byte| byte.is_ascii_hexdigit()).count();
    id == 8 && text.ends_with(b"ERRORFRAME")
}

/// Whether the line begins or ends a block of code in Markdown.
fn is_fence(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    line.starts_with(b"```") || line.starts_with(b"~~~")
}

/// Whether the line is text around a capture: a Markdown fence or a shell prompt.
pub(in crate::capture::formats) fn is_around(line: &[u8]) -> bool {
    is_fence(line) || is_prompt(line)
}

/// A line without the quote marks of a mail or of Markdown at its start.
pub(in crate::capture::formats) fn without_quotes(line: &[u8]) -> &[u8] {
    let marks = line.iter().take_while(|byte| byte.is_ascii_whitespace() || **byte == b'>').count();
    line.get(marks..).unwrap_or_default()
}

/// Parses a line that has the form of a prompt: `> ` may be a quote mark before a frame.
fn parse_prompt(line: &[u8]) -> CandumpLine<'_> {
    let quoted = without_quotes(line);
    if quoted.len() < line.len()
        && let Ok(frame @ CandumpLine::Frame(_)) = parse_line(quoted)
    {
        return frame;
    }
    CandumpLine::Around
}

/// Interface and frame of the command `cansend can0 123#11`, also after a shell prompt.
fn sent_frame(line: &[u8]) -> Option<&[u8]> {
    const COMMAND: &[u8] = b"cansend ";
    let at = memchr::memmem::find(line.get(..COMMAND.len() + 80).unwrap_or(line), COMMAND)?;
    let (before, command) = line.split_at_checked(at)?;
    let before = before.trim_ascii_end();
    let before = before.strip_suffix(b"sudo").unwrap_or(before).trim_ascii_end();
    let is_prompt = before.is_empty() || matches!(before.last(), Some(b'$' | b'#' | b'>' | b'%'));
    command.strip_prefix(COMMAND).filter(|_| is_prompt)
}

/// Whether the line is a shell command between two captures.
fn is_prompt(line: &[u8]) -> bool {
    let trimmed = line.trim_ascii();
    let marks = |mark: &[u8]| memchr::memmem::find(trimmed, mark).is_some();
    let bare = trimmed.starts_with(b"$ ") || trimmed.starts_with(b"> ") || trimmed.starts_with(b"% ");
    bare || ((marks(b"@") || marks(b"~") || trimmed.starts_with(b"/"))
        && (marks(b"$ ")
            || marks(b"# ")
            || marks(b"% ")
            || trimmed.ends_with(b"$")
            || trimmed.ends_with(b"#")))
        || trimmed == b"^C"
}

const EMPTY: CandumpFrameLine<'static> = CandumpFrameLine {
    stamp: None,
    is_date: false,
    is_log: false,
    bus: &[],
    id: CanId::Standard(0),
    flags: FrameFlags(0),
    length: 0,
    raw_dlc: 0,
    bytes: [0; MAX_DATA],
};

/// Parses an identifier of one to eight digits: up to three are a base identifier up to 7FF, others an extended one, and
/// eight also an error frame. can-utils print three or eight digits, other programs omit leading zeros.
fn parse_identifier(digits: &[u8]) -> Option<(CanId, FrameFlags)> {
    let number =
        digits.iter().try_fold(0_u32, |value, digit| Some(value << 4 | u32::from(hex_digit(*digit)?)))?;
    match digits.len() {
        1..=3 if number <= 0x7FF => Some((CanId::from_standard(u16::try_from(number).ok()?), FrameFlags(0))),
        0..=2 | 9.. => None,
        8 if (ERROR_FLAG..2 * ERROR_FLAG).contains(&number) => {
            Some((CanId::from_extended(number), FrameFlags::ERROR))
        }
        _ => (number < ERROR_FLAG).then_some((CanId::from_extended(number), FrameFlags(0))),
    }
}

fn hex_digit(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).and_then(|value| u8::try_from(value).ok())
}

/// Parses `123#1122`, `123#R4`, `123##1…`; `None` if there is no `#` at the position of the log form.
fn log_body(input: &[u8]) -> Option<Result<CandumpFrameLine<'static>, LineError>> {
    let hash = memchr::memchr(b'#', input).filter(|at| (1..=8).contains(at))?;
    let (digits, rest) = (input.get(..hash)?, input.get(hash + 1..)?);
    if !digits.iter().all(u8::is_ascii_hexdigit) {
        return None;
    }
    if rest.first().is_some_and(u8::is_ascii_hexdigit) && split_word(rest).0.contains(&b':') {
        return Some(Err(LineError::CanXl));
    }
    let Some((id, flags)) = parse_identifier(digits) else {
        return Some(Err(LineError::Broken("identifier: expected 1 to 8 hex digits up to 3FFFFFFF")));
    };
    let (payload, tail) = split_word(rest);
    let body = CandumpFrameLine { id, flags: flags.with(parse_direction(tail)), is_log: true, ..EMPTY };
    Some(match payload {
        [b'#', rest @ ..] => fd_payload(rest, body),
        [b'R' | b'r', rest @ ..] => remote_payload(rest, body),
        _ => classic_payload(payload, body),
    })
}

fn split_word(input: &[u8]) -> (&[u8], &[u8]) {
    let end = input.iter().position(u8::is_ascii_whitespace).unwrap_or(input.len());
    (input.get(..end).unwrap_or_default(), input.get(end..).unwrap_or_default())
}

/// Direction that candump -x appends to log lines.
fn parse_direction(tail: &[u8]) -> FrameFlags {
    match tail.trim_ascii() {
        [b'T', ..] => FrameFlags::TRANSMITTED,
        [b'R', ..] => FrameFlags::RECEIVED,
        _ => FrameFlags(0),
    }
}

fn fd_payload<'a>(rest: &[u8], mut body: CandumpFrameLine<'a>) -> Result<CandumpFrameLine<'a>, LineError> {
    let flags = rest.first().copied().and_then(hex_digit);
    let (Some(flags), Some(rest)) = (flags, rest.get(1..)) else {
        return Err(LineError::Broken("FD frame: expected one hex digit of flags after ##"));
    };
    body.flags = body.flags.with(FrameFlags::FD);
    if flags & 1 != 0 {
        body.flags = body.flags.with(FrameFlags::BIT_RATE_SWITCH);
    }
    if flags & 2 != 0 {
        body.flags = body.flags.with(FrameFlags::ERROR_STATE);
    }
    hex_data(rest, MAX_DATA, &mut body)?;
    if !is_fd_length(body.length) {
        return Err(LineError::Broken("FD frame: expected 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes"));
    }
    Ok(body)
}

fn remote_payload<'a>(
    rest: &[u8],
    mut body: CandumpFrameLine<'a>,
) -> Result<CandumpFrameLine<'a>, LineError> {
    body.flags = body.flags.with(FrameFlags::REMOTE);
    let (digits, raw) = split_raw_dlc(rest)?;
    body.length = match digits {
        [] => 0,
        [digit] => hex_digit(*digit)
            .filter(|length| *length <= 8)
            .ok_or(LineError::Broken("remote frame length: expected 0 to 8"))?,
        _ => return Err(LineError::Broken("remote frame: expected R, or R and a length of 0 to 8")),
    };
    body.raw_dlc = raw;
    Ok(body)
}

fn classic_payload<'a>(
    payload: &[u8],
    mut body: CandumpFrameLine<'a>,
) -> Result<CandumpFrameLine<'a>, LineError> {
    let (data, raw) = split_raw_dlc(payload)?;
    hex_data(data, 8, &mut body)?;
    if raw != 0 && body.length != 8 {
        return Err(LineError::Broken("raw DLC suffix: allowed after 8 data bytes only"));
    }
    body.raw_dlc = raw;
    Ok(body)
}

/// Splits off the suffix `_9` … `_F` of a classic frame with a DLC above 8.
fn split_raw_dlc(payload: &[u8]) -> Result<(&[u8], u8), LineError> {
    match payload {
        [data @ .., b'_', digit] => match hex_digit(*digit) {
            Some(dlc @ 9..=15) => Ok((data, dlc)),
            _ => Err(LineError::Broken("raw DLC suffix: expected _9 to _F")),
        },
        _ => Ok((payload, 0)),
    }
}

/// Parses pairs of hex digits, optionally separated by dots.
fn hex_data(mut digits: &[u8], limit: usize, body: &mut CandumpFrameLine<'_>) -> Result<(), LineError> {
    let mut length = 0;
    loop {
        if let [b'.', rest @ ..] = digits {
            digits = rest;
        }
        let [high, low, rest @ ..] = digits else { break };
        let (Some(high), Some(low)) = (hex_digit(*high), hex_digit(*low)) else {
            return Err(LineError::Broken("data: expected pairs of hex digits"));
        };
        let Some(slot) = body.bytes.get_mut(..limit).and_then(|bytes| bytes.get_mut(length)) else {
            return Err(LineError::Broken("data: longer than the frame type allows"));
        };
        *slot = high << 4 | low;
        length += 1;
        digits = rest;
    }
    if !digits.is_empty() {
        return Err(LineError::Broken("data: expected pairs of hex digits"));
    }
    body.length = u8::try_from(length).unwrap_or(0);
    Ok(())
}

/// Parses `[RX - -]  123   [2]  11 22`; brackets contain the length, braces (`-8`) a raw DLC.
fn screen_body(input: &[u8]) -> Result<CandumpFrameLine<'static>, LineError> {
    let (rest, marks) = opt(direction_marks).parse(input).map_err(|_| LineError::NotCandump)?;
    let (digits, rest) = split_word(rest);
    let (id, flags) = parse_identifier(digits).ok_or(LineError::NotCandump)?;
    let mut body = CandumpFrameLine { id, flags: flags.with(marks.unwrap_or_default()), ..EMPTY };
    if is_xl_length(rest) {
        return Err(LineError::CanXl);
    }
    let (rest, (count, is_fd, raw_dlc)) = bracketed_length(rest).map_err(|_| LineError::NotCandump)?;
    let limit = if is_fd { MAX_DATA } else { 8 };
    if is_fd {
        body.flags = body.flags.with(FrameFlags::FD);
    }
    if count > limit {
        return Err(LineError::Broken("length: greater than the frame type allows"));
    }
    body.raw_dlc = raw_dlc;
    body.length = u8::try_from(count).unwrap_or(0);
    if rest.trim_ascii().starts_with(b"remote request") {
        body.flags = body.flags.with(FrameFlags::REMOTE);
        return Ok(body);
    }
    screen_data(rest, count, &mut body)?;
    Ok(body)
}

/// CAN XL lengths have four digits: `[0007]`.
fn is_xl_length(rest: &[u8]) -> bool {
    matches!(rest.trim_ascii_start(), [b'[', a, b, c, d, b']', ..] if [a, b, c, d].iter().all(|digit| digit.is_ascii_digit()))
}

/// Parses `RX - -` or `TX B E`: direction, bit rate switch, error state.
fn direction_marks(input: &[u8]) -> Parsed<'_, FrameFlags> {
    let (rest, (direction, _, switch, _, state, _)) = (
        alt((tag("RX"), tag("TX"))),
        space1,
        alt((char('B'), char('-'))),
        space1,
        alt((char('E'), char('-'))),
        space1,
    )
        .parse(input)?;
    let mut flags = if direction == b"TX" { FrameFlags::TRANSMITTED } else { FrameFlags::RECEIVED };
    if switch == 'B' {
        flags = flags.with(FrameFlags::BIT_RATE_SWITCH);
    }
    if state == 'E' {
        flags = flags.with(FrameFlags::ERROR_STATE);
    }
    Ok((rest, flags))
}

fn bracketed_length(input: &[u8]) -> Parsed<'_, (usize, bool, u8)> {
    let (rest, _) = space1(input)?;
    let (rest, (open, digits, _)) = (
        alt((char('['), char('{'))),
        take_while_m_n(1, 2, |c: u8| c.is_ascii_hexdigit()),
        alt((char(']'), char('}'))),
    )
        .parse(rest)?;
    let broken = || nom::Err::Error(nom::error::Error::new(input, nom::error::ErrorKind::Digit));
    if open == '{' {
        let [digit] = digits else { return Err(broken()) };
        let dlc = hex_digit(*digit).ok_or_else(broken)?;
        return Ok((rest, (usize::from(dlc.min(8)), false, if dlc > 8 { dlc } else { 0 })));
    }
    let count = std::str::from_utf8(digits).ok().and_then(|text| text.parse().ok()).ok_or_else(broken)?;
    Ok((rest, (count, digits.len() == 2, 0)))
}

/// Parses `count` bytes as pairs of hex digits (or eight binary digits each, `-i`), reversed after backticks
/// (`-S`).
fn screen_data(rest: &[u8], count: usize, body: &mut CandumpFrameLine<'_>) -> Result<(), LineError> {
    const SHORT: LineError = LineError::Broken("data: fewer bytes than the length");
    let swapped = rest.trim_ascii_start().get(2).is_some_and(|byte| *byte == b'`')
        || rest.trim_ascii_start().get(8).is_some_and(|byte| *byte == b'`');
    let mut words =
        rest.split(|byte| byte.is_ascii_whitespace() || *byte == b'`').filter(|word| !word.is_empty());
    for index in 0..count {
        let value = match words.next() {
            Some([high, low]) => match (hex_digit(*high), hex_digit(*low)) {
                (Some(high), Some(low)) => high << 4 | low,
                _ => return Err(SHORT),
            },
            Some(bits) if bits.len() == 8 && bits.iter().all(|bit| matches!(bit, b'0' | b'1')) => {
                bits.iter().fold(0, |value, bit| value << 1 | (bit - b'0'))
            }
            _ => return Err(SHORT),
        };
        let target = if swapped { count - 1 - index } else { index };
        if let Some(slot) = body.bytes.get_mut(target) {
            *slot = value;
        }
    }
    Ok(())
}
