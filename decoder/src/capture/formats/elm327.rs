//! Sessions with an ELM327, STN11xx or compatible adapter, as a terminal stored them: commands at its prompt, and frames.
//!
//! ```text
//! >ATH1                                  a command; OK, ? and other words are its responses
//! >0100                                  a request, sent on 7DF unless AT SH sets another identifier
//! SEARCHING...
//! 7E8 06 41 00 BE 3E A8 13               a frame with its identifier (AT H1)
//! 18 DA F1 10 06 41 00 BE 3E A8 13       29 bits in four bytes
//! 7E8064100BE3EA813                      without spaces (AT S0)
//! 7E8 8 06 41 00 BE 3E A8 13 00          with its DLC (AT D1)
//! BUFFER FULL                            frames are lost
//! 41 00 BE 3E A8 13                      without identifiers (AT H0): not a frame
//! ```
//!
//! Source: ELM Electronics, ELM327 data sheet v2.2 (AT commands; "Interpreting trouble codes"; CAN message formats). A
//! request is a frame of eight bytes with a length byte in front and zeros behind (AT CAF1, the default); up to seven bytes
//! are sent. The last digit of an odd number is the number of responses to wait for.

use crate::capture::text::columns::{ColumnWords, NumberBase, parse_identifier};
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::{Batch, CaptureFormat};
use crate::frame::{CanId, Frame, FrameFlags};

const NO_TIMES: &str =
    "terminal of an ELM327 adapter: frames have no times; requests read as frames with a length byte";

const WITHOUT_IDENTIFIER: &str = "with bytes without identifier (AT H1 prints it)";
const RESPONSES: &str = "with commands or responses of the adapter";

/// Longest request in bytes; a longer one would need several frames.
const LONGEST_REQUEST: usize = 7;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "elm327",
    title: ElmSession::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_session,
    parser: |_| Box::new(LineParser::new(ElmSession::default())),
};

/// A command of the adapter, and a frame or a request; the frames alone have no sign of the program.
fn detect_session(head: &[u8]) -> bool {
    let mut session = ElmSession::default();
    let (mut has_sign, mut has_frame) = (false, false);
    is_proven(head, |line| {
        match session.classify(line) {
            ElmLine::Frame(..) | ElmLine::Request(..) => has_frame = true,
            ElmLine::Command => has_sign = true,
            ElmLine::Response => has_sign |= is_banner(line),
            ElmLine::Loss | ElmLine::Bytes => {}
            ElmLine::Other => return LineClass::Misfit,
        }
        if has_sign && has_frame { LineClass::Proof } else { LineClass::Related }
    })
}

/// Starts of responses, in upper case.
const RESPONSE_WORDS: &[&[u8]] = &[
    b"OK",
    b"?",
    b"SEARCHING",
    b"NO DATA",
    b"STOPPED",
    b"UNABLE TO CONNECT",
    b"BUS INIT",
    b"BUS BUSY",
    b"BUS ERROR",
    b"CAN ERROR",
    b"DATA ERROR",
    b"<DATA ERROR",
    b"<RX ERROR",
    b"FB ERROR",
    b"ERR",
    b"LV RESET",
    b"LP ALERT",
    b"ACT ALERT",
    b"AUTO",
    b"ISO 15765",
    b"SAE J1939",
    b"ELM327",
    b"STN",
    b"OBDLINK",
    b"OBDII",
    b"SCANTOOL",
    b"VLINKER",
    b"VGATE",
];

/// Names that a reset prints.
const BANNERS: &[&[u8]] = &[b"ELM327", b"STN1", b"STN2", b"OBDLINK"];

fn is_banner(line: &[u8]) -> bool {
    BANNERS.iter().any(|name| begins_with(line, name))
}

fn begins_with(line: &[u8], start: &[u8]) -> bool {
    line.get(..start.len()).is_some_and(|found| found.eq_ignore_ascii_case(start))
}

/// Content of a line.
enum ElmLine {
    Frame(Frame),
    /// Bytes typed at the prompt; up to [`LONGEST_REQUEST`].
    Request(Vec<u8>),
    /// `BUFFER FULL`: the adapter lost frames.
    Loss,
    Command,
    Response,
    /// Bytes of a response without its identifier.
    Bytes,
    Other,
}

/// State that affects later lines.
#[derive(Clone)]
struct ElmSession {
    /// Identifier of requests (AT SH).
    header: CanId,
    /// Whether requests get a length byte (AT CAF).
    has_formatting: bool,
    lost: bool,
    skipped: SkippedLines,
    line: u64,
}

impl Default for ElmSession {
    fn default() -> Self {
        Self {
            header: FUNCTIONAL,
            has_formatting: true,
            lost: false,
            skipped: SkippedLines::default(),
            line: 0,
        }
    }
}

/// Functional requests of OBD (ISO 15765-4), the default of the adapter with 11 and with 29 bits.
const FUNCTIONAL: CanId = CanId::Standard(0x7DF);
const FUNCTIONAL_29: CanId = CanId::Extended(0x18DB_33F1);

impl ElmSession {
    fn classify(&mut self, line: &[u8]) -> ElmLine {
        let line = line.trim_ascii();
        let at_prompt = line.starts_with(b">");
        let text = without_prompt(line);
        if text.is_empty() {
            return ElmLine::Command;
        }
        if self.take_command(text) {
            return ElmLine::Command;
        }
        if at_prompt {
            return typed_request(text).map_or(ElmLine::Other, ElmLine::Request);
        }
        if begins_with(text, b"BUFFER FULL") {
            return ElmLine::Loss;
        }
        if RESPONSE_WORDS.iter().any(|word| begins_with(text, word)) {
            return ElmLine::Response;
        }
        match parse_frame(text) {
            Some(frame) => ElmLine::Frame(frame),
            None if is_bytes(text) => ElmLine::Bytes,
            None => ElmLine::Other,
        }
    }

    /// Executes a command that begins with AT or ST.
    fn take_command(&mut self, text: &[u8]) -> bool {
        let word: Vec<u8> = text.iter().filter(|byte| **byte != b' ').map(u8::to_ascii_uppercase).collect();
        let Some(command) = command_of(&word) else { return false };
        match command {
            [b'S', b'H', digits @ ..] => self.set_header(digits),
            b"CAF0" => self.has_formatting = false,
            b"CAF1" | b"Z" | b"D" | b"WS" => self.has_formatting = true,
            [b'S' | b'T', b'P', number @ ..] => {
                // Protocols 7 and 9 have 29 bits (ISO 15765-4).
                let is_long = matches!(number.strip_prefix(b"A").unwrap_or(number), b"7" | b"9");
                self.header = if is_long { FUNCTIONAL_29 } else { FUNCTIONAL };
            }
            _ => {}
        }
        true
    }

    /// Sets the identifier of requests: three, six or eight digits; six are the lower bytes of 29 bits.
    fn set_header(&mut self, digits: &[u8]) {
        const PRIORITY: u32 = 0x1800_0000;
        let Some(number) = NumberBase::Hex.parse_number(digits) else { return };
        let id = match digits.len() {
            3 => parse_identifier(number, false),
            6 => parse_identifier(number | PRIORITY, true),
            8 => parse_identifier(number, true),
            _ => None,
        };
        self.header = id.unwrap_or(self.header);
    }

    /// The frame that the adapter sends for a request.
    fn request_frame(&self, bytes: &[u8]) -> Frame {
        let mut data = [0_u8; 8];
        let frame =
            |data: &[u8]| Frame { flags: FrameFlags::TRANSMITTED, ..Frame::data_frame(self.header, data) };
        if !self.has_formatting {
            return frame(bytes);
        }
        let [length, rest @ ..] = &mut data;
        *length = u8::try_from(bytes.len()).unwrap_or(0);
        for (slot, byte) in rest.iter_mut().zip(bytes) {
            *slot = *byte;
        }
        frame(&data)
    }
}

/// Commands of the ELM327 after AT; hex digits may follow.
const ELM_COMMANDS: &[&[u8]] = &[
    b"@", b"AL", b"AMC", b"AMT", b"AR", b"AT", b"BD", b"BI", b"BRD", b"BRT", b"CAF", b"CEA", b"CER", b"CF",
    b"CFC", b"CM", b"CP", b"CRA", b"CS", b"CSM", b"CTM", b"CV", b"D", b"DM", b"DP", b"DPN", b"E", b"FC",
    b"FCSD", b"FCSH", b"FCSM", b"FE", b"FI", b"FT", b"H", b"I", b"IB", b"IFR", b"IGN", b"IIA", b"JE", b"JHF",
    b"JS", b"JTM", b"KW", b"L", b"LP", b"M", b"MA", b"MP", b"MR", b"MT", b"NL", b"PB", b"PC", b"PP", b"PPS",
    b"R", b"RA", b"RD", b"RTR", b"RV", b"S", b"SD", b"SH", b"SI", b"SP", b"SPA", b"SR", b"SS", b"ST", b"SW",
    b"TA", b"TP", b"TPA", b"V", b"WM", b"WS", b"Z",
];

/// Commands of STN adapters after ST (OBD Solutions, "STN1100 family reference manual"); parameters may follow after digits.
const STN_COMMANDS: &[&[u8]] = &[
    b"I", b"DI", b"SN", b"M", b"MA", b"P", b"PTO", b"PC", b"PR", b"PX", b"FA", b"FAC", b"FAP", b"FB", b"FBA",
    b"FP", b"FFCA", b"CSWM", b"CMM", b"CAFCP", b"BR", b"SLCS", b"VR", b"WBR",
];

/// The command after AT or ST, if it is known: its letters, then digits.
fn command_of(word: &[u8]) -> Option<&[u8]> {
    let is_known = |names: &[&[u8]], command: &[u8]| {
        names.iter().any(|name| {
            let digits = command.strip_prefix(*name);
            digits.is_some_and(|digits| {
                digits.iter().all(|byte| byte.is_ascii_hexdigit() || matches!(byte, b',' | b':'))
            })
        })
    };
    if let Some(command) = word.strip_prefix(b"AT") {
        return is_known(ELM_COMMANDS, command).then_some(command);
    }
    let command = word.strip_prefix(b"ST")?;
    is_known(STN_COMMANDS, command).then_some(command)
}

/// The line without marks of the prompt and spaces at its start.
fn without_prompt(line: &[u8]) -> &[u8] {
    let is_mark = |byte: &u8| *byte == b'>' || byte.is_ascii_whitespace();
    let start = line.iter().position(|byte| !is_mark(byte)).unwrap_or(line.len());
    line.get(start..).unwrap_or_default()
}

/// Bytes typed at the prompt: pairs of digits, and an optional digit that limits the responses.
fn typed_request(text: &[u8]) -> Option<Vec<u8>> {
    let digits: Vec<u8> = text.iter().copied().filter(|byte| *byte != b' ').collect();
    if !digits.iter().all(u8::is_ascii_hexdigit) {
        return None;
    }
    let bytes: Option<Vec<u8>> =
        digits.chunks_exact(2).map(|pair| NumberBase::Hex.parse_byte(pair)).collect();
    bytes.filter(|bytes| (1..=LONGEST_REQUEST).contains(&bytes.len()))
}

/// Whether all words are bytes, or the line is a part of a long response: `0: 49 02 01`, `014`.
fn is_bytes(text: &[u8]) -> bool {
    let mut words = ColumnWords::new(text).peekable();
    if let Some(part) = words.next_if(|word| word.ends_with(b":")) {
        return part.len() == 2 && words.all(is_pairs);
    }
    text.len() == 3 && text.iter().all(u8::is_ascii_hexdigit) || words.all(is_pairs)
}

fn is_pairs(word: &[u8]) -> bool {
    word.len().is_multiple_of(2) && word.iter().all(u8::is_ascii_hexdigit)
}

/// Parses a frame with an identifier of three digits, of eight digits, or of four pairs.
fn parse_frame(text: &[u8]) -> Option<Frame> {
    let words: Vec<&[u8]> = ColumnWords::new(text).collect();
    if !words.iter().all(|word| word.iter().all(u8::is_ascii_hexdigit)) {
        return None;
    }
    let (id, data) = match words.as_slice() {
        [id, rest @ ..] if id.len() == 3 && !rest.is_empty() => (identifier(id)?, pairs(rest)?),
        [id, rest @ ..] if id.len() == 8 && !rest.is_empty() => (identifier(id)?, pairs(rest)?),
        [word] if word.len() % 2 == 1 => {
            let (id, rest) = word.split_at_checked(3)?;
            (identifier(id)?, bytes_of(rest)?)
        }
        [word] if word.len() > 8 => {
            let (id, rest) = word.split_at_checked(8)?;
            (identifier(id).filter(is_diagnostic)?, bytes_of(rest)?)
        }
        [a, b, c, d, rest @ ..] if [a, b, c, d].iter().all(|word| word.len() == 2) && !rest.is_empty() => {
            let id = [*a, *b, *c, *d].concat();
            (identifier(&id).filter(is_diagnostic)?, pairs(rest)?)
        }
        _ => return None,
    };
    let frame = Frame::data_frame(id, &data);
    (1..=8).contains(&data.len()).then_some(Frame { flags: FrameFlags::RECEIVED, ..frame })
}

fn identifier(digits: &[u8]) -> Option<CanId> {
    parse_identifier(NumberBase::Hex.parse_number(digits)?, digits.len() == 8)
}

/// Whether an identifier without its own column is one of diagnostics (ISO 15765-2) or J1939: priority 3 or 6. Else it
/// could be the data of a response without identifier.
fn is_diagnostic(id: &CanId) -> bool {
    matches!(id.number() >> 24, 0x0C | 0x18 | 0x1C)
}

/// Bytes of words of two digits; a single digit before them is the DLC.
fn pairs(words: &[&[u8]]) -> Option<Vec<u8>> {
    let words = match words {
        [[dlc], rest @ ..] if usize::from(NumberBase::Hex.parse_byte(&[*dlc])?) == rest.len() => rest,
        words => words,
    };
    match words {
        [word] if word.len() > 2 => bytes_of(word),
        words => {
            words.iter().map(|word| NumberBase::Hex.parse_byte(word).filter(|_| word.len() == 2)).collect()
        }
    }
}

fn bytes_of(digits: &[u8]) -> Option<Vec<u8>> {
    let bytes = digits.chunks(2).map(|pair| NumberBase::Hex.parse_byte(pair).filter(|_| pair.len() == 2));
    bytes.collect()
}

impl LineFormat for ElmSession {
    const TITLE: &'static str = "ELM327 session";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let frame = match self.classify(text) {
            ElmLine::Frame(frame) => frame,
            ElmLine::Request(bytes) => self.request_frame(&bytes),
            ElmLine::Loss => {
                self.lost = true;
                return Ok(None);
            }
            ElmLine::Command | ElmLine::Response => {
                self.skipped.add_line(RESPONSES, self.line);
                return Ok(None);
            }
            ElmLine::Bytes => {
                self.skipped.add_line(WITHOUT_IDENTIFIER, self.line);
                return Ok(None);
            }
            ElmLine::Other => return Err("expected an identifier and bytes, or a word of the adapter".into()),
        };
        assumptions.add_assumption(NO_TIMES);
        let lost = std::mem::take(&mut self.lost);
        Ok(Some(ParsedLine { lost, ..ParsedLine::new(None, ONLY_BUS, frame) }))
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.skipped.report_lines(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::{read_capture, read_in_pieces};

    const SESSION: &str = "ATZ\r\n\r\nELM327 v1.5\r\n\r\n>ATH1\r\nOK\r\n\r\n>0100\r\nSEARCHING...\r\n\
        7E8 06 41 00 BE 3E A8 13\r\n7E9 06 41 00 88 18 00 10\r\n\r\n>ATSH7E0\r\nOK\r\n>22 F1 90 1\r\n\
        7E8 10 14 62 F1 90 57 30 4C\r\n\r\n>";

    #[test]
    fn requests_and_responses() {
        let whole = read_capture(SESSION.as_bytes());
        assert_eq!(whole, read_in_pieces(SESSION.as_bytes(), &[1, 9, 4]));
        assert_eq!(
            whole.items,
            [
                NO_TIMES,
                "{1} bus0 7DF#0201000000000000 flags=20 dlc=0",
                "{2} bus0 7E8#064100BE3EA813 flags=40 dlc=0",
                "{3} bus0 7E9#06410088180010 flags=40 dlc=0",
                "{4} bus0 7E0#0322F19000000000 flags=20 dlc=0",
                "{5} bus0 7E8#101462F19057304C flags=40 dlc=0",
                "8 lines with commands or responses of the adapter skipped (first: line 1)",
            ]
        );
    }

    #[test]
    fn frames_in_every_form() {
        for (line, expected) in [
            ("7E8064100BE3EA813", "7E8#064100BE3EA813"),
            ("7E8 8 06 41 00 BE 3E A8 13 00", "7E8#064100BE3EA81300"),
            ("18 DA F1 10 03 41 0C 00", "18DAF110#03410C00"),
            ("18DAF110 03 41 0C 00", "18DAF110#03410C00"),
            ("18DAF11003410C00", "18DAF110#03410C00"),
            ("7E8 0641", "7E8#0641"),
        ] {
            let frame = parse_frame(line.as_bytes()).unwrap();
            let found = format!("{frame:?}");
            assert!(found.contains(&format!("{expected} ")), "{line}: {found}");
        }
        for line in [
            "41 00 BE 3E A8 13",
            "014",
            "0: 49 02 01",
            "800 01",
            "7E8 1",
            "7E8 01 02 03 04 05 06 07 08 09",
            "x",
        ] {
            assert!(parse_frame(line.as_bytes()).is_none(), "{line}");
        }
    }

    #[test]
    fn commands_change_requests_and_losses_are_reported() {
        let text = ">ATSP7\r>ATCAF0\r>02 01 0C\r>ATMA\r18 DA F1 10 03 41 0C 00\rBUFFER FULL\r\
                    18 DA F1 10 03 41 0C 00\r41 00 BE 3E\r18DAF110 03 41 0C 01\r>0123456789ABCDEF\r";
        let items = read_capture(text.as_bytes()).items;
        assert_eq!(
            items[1..],
            [
                "{1} bus0 18DB33F1#02010C flags=20 dlc=0",
                "{2} bus0 18DAF110#03410C00 flags=40 dlc=0",
                "line 7: frames lost",
                "{3} bus0 18DAF110#03410C00 flags=40 dlc=0",
                "{4} bus0 18DAF110#03410C01 flags=40 dlc=0",
                "line 10: expected an identifier and bytes, or a word of the adapter; found \">0123456789ABCDEF\"",
                "3 lines with commands or responses of the adapter skipped (first: line 1)",
                "1 line with bytes without identifier (AT H1 prints it) skipped (first: line 8)",
            ]
        );
    }

    #[test]
    fn frames_alone_and_quoted_texts_have_no_sign_of_the_program() {
        assert!(detect_session(SESSION.as_bytes()));
        assert!(detect_session(b"ELM327 v2.1\n7E8 03 41 0C 00\n"));
        for other in [
            "7E8 06 41 00 BE 3E A8 13\n",
            "> 7E8 06 41 00 BE 3E A8 13\n> ATMA\n",
            ">ATH1\nOK\n",
            "ATTENTION PLEASE READ THIS TEXT FIRST\n7E8 06\n",
            "ATTENTION\n>0100\n",
            "Status:\n>0100\n7E8 06 41 00\n",
            "",
        ] {
            assert!(!detect_session(other.as_bytes()), "{other}");
        }
    }
}
