//! Logs of test tools with messages of UDS in place of frames.
//!
//! ```text
//! 2024-05-01 13:22:10,112 [DEBUG] Connection[ISOTP]: Received 6 bytes : [b'5003003201f4']
//! [13:22:10.100] Tx 7E0 -> 22 F1 90          Request: 22F190          00 00 07 E8 62 F1 90 57
//! ```
//!
//! No list of programs decides, but the content: the first byte is a service identifier, responses repeat it with bit 6
//! set, and repeat the sub-function or the data identifier (ISO 14229-1 tables 2 and 3; services of ISO 15031-5). In
//! frames the first byte is control information of ISO-TP, so frames never answer each other in this way.
//!
//! The frames that carried a message are not recorded. They are built again, all with the time of the message, so that the
//! exchange can be judged; without identifiers in the log they are those of the first server (ISO 15765-4).

use std::collections::VecDeque;

use super::layout::TimeForm;
use super::time::{RowTime, TimeMeaning};
use super::token::{Dialect, Token, TokenKind, Tokens};
use crate::capture::column_list::ColumnUnit;
use crate::capture::formats::candump::line::without_colors;
use crate::capture::local_time::TimeOrigin;
use crate::capture::text::columns::{NumberBase, parse_identifier};
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine, first_lines,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::{Batch, CaptureFormat};
use crate::frame::{CanId, Frame, FrameFlags};
use crate::words::NO_FRAMES;

pub(in crate::capture::formats) const FORMAT: CaptureFormat = CaptureFormat {
    name: "uds-messages",
    title: MessageLog::TITLE,
    is_text: true,
    is_packed: false,
    detect: is_message_log,
    parser: |options| Box::new(LineParser::with_zones(MessageLog::default(), options)),
};

/// Number of lines at the start that are compared.
const DETECTING_LINES: usize = 200;

/// Longest beginning of a line that is searched for times and identifiers, in bytes.
const LONGEST_START: usize = 200;

/// Number of tokens at the start of a line among which the time is.
const TIME_TOKENS: usize = 4;

/// Longest message of ISO-TP with a length of 12 bits.
const LONGEST_MESSAGE: usize = 4_095;

/// Byte that fills the frames that are built again.
const FILLER: u8 = 0xCC;

/// Bit that distinguishes the identifiers of responses.
const RESPONSE: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

/// Identifiers of requests: ISO 15031-5, ISO 14230-3 as used on CAN, ISO 14229-1.
const SERVICES: &[u8] = &[
    0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0A, 0x10, 0x11, 0x12, 0x13, 0x14, 0x17, 0x18,
    0x19, 0x1A, 0x21, 0x22, 0x23, 0x24, 0x26, 0x27, 0x28, 0x29, 0x2A, 0x2C, 0x2E, 0x2F, 0x30, 0x31, 0x34,
    0x35, 0x36, 0x37, 0x38, 0x3B, 0x3D, 0x3E, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88,
];

/// Identifiers of the first server and its client (ISO 15765-4), used if the log has none.
const CLIENT: u16 = 0x7E0;
const SERVER: u16 = 0x7E8;
const NO_IDENTIFIERS: &str = "no identifiers: requests read as 7E0, responses as 7E8";

/// A message of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
struct LoggedMessage {
    time: Option<(i64, TimeMeaning)>,
    ids: Vec<CanId>,
    /// Whether a word states the direction, or an identifier the address.
    is_marked: bool,
    data: Vec<u8>,
}

impl LoggedMessage {
    fn service(&self) -> Option<u8> {
        let first = *self.data.first()?;
        let is_known = first == NEGATIVE && self.data.len() >= 3 || SERVICES.contains(&(first & !RESPONSE));
        is_known.then_some(first)
    }

    fn is_response(&self) -> bool {
        self.data.first().is_some_and(|first| first & RESPONSE != 0)
    }

    /// Whether this response belongs to a request: the same service, and the same first parameter.
    fn answers(&self, request: &Self) -> bool {
        let (Some(service), Some(response)) = (request.service(), self.data.first()) else { return false };
        if *response == NEGATIVE {
            return self.data.get(1) == Some(&service) && self.data.len() == 3;
        }
        // A data identifier has two bytes, other parameters one; bit 7 of a sub-function suppresses the response.
        let (count, mask) = match service {
            0x22 | 0x2E | 0x2F => (2, 0xFF),
            0x01 | 0x02 | 0x09 | 0x1A | 0x21 | 0x36 => (1, 0xFF),
            0x10 | 0x11 | 0x19 | 0x27..=0x29 | 0x31 | 0x3E | 0x83..=0x87 => (1, 0x7F),
            _ => (0, 0xFF),
        };
        let parameter = |message: &Self| -> Option<Vec<u8>> {
            Some(message.data.get(1..=count)?.iter().map(|byte| byte & mask).collect())
        };
        *response == service | RESPONSE && parameter(self).is_some() && parameter(self) == parameter(request)
    }
}

/// Whether the first lines are messages that answer each other.
fn is_message_log(head: &[u8]) -> bool {
    let mut tokens = Tokens::default();
    let (mut valid, mut others, mut requests, mut answered) = (0_usize, 0_usize, 0_usize, 0_usize);
    let mut request: Option<LoggedMessage> = None;
    for line in first_lines(head, DETECTING_LINES) {
        let Some(message) = parse_message(&without_colors(line), &mut tokens).filter(|found| found.is_marked)
        else {
            continue;
        };
        if message.service().is_none() {
            others += 1;
            continue;
        }
        valid += 1;
        if message.is_response() {
            // Responses may be pending, so one request may have several.
            answered += usize::from(request.as_ref().is_some_and(|request| message.answers(request)));
        } else {
            requests += 1;
            request = Some(message);
        }
    }
    answered > 0 && answered * 2 >= requests && answered * 2 >= valid - requests && others * 9 <= valid
}

/// Parses a line; `None` if it has no bytes.
fn parse_message(line: &[u8], tokens: &mut Tokens) -> Option<LoggedMessage> {
    let start = line.get(..LONGEST_START).unwrap_or(line);
    let start = point_fractions(start);
    tokens.split_line(&start, Dialect::default());
    let is_time = |token: &&Token| {
        !matches!(token.kind, TokenKind::Word | TokenKind::Hex) && !token.text(&start).starts_with(b"-")
    };
    let mut time = RowTime::default();
    let form = TimeForm { unit: Some(ColumnUnit::Seconds), is_delta: false, has_date: true };
    let mut after = 0;
    for token in tokens.list().iter().take(TIME_TOKENS).filter(is_time) {
        time.add_token(token.text(&start), token.kind, Some(form))?;
        after = usize::from(token.end);
    }
    let run = longest_run(line, after)?;
    let before = tokens.list().iter().filter(|token| usize::from(token.end) <= run.start);
    let mut message = LoggedMessage {
        time: time.nanoseconds(),
        ids: run.id.into_iter().collect(),
        is_marked: run.id.is_some(),
        data: run.bytes,
    };
    for token in before {
        let text = token.text(&start);
        match token.kind {
            TokenKind::Hex => message.ids.extend(parse_address(text, token.has_prefix)),
            TokenKind::Word if text.contains(&b'>') || text.contains(&b'<') => {
                // `7E0->7E8`: both ends of a connection.
                let parts = text.split(|byte| !byte.is_ascii_hexdigit());
                message.ids.extend(parts.filter_map(|part| parse_address(part, false)));
                message.is_marked |= is_direction(text);
            }
            TokenKind::Word => message.is_marked |= is_direction(text),
            _ => {}
        }
    }
    message.is_marked |= !message.ids.is_empty();
    Some(message)
}

/// `22:31:17,093` as `22:31:17.093`.
fn point_fractions(start: &[u8]) -> Vec<u8> {
    let mut text = start.to_vec();
    for at in 3..start.len() {
        let is_clock = matches!(
            start.get(at - 3..at + 4),
            Some([b':', b'0'..=b'5', b'0'..=b'9', b',', b'0'..=b'9', b'0'..=b'9', b'0'..=b'9'])
        );
        if is_clock && let Some(comma) = text.get_mut(at) {
            *comma = b'.';
        }
    }
    text
}

/// Words that state the direction of a message, in lower case.
const DIRECTIONS: &[&str] = &[
    "tx",
    "rx",
    "req",
    "request",
    "resp",
    "response",
    "res",
    "rsp",
    "reply",
    "answer",
    "send",
    "sending",
    "sent",
    "recv",
    "received",
    "receive",
    "receiving",
    "transmit",
    "out",
    "in",
    "write",
    "read",
    "tester",
    "ecu",
    "->",
    "<-",
    "-->",
    "<--",
    "=>",
    "<=",
    ">>",
    "<<",
    ">",
    "<",
    "→",
    "←",
    "anfrage",
    "antwort",
    "gesendet",
    "empfangen",
];

fn is_direction(word: &[u8]) -> bool {
    std::str::from_utf8(word).is_ok_and(|word| DIRECTIONS.contains(&word.to_lowercase().as_str()))
}

/// An identifier with 11 bits, or one of ISO-TP with 29 bits.
fn parse_address(digits: &[u8], has_prefix: bool) -> Option<CanId> {
    let number = NumberBase::Hex.parse_number(digits)?;
    match digits.len() {
        3 => parse_identifier(number, false),
        2..=4 if has_prefix => parse_identifier(number, false),
        4 if digits.starts_with(b"0") => parse_identifier(number, false),
        8 if number <= 0x7FF => parse_identifier(number, false),
        8 if has_prefix || matches!(number >> 16, 0x18DA | 0x18DB) => parse_identifier(number, true),
        _ => None,
    }
}

/// Bytes of a message.
struct ByteRun {
    /// Start in the line.
    start: usize,
    /// Identifier before the bytes.
    id: Option<CanId>,
    bytes: Vec<u8>,
    /// Number of words of the bytes.
    words: usize,
}

/// The longest run of bytes that starts at `after` or later, of equal ones the last.
fn longest_run(line: &[u8], after: usize) -> Option<ByteRun> {
    let is_separator = |byte: u8| byte.is_ascii_whitespace() || b",;|[](){}='\":-".contains(&byte);
    let (mut runs, mut at, mut is_open): (Vec<ByteRun>, usize, bool) = (Vec::new(), after, false);
    while let Some(byte) = line.get(at).copied() {
        if is_separator(byte) {
            at += 1;
            continue;
        }
        let length = line.iter().skip(at).position(|byte| is_separator(*byte));
        let end = length.map_or(line.len(), |length| at + length);
        let word = line.get(at..end).unwrap_or_default();
        let is_length = line.get(end) == Some(&b']') && at > 0 && line.get(at - 1) == Some(&b'[');
        match parse_bytes(word).filter(|_| !is_length || word.len() > 2) {
            Some(bytes) => {
                // A length before packed bytes is not one of them.
                let is_packed = word.len() > 2
                    && runs.last().is_some_and(|run| run.id.is_none() && run.bytes.len() == run.words);
                if !std::mem::replace(&mut is_open, true) || is_packed {
                    runs.push(ByteRun { start: at, id: None, bytes: Vec::new(), words: 0 });
                }
                if let Some(run) = runs.last_mut() {
                    let id = parse_address(word, false).filter(|_| run.bytes.is_empty() && run.id.is_none());
                    match id {
                        Some(id) if has_more(line, end) => run.id = Some(id),
                        _ => {
                            run.bytes.extend(bytes);
                            run.words += 1;
                        }
                    }
                }
            }
            None => is_open = false,
        }
        at = end;
    }
    let longest = runs.into_iter().max_by_key(|run| run.bytes.len())?;
    if longest.bytes.is_empty() || longest.bytes.len() > LONGEST_MESSAGE {
        return None;
    }
    Some(without_prefix(longest))
}

/// Whether further bytes follow an identifier.
fn has_more(line: &[u8], at: usize) -> bool {
    let rest = line.get(at..).unwrap_or_default();
    let digits = rest.iter().skip_while(|byte| !byte.is_ascii_alphanumeric());
    digits.take(2).filter(|byte| byte.is_ascii_hexdigit()).count() == 2
}

/// Bytes of a word such as `22`, `0x22` or `22F190`.
fn parse_bytes(word: &[u8]) -> Option<Vec<u8>> {
    let digits = word.strip_prefix(b"0x").unwrap_or(word);
    if digits.is_empty() || !digits.len().is_multiple_of(2) {
        return None;
    }
    digits.chunks_exact(2).map(|pair| NumberBase::Hex.parse_byte(pair)).collect()
}

/// Takes the identifier off that J2534 devices put before the bytes: `00 00 07 E8 62 F1 90`.
fn without_prefix(run: ByteRun) -> ByteRun {
    let id = match run.bytes.as_slice() {
        [0, 0, high @ 0..=7, low, _, ..] if run.id.is_none() => {
            parse_identifier(u32::from(*high) << 8 | u32::from(*low), false)
        }
        [0x18, kind @ (0xDA | 0xDB), to, from, _, ..] if run.id.is_none() => {
            parse_identifier(u32::from_be_bytes([0x18, *kind, *to, *from]), true)
        }
        _ => None,
    };
    match id {
        Some(id) => ByteRun { id: Some(id), bytes: run.bytes.get(4..).unwrap_or_default().to_vec(), ..run },
        None => run,
    }
}

/// State that affects later lines.
#[derive(Clone, Default)]
struct MessageLog {
    tokens: Tokens,
    days: TimesOfDay,
    is_local: bool,
    request: Option<CanId>,
    response: Option<CanId>,
    pending: VecDeque<Frame>,
    skipped: SkippedLines,
    line: u64,
}

impl MessageLog {
    /// Identifier of a message and, if known, that of the other side.
    fn addresses(&mut self, message: &LoggedMessage) -> (CanId, Option<CanId>) {
        let is_response = message.is_response();
        let default = CanId::from_standard(if is_response { SERVER } else { CLIENT });
        let other_side = if is_response { self.request } else { self.response };
        // A pair of identifiers on each line is that of the connection.
        let own = message.ids.iter().find(|id| !is_response || Some(**id) != self.request);
        let own = own.or(message.ids.first()).copied().unwrap_or(default);
        let slot = if is_response { &mut self.response } else { &mut self.request };
        *slot = Some(own);
        let pair = message.ids.iter().find(|id| **id != own).copied();
        (own, pair.or_else(|| opposite_address(own)).or(other_side))
    }

    /// The first frame of a message; the others are pending.
    fn build_frames(&mut self, message: &LoggedMessage) -> Frame {
        let (id, other) = self.addresses(message);
        let is_response = message.is_response();
        let direction = if is_response { FrameFlags::RECEIVED } else { FrameFlags::TRANSMITTED };
        let frame = |bytes: &[u8]| Frame { flags: direction, ..padded_frame(id, bytes) };
        let data = &message.data;
        if let Ok(length @ 0..=7) = u8::try_from(data.len()) {
            return frame(&[&[length], data.as_slice()].concat());
        }
        let [.., high, low] = data.len().to_be_bytes();
        let (first, rest) = data.split_at_checked(6).unwrap_or((data, &[]));
        if let Some(other) = other {
            self.pending.push_back(padded_frame(other, &[0x30, 0, 0]));
        }
        for (part, number) in rest.chunks(7).zip((0..16_u8).cycle().skip(1)) {
            self.pending.push_back(frame(&[&[0x20 | number], part].concat()));
        }
        frame(&[&[0x10 | high, low], first].concat())
    }
}

/// A frame of eight bytes, as ISO 15765-4 requires.
fn padded_frame(id: CanId, bytes: &[u8]) -> Frame {
    let mut all = [FILLER; 8];
    for (slot, byte) in all.iter_mut().zip(bytes) {
        *slot = *byte;
    }
    Frame::data_frame(id, &all)
}

/// Identifier of the other side (ISO 15765-4): 7E0 and 7E8, or exchanged addresses.
fn opposite_address(id: CanId) -> Option<CanId> {
    match id.number() {
        number @ 0x7E0..=0x7E7 => parse_identifier(number + 8, false),
        number @ 0x7E8..=0x7EF => parse_identifier(number - 8, false),
        number if number >> 16 == 0x18DA => {
            let [_, _, to, from] = number.to_be_bytes();
            parse_identifier(u32::from_be_bytes([0x18, 0xDA, from, to]), true)
        }
        _ => None,
    }
}

impl LineFormat for MessageLog {
    const TITLE: &'static str = "log of UDS messages";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let found = parse_message(&without_colors(text), &mut self.tokens).filter(|found| found.is_marked);
        let Some(message) = found else {
            self.skipped.add_line("without a message", self.line);
            return Ok(None);
        };
        if message.service().is_none() {
            return Err("data: expected a service identifier of UDS".into());
        }
        assumptions.add_assumption(NO_FRAMES);
        if message.ids.is_empty() {
            assumptions.add_assumption(NO_IDENTIFIERS);
        }
        let meaning = message.time.map(|(_, meaning)| meaning);
        self.is_local = meaning == Some(TimeMeaning::LocalDate);
        let time = message.time.map(|(time, _)| match meaning {
            Some(TimeMeaning::OfDay) => self.days.elapsed_since_midnight(time),
            _ => time,
        });
        let frame = self.build_frames(&message);
        Ok(Some(ParsedLine::new(time, ONLY_BUS, frame)))
    }

    fn next_frame(&mut self) -> Option<Frame> {
        self.pending.pop_front()
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn time_origin(&self) -> TimeOrigin {
        if self.is_local { TimeOrigin::LocalDates } else { TimeOrigin::Universal }
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.skipped.report_lines(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::read_capture;

    /// Frames as `id#data`, without the notices.
    fn frames(text: &str) -> Vec<String> {
        assert!(is_message_log(text.as_bytes()), "{text}");
        let show = |frame: &Frame| {
            assert_eq!(frame.length, 8);
            let end = frame.data().iter().rposition(|byte| *byte != FILLER).map_or(0, |last| last + 1);
            let data =
                frame.data()[..end].iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
            format!("{}#{data}", frame.id)
        };
        read_capture(text.as_bytes()).frames.iter().map(show).collect()
    }

    /// Frames of ISO 15765-2: length 3; first frame of 20 bytes, flow control, consecutive frames 1 and 2; length 2 and 3.
    const FRAMES: [&str; 7] = [
        "7E0#0322F190",
        "7E8#101462F19057304C",
        "7E0#300000",
        "7E8#21303030303433 4D",
        "7E8#2242353431333236",
        "7E0#022701",
        "7E8#037F2737",
    ];

    #[test]
    fn messages_are_found_in_any_layout() {
        let vin = "62 F1 90 57 30 4C 30 30 30 30 34 33 4D 42 35 34 31 33 32 36";
        let packed = vin.replace(' ', "");
        let expected = FRAMES.map(|frame| frame.replace(' ', ""));
        for text in [
            format!(
                "[13:22:10.100] Tx 7E0 -> 22 F1 90\n[13:22:10.112] Rx 7E8 <- {vin}\n[13:22:10.200] Tx 7E0 -> 27 01\n[13:22:10.212] Rx 7E8 <- 7F 27 37\n"
            ),
            format!("Request: 22 F1 90\nResponse: {vin}\nRequest: 27 01\nResponse: 7F 27 37\n"),
            format!("Log of a tester\nSend: 22F190\nRecv: {packed}\nSend: 2701\nRecv: 7F2737\n"),
            format!(
                "2019-10-28 22:31:17,093 [DEBUG] Connection[ISOTP]: Sending 3 bytes : [b'22f190']\n2019-10-28 22:31:17,105 [DEBUG] Connection[ISOTP]: Received 20 bytes : [b'{}']\n2019-10-28 22:31:17,200 [DEBUG] Connection[ISOTP]: Sending 2 bytes : [b'2701']\n2019-10-28 22:31:17,201 [DEBUG] Connection[ISOTP]: Received 3 bytes : [b'7f2737']\n",
                packed.to_lowercase()
            ),
            format!(
                "0.100;Tx;0x7E0;3;22F190\n0.112;Rx;0x7E8;20;{packed}\n0.2;Tx;0x7E0;2;2701\n0.212;Rx;0x7E8;3;7F2737\n"
            ),
            format!("00 00 07 E0 22 F1 90\n00 00 07 E8 {vin}\n00 00 07 E0 27 01\n00 00 07 E8 7F 27 37\n"),
            format!("7E0->7E8 22 F1 90\n7E0->7E8 {vin}\n7E0->7E8 27 01\n7E0->7E8 7F 27 37\n"),
        ] {
            assert_eq!(frames(&text), expected, "{text}");
        }
    }

    #[test]
    fn times_and_addresses_of_29_bits_are_kept() {
        let text =
            "2024-05-01 13:22:10.250 18DA10F1 10 03\n2024-05-01 13:22:10.5 18DAF110 50 03 00 32 01 F4\n";
        assert_eq!(frames(text), ["18DA10F1#021003", "18DAF110#065003003201F4"]);
        let content = read_capture(text.as_bytes());
        // `date -u -d '2024-05-01 13:22:10' +%s`
        let times: Vec<_> = content.frames.iter().map(|frame| frame.time.unwrap().to_string()).collect();
        assert_eq!(times, ["1714569730.250000000", "1714569730.500000000"]);
        assert!(content.items.contains(&NO_FRAMES.to_owned()), "{:?}", content.items);
    }

    #[test]
    fn frames_and_other_bytes_are_not_messages() {
        for text in [
            // Frames of ISO-TP, with control information.
            "Tx 7E0 03 22 F1 90\nRx 7E8 10 14 62 F1 90 57 30 4C\nTx 7E0 30 00 00\n",
            "7DF 02 01 0C\n7E8 04 41 0C 1A F8\n",
            // SDO: 2F and 40 are answered by 60 and 43.
            "601 22 00 10 00 01 02 03 04\n581 60 00 10 00 00 00 00 00\n601 40 00 10 00 00 00 00 00\n581 43 00 10 00 92 01 02 00\n",
            "22 F1 90\n62 F1 90 57\n",
            "Tx 22 F1 90\nRx 62 F1 91 57\n",
            "Tx 22 F1 90\n",
            "",
        ] {
            assert!(!is_message_log(text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn other_lines_are_counted() {
        let valid = "Tx 10 03\nRx 50 03 00 32 01 F4\nTx 3E 00\nRx 7E 00\nTx 22 F1 90\nRx 62 F1 90 57\n";
        let text = format!("{valid}tester present\n{valid}Tx 99 01\n");
        let content = read_capture(text.as_bytes());
        assert_eq!(content.frames.len(), 12);
        let counted = |text: &str| content.items.iter().any(|item| item.contains(text));
        assert!(counted("line 14: data: expected a service identifier"), "{:?}", content.items);
        assert!(counted("1 line without a message skipped (first: line 7)"), "{:?}", content.items);
    }
}
