//! The text protocol of socketcand, a server for the CAN interfaces of a Linux machine over TCP.
//!
//! ```text
//! server                                      client
//! < hi >                                      < open can0 >
//! < ok >                                      < rawmode >
//! < ok >
//! < frame 123 1700000000.123456 1122 >        server time, in seconds since 1970
//! < frame 18FEF100 1700000000.123456 >        eight digits: a 29-bit identifier
//! < fdframe 123 05 1700000000.123456 11 >     flags as in Linux' struct canfd_frame
//! < rtr 123 1700000000.123456 4 >             remote frame and its length
//! < error 004 1700000000.123456 >             error frame: classes only, without its data
//! < error could not open bus >                any other text after "error" is a message to the client
//! ```
//!
//! Sources: doc/protocol.md and state_raw.c of linux-can/socketcand. The document has spaces between data
//! bytes, the program writes none: both are accepted.

use super::{PendingReply, parse_hexadecimal};
use crate::capture::text::columns::{self, ColumnWords};
use crate::capture::text::lines::line_excerpt;
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, Timestamp, is_fd_length};

/// Longest accepted element, in bytes between its brackets; an FD frame with spaces has 240.
pub(crate) const LONGEST_ELEMENT: usize = 512;

/// Longest name of a bus in bytes: the limit of Linux interface names.
pub const LONGEST_NAME: usize = 15;

/// Valid name of a bus to open: it cannot end the element that contains it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusName(String);

impl BusName {
    /// Accepts 1 to [`LONGEST_NAME`] printable ASCII characters without space, `<`, `>` or `/`.
    pub fn new(name: &str) -> Option<Self> {
        let is_plain = |byte: u8| byte.is_ascii_graphic() && !b"<>/".contains(&byte);
        ((1..=LONGEST_NAME).contains(&name.len()) && name.bytes().all(is_plain)).then(|| Self(name.into()))
    }

    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Requests to a server. None of them sends a frame, and none that does can be constructed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SocketcandRequest {
    /// Open a bus.
    Open(BusName),
    /// Forward every frame from now on.
    RawMode,
    /// Respond at once, even if the bus is silent; detects a dead connection.
    Echo,
}

impl SocketcandRequest {
    /// The text to write: one complete element.
    pub fn to_text(&self) -> String {
        match self {
            Self::Open(BusName(name)) => format!("< open {name} >"),
            Self::RawMode => "< rawmode >".into(),
            Self::Echo => "< echo >".into(),
        }
    }
}

/// A reply of a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SocketcandReply {
    /// Greeting: the server is a socketcand and waits for a request.
    Hi,
    /// The last request was executed.
    Ok,
    /// Response to [`SocketcandRequest::Echo`].
    Echo,
    /// A frame with the server's time, without number, on bus 0.
    Frame(Frame),
    /// Error message of the server, already escaped.
    Error(String),
    /// An unknown element: the text found and the text expected, already escaped.
    Unreadable(String),
}

/// Parses a server's output, which may arrive in pieces of any size.
#[derive(Debug, Clone, Default)]
pub struct SocketcandReader {
    begun: PendingReply,
    is_inside: bool,
}

impl SocketcandReader {
    /// Parses `input`, the continuation of the previous input, and passes each complete reply to `give`.
    pub fn read_input(&mut self, input: &[u8], mut give: impl FnMut(SocketcandReply)) {
        let mut rest = input;
        while let Some(end) = memchr::memchr2(b'<', b'>', rest) {
            let (piece, behind) = rest.split_at_checked(end).unwrap_or((rest, &[]));
            self.begun.append_piece(piece, LONGEST_ELEMENT);
            let is_opening = behind.first() == Some(&b'<');
            self.complete_element(is_opening, &mut give);
            self.begun.clear();
            self.is_inside = is_opening;
            rest = behind.get(1..).unwrap_or_default();
        }
        self.begun.append_piece(rest, LONGEST_ELEMENT);
    }

    /// Handles the text before a bracket: an element, or unexpected text between elements.
    fn complete_element(&self, is_opening: bool, give: &mut impl FnMut(SocketcandReply)) {
        let text = self.begun.bytes.trim_ascii();
        let unreadable = |what: &str| {
            SocketcandReply::Unreadable(format!("socketcand: {what}; found {}", line_excerpt(text)))
        };
        if self.begun.is_too_long {
            return give(unreadable("element too long (max 512 bytes)"));
        }
        match (self.is_inside, is_opening) {
            (true, false) => give(parse_element(text).unwrap_or_else(unreadable)),
            (false, true) if text.is_empty() => {}
            (true, true) => give(unreadable("incomplete element")),
            (false, _) => give(unreadable("expected nothing between elements")),
        }
    }
}

/// Parses the text between `<` and `>`.
fn parse_element(text: &[u8]) -> Result<SocketcandReply, &'static str> {
    let mut words = ColumnWords::new(text);
    match words.next().unwrap_or_default() {
        b"hi" => Ok(SocketcandReply::Hi),
        b"ok" => Ok(SocketcandReply::Ok),
        b"echo" => Ok(SocketcandReply::Echo),
        b"frame" => parse_classic(words).map(SocketcandReply::Frame),
        b"fdframe" => parse_fd(words).map(SocketcandReply::Frame),
        b"rtr" => parse_remote(words).map(SocketcandReply::Frame),
        b"error" => Ok(match error_frame(words.clone()) {
            Some(frame) => SocketcandReply::Frame(frame),
            None => SocketcandReply::Error(words.remaining_text().trim_ascii().escape_ascii().to_string()),
        }),
        _ => Err("expected hi, ok, echo, frame, fdframe, rtr or error"),
    }
}

const ID: &str = "identifier: expected 3 hex digits up to 7FF or 8 up to 1FFFFFFF";
const TIME: &str = "time: expected seconds.microseconds";
const DATA: &str = "data: expected pairs of hex digits, at most 8, or 64 of an FD frame";

/// An empty frame with the identifier `word`.
fn begin_frame(word: Option<&[u8]>, flags: FrameFlags) -> Result<Frame, &'static str> {
    let word = word.unwrap_or_default();
    let number = parse_hexadecimal(word).filter(|_| matches!(word.len(), 3 | 8)).ok_or(ID)?;
    let id = columns::parse_identifier(number, word.len() == 8).ok_or(ID)?;
    Ok(Frame { id, flags, ..Frame::EMPTY })
}

fn parse_time(word: Option<&[u8]>) -> Option<Timestamp> {
    columns::parse_time(word?, 1_000_000_000).map(Timestamp)
}

/// Reads the remaining data, with or without spaces between its bytes.
fn take_data(frame: &mut Frame, words: ColumnWords<'_>, limit: usize) -> Result<(), &'static str> {
    let mut length = 0;
    for word in words {
        if word.len() % 2 != 0 {
            return Err(DATA);
        }
        for digits in word.chunks_exact(2) {
            let byte = parse_hexadecimal(digits).and_then(|byte| u8::try_from(byte).ok()).ok_or(DATA)?;
            *frame.bytes.get_mut(..limit).and_then(|bytes| bytes.get_mut(length)).ok_or(DATA)? = byte;
            length += 1;
        }
    }
    frame.length = u8::try_from(length).map_err(|_| DATA)?;
    Ok(())
}

fn parse_classic(mut words: ColumnWords<'_>) -> Result<Frame, &'static str> {
    let mut frame = begin_frame(words.next(), FrameFlags(0))?;
    frame.time = Some(parse_time(words.next()).ok_or(TIME)?);
    take_data(&mut frame, words, 8)?;
    Ok(frame)
}

fn parse_fd(mut words: ColumnWords<'_>) -> Result<Frame, &'static str> {
    const BIT_RATE_SWITCH: u32 = 1;
    const ERROR_STATE: u32 = 2;
    let mut frame = begin_frame(words.next(), FrameFlags::FD)?;
    let flags = words.next().and_then(parse_hexadecimal).filter(|flags| *flags <= 0xFF);
    let flags = flags.ok_or("flags: expected two hex digits")?;
    if flags & BIT_RATE_SWITCH != 0 {
        frame.flags = frame.flags.with(FrameFlags::BIT_RATE_SWITCH);
    }
    if flags & ERROR_STATE != 0 {
        frame.flags = frame.flags.with(FrameFlags::ERROR_STATE);
    }
    frame.time = Some(parse_time(words.next()).ok_or(TIME)?);
    take_data(&mut frame, words, MAX_DATA)?;
    if !is_fd_length(frame.length) {
        return Err("data: expected 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes");
    }
    Ok(frame)
}

fn parse_remote(mut words: ColumnWords<'_>) -> Result<Frame, &'static str> {
    let mut frame = begin_frame(words.next(), FrameFlags::REMOTE)?;
    frame.time = Some(parse_time(words.next()).ok_or(TIME)?);
    let length = match words.next() {
        Some([digit @ b'0'..=b'8']) => digit - b'0',
        _ => return Err("length of a remote frame: expected 0 to 8"),
    };
    frame.length = length;
    words.next().is_none().then_some(frame).ok_or("after the length of a remote frame: expected nothing")
}

/// Parses an error frame: classes and a time. `None` for an error message in text form.
fn error_frame(mut words: ColumnWords<'_>) -> Option<Frame> {
    let classes = parse_hexadecimal(words.next()?).filter(|classes| *classes <= 0x1FFF_FFFF)?;
    let time = parse_time(words.next())?;
    let frame = Frame {
        id: CanId::from_extended(classes),
        flags: FrameFlags::ERROR,
        time: Some(time),
        ..Frame::EMPTY
    };
    words.next().is_none().then_some(frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn replies(text: &[u8], size: usize) -> Vec<SocketcandReply> {
        let (mut reader, mut found) = (SocketcandReader::default(), Vec::new());
        for piece in text.chunks(size) {
            reader.read_input(piece, |reply| found.push(reply));
        }
        found
    }

    fn one(text: &str) -> SocketcandReply {
        let found = replies(text.as_bytes(), usize::MAX);
        let [reply] = &found[..] else { panic!("{text:?} gave {found:?}") };
        reply.clone()
    }

    fn frame(id: CanId, flags: FrameFlags, nanoseconds: i64, data: &[u8]) -> Frame {
        Frame { flags, time: Some(Timestamp(nanoseconds)), ..Frame::data_frame(id, data) }
    }

    #[test]
    fn frames_as_the_document_and_as_the_program_writes_them() {
        let expected =
            frame(CanId::from_standard(0x123), FrameFlags(0), 23_424_242_000, &[0x11, 0x22, 0x33, 0x44]);
        assert_eq!(one("< frame 123 23.424242 11 22 33 44 >"), SocketcandReply::Frame(expected));
        assert_eq!(one("< frame 123 23.424242 11223344 >"), SocketcandReply::Frame(expected));
        let expected = frame(CanId::from_extended(0x123), FrameFlags(0), 1_700_000_000_123_456_000, &[]);
        assert_eq!(one("< frame 00000123 1700000000.123456  >"), SocketcandReply::Frame(expected));
    }

    #[test]
    fn remote_fd_and_error_frames() {
        let mut expected = frame(CanId::from_standard(0x123), FrameFlags::REMOTE, 23_424_242_000, &[]);
        expected.length = 4;
        assert_eq!(one("< rtr 123 23.424242 4 >"), SocketcandReply::Frame(expected));
        let flags = FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE);
        let expected = frame(CanId::from_extended(0x18FE_F100), flags, 1_500_000_000, &[0xA5; 12]);
        let text = format!("< fdframe 18FEF100 07 1.500000 {} >", "A5".repeat(12));
        assert_eq!(one(&text), SocketcandReply::Frame(expected));
        let text = format!("< fdframe 001 00 1.500000{} >", " a5".repeat(64));
        let expected = frame(CanId::from_standard(1), FrameFlags::FD, 1_500_000_000, &[0xA5; 64]);
        assert_eq!(one(&text), SocketcandReply::Frame(expected));
        let expected = frame(CanId::from_extended(0x004), FrameFlags::ERROR, 1_700_000_000_000_001_000, &[]);
        assert_eq!(one("< error 004 1700000000.000001 >"), SocketcandReply::Frame(expected));
    }

    #[test]
    fn a_connection_from_its_greeting_on() {
        let found = replies(b"< hi >< ok ><ok>\n< echo >< error could not open bus >", usize::MAX);
        let complaint = SocketcandReply::Error("could not open bus".into());
        assert_eq!(
            found,
            [SocketcandReply::Hi, SocketcandReply::Ok, SocketcandReply::Ok, SocketcandReply::Echo, complaint]
        );
        assert_eq!(one("< error \x1b[2J >"), SocketcandReply::Error("\\x1b[2J".into()));
        assert_eq!(one("< error 004 >"), SocketcandReply::Error("004".into()));
    }

    #[test]
    fn unreadable_input_is_reported_with_its_start() {
        for (text, reason) in [
            ("< frame 1234 1.0 >", format!("{ID}; found \"frame 1234 1.0\"")),
            ("< frame 800 1.0 >", format!("{ID}; found \"frame 800 1.0\"")),
            ("< frame >", format!("{ID}; found \"frame\"")),
            ("< frame 123 x >", format!("{TIME}; found \"frame 123 x\"")),
            ("< frame 123 1.0 1 >", format!("{DATA}; found \"frame 123 1.0 1\"")),
            ("< frame 123 1.0 112233445566778899 >", format!("{DATA}; found \"frame 123 1.0 112233445566778899\"")),
            ("< rtr 123 1.0 9 >", "length of a remote frame: expected 0 to 8; found \"rtr 123 1.0 9\"".into()),
            ("< fdframe 123 1.0 >", "flags: expected two hex digits; found \"fdframe 123 1.0\"".into()),
            ("< fdframe 123 01 1.0 112233445566778899 >",
             "data: expected 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes; found \"fdframe 123 01 1.0 112233445566778899\"".into()),
            ("< >", "expected hi, ok, echo, frame, fdframe, rtr or error; found \"\"".into()),
            ("< frame 123 < ", "incomplete element; found \"frame 123\"".into()),
            ("\x1b <", "expected nothing between elements; found \"\\x1b\"".into()),
            (">", "expected nothing between elements; found \"\"".into()),
        ] {
            assert_eq!(one(text), SocketcandReply::Unreadable(format!("socketcand: {reason}")), "{text}");
        }
    }

    #[test]
    fn an_element_without_end_takes_no_memory() {
        let mut reader = SocketcandReader::default();
        reader.read_input(b"< frame ", |reply| panic!("{reply:?}"));
        (0..1_000).for_each(|_| reader.read_input(&[b'x'; 1_000], |reply| panic!("{reply:?}")));
        assert_eq!(reader.begun.bytes.len(), LONGEST_ELEMENT);
        let mut found = Vec::new();
        reader.read_input(b"> < ok >", |reply| found.push(reply));
        let [SocketcandReply::Unreadable(reason), SocketcandReply::Ok] = &found[..] else {
            panic!("{found:?}")
        };
        assert!(
            reason.starts_with("socketcand: element too long (max 512 bytes); found \"frame xxx"),
            "{reason}"
        );
    }

    #[test]
    fn pieces_do_not_matter() {
        let text =
            b"< hi >\r\n< ok >x< frame 123 1.5 1122 >< error bus >< fdframe 123 00 2 >> < rtr < ok >< fr";
        let whole = replies(text, usize::MAX);
        assert_eq!(whole.len(), 9, "{whole:?}");
        for size in 1..text.len() {
            assert_eq!(replies(text, size), whole, "pieces of {size}");
        }
    }

    /// A server sends frames only on `send`, `add`, `update`, `sendrtr`, `fdsend` and `sendpdu`.
    #[test]
    fn no_request_sends_a_frame_whatever_the_name_of_the_bus() {
        assert_eq!(SocketcandRequest::Open(BusName::new("can0").unwrap()).to_text(), "< open can0 >");
        assert_eq!(SocketcandRequest::RawMode.to_text(), "< rawmode >");
        assert_eq!(SocketcandRequest::Echo.to_text(), "< echo >");
        let hostile =
            ["", "can0 >< send 123 0", "can0 1 B", "a\nb", "<", ">", "a/b", "name-of-16-bytes", "kännel"];
        for name in hostile {
            assert_eq!(BusName::new(name), None, "{name}");
        }
        assert_eq!(BusName::new("name-of-15-byte").unwrap().as_str(), "name-of-15-byte");
    }
}
