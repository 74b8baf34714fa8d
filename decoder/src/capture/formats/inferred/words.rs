//! Meaning of words: names of columns, directions, frame types, buses, units.

use crate::capture::column_list::{ColumnRole, ColumnUnit};
use crate::frame::FrameFlags;

/// Names of columns in lower case without spaces and punctuation, in English, German, French, Spanish and Chinese.
const NAMES: &[(ColumnRole, &[&str])] = &[
    (
        ColumnRole::Id,
        &[
            "id",
            "canid",
            "cobid",
            "identifier",
            "ident",
            "arbitrationid",
            "arbid",
            "arbitration",
            "msgid",
            "messageid",
            "frameid",
            "pid",
            "stdid",
            "extid",
            "standardid",
            "extendedid",
            "idhex",
            "iddec",
            "kennung",
            "identifikator",
            "nachrichtid",
            "botschaftsid",
            "identifiant",
            "identificador",
            "id号",
            "帧id",
            "标识符",
            "报文id",
        ],
    ),
    (
        ColumnRole::Length,
        &[
            "dlc",
            "len",
            "length",
            "dl",
            "datalength",
            "datalen",
            "dlen",
            "msglen",
            "framelength",
            "numbytes",
            "nbytes",
            "size",
            "lng",
            "länge",
            "laenge",
            "datenlänge",
            "datenlaenge",
            "longueur",
            "taille",
            "longitud",
            "长度",
            "数据长度",
        ],
    ),
    (
        ColumnRole::Data,
        &[
            "data",
            "databytes",
            "datafield",
            "payload",
            "bytes",
            "byte",
            "hexdata",
            "datahex",
            "datadec",
            "rawdata",
            "daten",
            "datenbytes",
            "nutzdaten",
            "données",
            "donnees",
            "datos",
            "数据",
            "数据hex",
        ],
    ),
    (
        ColumnRole::Time,
        &[
            "time",
            "timestamp",
            "ts",
            "abstime",
            "reltime",
            "absolutetime",
            "relativetime",
            "timeoffset",
            "offset",
            "systemtime",
            "uptime",
            "timescale",
            "zeit",
            "zeitstempel",
            "uhrzeit",
            "temps",
            "heure",
            "horodatage",
            "tiempo",
            "hora",
            "时间",
            "时间标识",
            "时间戳",
            "系统时间",
        ],
    ),
    (
        ColumnRole::Delta,
        &["delta", "deltatime", "timedelta", "diff", "dt", "difftime", "timediff", "deltat", "zeitdifferenz"],
    ),
    (ColumnRole::Date, &["date", "datum", "fecha", "日期"]),
    (
        ColumnRole::Direction,
        &["dir", "direction", "rxtx", "txrx", "tr", "richtung", "sens", "传输方向", "方向", "收发"],
    ),
    (
        ColumnRole::Bus,
        &[
            "bus",
            "ch",
            "chn",
            "chan",
            "channel",
            "canchannel",
            "can",
            "canbus",
            "kanal",
            "interface",
            "iface",
            "port",
            "network",
            "netz",
            "canal",
            "通道",
            "can通道",
            "通道号",
            "源通道",
        ],
    ),
    (
        ColumnRole::Kind,
        &[
            "type",
            "frametype",
            "msgtype",
            "format",
            "frameformat",
            "flags",
            "typ",
            "art",
            "stdext",
            "帧类型",
            "帧格式",
            "can类型",
        ],
    ),
    (ColumnRole::Extended, &["extended", "ext", "ide", "isextended", "xtd", "eff"]),
    (ColumnRole::Remote, &["rtr", "remote", "isremote"]),
    (
        ColumnRole::Counter,
        &[
            "no", "nr", "num", "number", "idx", "index", "count", "counter", "seq", "line", "lfdnr", "序号",
            "cnt", "msgno",
        ],
    ),
    (
        ColumnRole::Skip,
        &[
            "name",
            "message",
            "messagename",
            "msg",
            "comment",
            "remark",
            "kommentar",
            "bemerkung",
            "ascii",
            "text",
            "node",
            "sender",
            "receiver",
            "description",
            "parsername",
            "parserflags",
            "default",
            "名称",
            "cycle",
            "cycletime",
            "period",
            "zyklus",
            "zykluszeit",
            "symbol",
            "status",
            "crc",
            "esi",
            "brs",
        ],
    ),
];

/// Name of a column and what it states in addition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::capture::formats) struct ColumnName {
    /// Content of the column.
    pub(in crate::capture::formats) role: ColumnRole,
    /// Unit of a time.
    pub(super) unit: Option<ColumnUnit>,
    /// Whether numbers are decimal; `None` if the name does not state it.
    pub(super) is_decimal: Option<bool>,
    /// Number of a byte, such as 3 of `D3`.
    pub(super) byte: Option<u8>,
}

/// Parses the name of a column; `None` if it is unknown.
pub(in crate::capture::formats) fn column_name(text: &[u8]) -> Option<ColumnName> {
    // GBK and other encodings are not decoded: a head in them has no known names.
    let text = std::str::from_utf8(text).ok().filter(|text| text.len() <= 60)?.to_lowercase();
    let mut found = ColumnName::default();
    let is_separator = |letter: char| {
        letter.is_whitespace()
            || matches!(letter, '(' | ')' | '[' | ']' | '_' | '"' | ':' | '=' | '/' | '{' | '}')
    };
    let mut plain = String::new();
    for (index, word) in text.split(is_separator).filter(|word| !word.is_empty()).enumerate() {
        let word = word.trim_end_matches(['.', '#']);
        match (ColumnUnit::of_word(word), word) {
            (Some(unit), _) if index > 0 => found.unit = Some(unit),
            (_, "hex" | "hexadecimal") if index > 0 => found.is_decimal = Some(false),
            (_, "dec" | "decimal" | "dezimal" | "dez") if index > 0 => found.is_decimal = Some(true),
            (_, "0x" | "h") if index > 0 => {}
            _ => plain.push_str(word),
        }
    }
    plain.retain(|letter| !matches!(letter, '-' | '.'));
    for (start, is_decimal) in [("hex", false), ("dec", true)] {
        if let Some(rest) = plain.strip_suffix(start)
            && rest.len() >= 2
            && found.is_decimal.is_none()
        {
            found.is_decimal = Some(is_decimal);
            plain.truncate(rest.len());
        }
    }
    found.byte = byte_number(&plain);
    if found.byte.is_some() {
        return Some(ColumnName { role: ColumnRole::Data, ..found });
    }
    let known = NAMES.iter().find(|(_, names)| names.contains(&plain.as_str()));
    known.map(|(role, _)| ColumnName { role: *role, ..found })
}

/// Number of a byte in names such as `d1`, `data0`, `byte7`.
fn byte_number(plain: &str) -> Option<u8> {
    let starts = ["databyte", "data", "byte", "daten", "db", "d", "b"];
    let digits = starts.iter().find_map(|start| plain.strip_prefix(start))?;
    (matches!(digits.len(), 1..=2) && digits.bytes().all(|digit| digit.is_ascii_digit()))
        .then(|| digits.parse().ok())
        .flatten()
}

/// Meaning of a word in a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WordMeaning {
    /// Flags of the frame.
    Flags(FrameFlags),
    /// Extended identifier or not.
    Extended(bool),
    /// A data frame, which is the usual one.
    Nothing,
}

const RX: WordMeaning = WordMeaning::Flags(FrameFlags::RECEIVED);
const TX: WordMeaning = WordMeaning::Flags(FrameFlags::TRANSMITTED);
const REMOTE: WordMeaning = WordMeaning::Flags(FrameFlags::REMOTE);
const ERROR: WordMeaning = WordMeaning::Flags(FrameFlags::ERROR);
const FD: WordMeaning = WordMeaning::Flags(FrameFlags::FD);

/// Words of two or more letters in lower case.
const WORDS: &[(&str, WordMeaning)] = &[
    ("rx", RX),
    ("recv", RX),
    ("receive", RX),
    ("received", RX),
    ("rcv", RX),
    ("empfangen", RX),
    ("empf", RX),
    ("接收", RX),
    ("<-", RX),
    ("<<", RX),
    ("<--", RX),
    ("tx", TX),
    ("send", TX),
    ("sent", TX),
    ("transmit", TX),
    ("transmitted", TX),
    ("gesendet", TX),
    ("senden", TX),
    ("发送", TX),
    ("->", TX),
    (">>", TX),
    ("-->", TX),
    ("rtr", REMOTE),
    ("remote", REMOTE),
    ("remoteframe", REMOTE),
    ("远程帧", REMOTE),
    ("error", ERROR),
    ("errorframe", ERROR),
    ("err", ERROR),
    ("错误帧", ERROR),
    ("std", WordMeaning::Extended(false)),
    ("standard", WordMeaning::Extended(false)),
    ("sff", WordMeaning::Extended(false)),
    ("base", WordMeaning::Extended(false)),
    ("标准帧", WordMeaning::Extended(false)),
    ("ext", WordMeaning::Extended(true)),
    ("extended", WordMeaning::Extended(true)),
    ("xtd", WordMeaning::Extended(true)),
    ("eff", WordMeaning::Extended(true)),
    ("扩展帧", WordMeaning::Extended(true)),
    ("fd", FD),
    ("canfd", FD),
    ("fdf", FD),
    ("brs", WordMeaning::Flags(FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH))),
    ("esi", WordMeaning::Flags(FrameFlags::FD.with(FrameFlags::ERROR_STATE))),
    ("data", WordMeaning::Nothing),
    ("frame", WordMeaning::Nothing),
    ("request", WordMeaning::Nothing),
    ("数据帧", WordMeaning::Nothing),
    ("none", WordMeaning::Nothing),
    ("-", WordMeaning::Nothing),
];

/// Longest word with a meaning, in bytes.
const LONGEST_WORD: usize = 16;

/// Meaning of a word of two or more letters; `None` if it has none.
pub(super) fn word_meaning(word: &[u8]) -> Option<WordMeaning> {
    let mut lower = [0; LONGEST_WORD];
    let lower = lower.get_mut(..word.len())?;
    lower.copy_from_slice(word);
    lower.make_ascii_lowercase();
    let lower: &[u8] = lower;
    WORDS.iter().find(|(known, _)| known.as_bytes() == lower).map(|(_, meaning)| *meaning)
}

/// Pairs of letters that mark all lines of a column: both must occur.
pub(super) const LETTER_PAIRS: &[([u8; 2], [WordMeaning; 2])] = &[
    ([b'R', b'T'], [RX, TX]),
    ([b'r', b't'], [RX, TX]),
    ([b'D', b'R'], [WordMeaning::Nothing, REMOTE]),
    ([b'd', b'r'], [WordMeaning::Nothing, REMOTE]),
    ([b'S', b'X'], [WordMeaning::Extended(false), WordMeaning::Extended(true)]),
    ([b's', b'x'], [WordMeaning::Extended(false), WordMeaning::Extended(true)]),
    ([b'S', b'E'], [WordMeaning::Extended(false), WordMeaning::Extended(true)]),
];

/// Whether a word is the name of a bus: letters that mean an interface, and a number.
pub(super) fn is_bus_name(word: &[u8]) -> bool {
    let digits = word.iter().rev().take_while(|byte| byte.is_ascii_digit()).count();
    let Some(letters) = word.get(..word.len().saturating_sub(digits)) else { return false };
    let letters = letters.strip_suffix(b"_").or(letters.strip_suffix(b"-")).unwrap_or(letters);
    let known =
        [&b"can"[..], b"vcan", b"slcan", b"ch", b"chn", b"channel", b"bus", b"canbus", b"kanal", b"canfd"];
    matches!(digits, 1..=2) && known.iter().any(|name| letters.eq_ignore_ascii_case(name))
}

/// Parses a truth value of a column such as `Extended`.
pub(super) fn truth_value(word: &[u8]) -> Option<bool> {
    match word.to_ascii_lowercase().as_slice() {
        b"1" | b"true" | b"yes" | b"y" | b"x" | b"ext" | b"extended" | b"rtr" | b"ja" => Some(true),
        b"0" | b"false" | b"no" | b"n" | b"std" | b"standard" | b"s" | b"-" | b"nein" => Some(false),
        _ => None,
    }
}
