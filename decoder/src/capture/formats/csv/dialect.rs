//! Column layouts of known programs, detected by the header.

use std::borrow::Cow;

use super::field::{Field, Fields};
use crate::capture::text::columns::Base;

/// Column separators, in the order in which they are tried.
const SEPARATORS: &[u8] = b",;\t";

/// Maximum number of columns read: 64 bytes and the other fields.
const MOST_COLUMNS: usize = 96;

/// Content of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Time of the frame.
    Time(Stamp),
    /// Bus name.
    Bus,
    /// Identifier, with or without 0x.
    Id(Base),
    /// Whether the identifier is extended: 0 or 1, false or true, Std or Ext.
    Extended,
    /// Whether the frame is a remote frame.
    Remote,
    /// Whether the frame is an error frame.
    Error,
    /// Whether the frame is an FD frame.
    Fd,
    /// Bit rate switch.
    Switch,
    /// Error state indicator.
    State,
    /// Direction: rx or tx, or 0 or 1.
    Direction,
    /// Flags of Kvaser's library as a number (canlib.h, `canMSG_`).
    KvaserFlags,
    /// Flag words of IXXAT's programs: `Rtr`.
    IxxatFlags,
    /// Frame type in Netronics' form: `RD11`, `TR29`, `EF`.
    CandoKind,
    /// Direction in words of ZLG's programs.
    ZlgDirection,
    /// Frame type or format in words of ZLG's programs.
    ZlgKind,
    /// The DLC.
    Dlc,
    /// Length in bytes.
    Length,
    /// All data.
    Data(Coding),
    /// One byte of the data.
    Byte(Base),
    /// Ignored column.
    Nothing,
}

/// Format of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stamp {
    /// Seconds.
    Seconds,
    /// Milliseconds.
    Milliseconds,
    /// Microseconds; seconds if a decimal point occurs.
    Microseconds,
    /// Hours, minutes and seconds: `00:30:06.866`.
    Clock,
    /// Time of the computer in ZLG's programs: `="09:15:30.250"`.
    ZlgSystem,
    /// Time of the adapter in ZLG's programs: units of 0.1 ms as `0x592897`, seconds, or a time of day.
    ZlgAdapter,
}

/// Format of a data column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coding {
    /// Hex, two digits per byte, with or without spaces.
    Hex,
    /// Decimal, separated by spaces.
    Decimal,
    /// Base64 of RFC 4648.
    Base64,
    /// `[0x05 0x7f]`; empty for a remote frame.
    Listed,
    /// `x| 05 7F`, possibly with bytes after the length.
    Marked,
}

/// Columns of a program: names in lower case, `#` means a number.
struct Dialect {
    /// Columns that the header must contain.
    required: &'static [(&'static str, Meaning)],
    /// Columns that the header may contain.
    optional: &'static [(&'static str, Meaning)],
    /// Whether lines without a separator are text around the table.
    has_text: bool,
}

/// All known programs; those with more required columns first.
const DIALECTS: &[Dialect] = &[
    // cobscope.
    Dialect {
        required: &[
            ("time", Meaning::Time(Stamp::Seconds)),
            ("bus", Meaning::Bus),
            ("id", Meaning::Id(Base::Hex)),
            ("extended", Meaning::Extended),
            ("remote", Meaning::Remote),
            ("error", Meaning::Error),
            ("fd", Meaning::Fd),
            ("brs", Meaning::Switch),
            ("esi", Meaning::State),
            ("direction", Meaning::Direction),
            ("dlc", Meaning::Dlc),
            ("length", Meaning::Length),
            ("data", Meaning::Data(Coding::Hex)),
        ],
        optional: &[],
        has_text: false,
    },
    // CSS Electronics: mdf4-converters, CANedge and webCAN.
    Dialect {
        required: &[
            ("timestampepoch", Meaning::Time(Stamp::Seconds)),
            ("buschannel", Meaning::Bus),
            ("id", Meaning::Id(Base::Hex)),
            ("ide", Meaning::Extended),
            ("dlc", Meaning::Dlc),
            ("datalength", Meaning::Length),
            ("databytes", Meaning::Data(Coding::Hex)),
        ],
        optional: &[
            ("dir", Meaning::Direction),
            ("edl", Meaning::Fd),
            ("brs", Meaning::Switch),
            ("esi", Meaning::State),
            ("rtr", Meaning::Remote),
        ],
        has_text: false,
    },
    // python-can: can.CSVWriter; its column dlc contains a length.
    Dialect {
        required: &[
            ("timestamp", Meaning::Time(Stamp::Seconds)),
            ("arbitration_id", Meaning::Id(Base::Hex)),
            ("extended", Meaning::Extended),
            ("remote", Meaning::Remote),
            ("error", Meaning::Error),
            ("dlc", Meaning::Length),
            ("data", Meaning::Data(Coding::Base64)),
        ],
        optional: &[],
        has_text: false,
    },
    // SavvyCAN: framefileio.cpp, saveNativeCSVFile; older versions have no Dir.
    Dialect {
        required: &[
            ("time stamp", Meaning::Time(Stamp::Microseconds)),
            ("id", Meaning::Id(Base::Hex)),
            ("extended", Meaning::Extended),
            ("bus", Meaning::Bus),
            ("len", Meaning::Length),
            ("d1", Meaning::Byte(Base::Hex)),
        ],
        optional: &[("dir", Meaning::Direction), ("d#", Meaning::Byte(Base::Hex))],
        has_text: false,
    },
    // Kvaser Memorator: KvaLogWriter_CsvFrame.cpp in Kvaser's linlib samples; the lines before the header
    // state the bases.
    Dialect {
        required: &[
            ("time", Meaning::Time(Stamp::Seconds)),
            ("channel", Meaning::Bus),
            ("id", Meaning::Id(Base::Hex)),
            ("flags", Meaning::KvaserFlags),
            ("dlc", Meaning::Dlc),
            ("data0", Meaning::Byte(Base::Hex)),
            ("counter", Meaning::Nothing),
        ],
        optional: &[("data#", Meaning::Byte(Base::Hex))],
        has_text: false,
    },
    // IXXAT MiniMon and canAnalyser.
    Dialect {
        required: &[
            ("time", Meaning::Time(Stamp::Clock)),
            ("format", Meaning::Extended),
            ("flags", Meaning::IxxatFlags),
        ],
        optional: &[
            ("identifier (hex)", Meaning::Id(Base::Hex)),
            ("identifier (dec)", Meaning::Id(Base::Decimal)),
            ("data (hex)", Meaning::Data(Coding::Hex)),
            ("data (dec)", Meaning::Data(Coding::Decimal)),
        ],
        has_text: false,
    },
    // Netronics CANdo.
    Dialect {
        required: &[
            ("type", Meaning::CandoKind),
            ("time", Meaning::Time(Stamp::Seconds)),
            ("id", Meaning::Id(Base::Hex)),
            ("d1", Meaning::Byte(Base::Hex)),
        ],
        optional: &[("d#", Meaning::Byte(Base::Hex))],
        has_text: true,
    },
    // canopen-message-interpreter.
    Dialect {
        required: &[
            ("message number", Meaning::Nothing),
            ("time [ms]", Meaning::Time(Stamp::Milliseconds)),
            ("id", Meaning::Id(Base::Hex)),
            ("dlc", Meaning::Dlc),
            ("data bytes", Meaning::Data(Coding::Listed)),
        ],
        optional: &[],
        has_text: false,
    },
    // Programs of ZLG and of makers of compatible adapters (USB_CAN TOOL for CANalyst-II, CANTest): in Chinese, in any
    // order of columns.
    Dialect {
        required: &[("id号", Meaning::Id(Base::Hex)), ("数据", Meaning::Data(Coding::Marked))],
        optional: &[
            ("系统时间", Meaning::Time(Stamp::ZlgSystem)),
            ("时间标识", Meaning::Time(Stamp::ZlgAdapter)),
            ("can通道", Meaning::Bus),
            ("传输方向", Meaning::ZlgDirection),
            ("帧类型", Meaning::ZlgKind),
            ("帧格式", Meaning::ZlgKind),
            ("can类型", Meaning::ZlgKind),
            ("长度", Meaning::Length),
        ],
        has_text: false,
    },
    // The same in English.
    Dialect {
        required: &[
            ("system time", Meaning::Time(Stamp::ZlgSystem)),
            ("direction", Meaning::ZlgDirection),
            ("type", Meaning::ZlgKind),
            ("format", Meaning::ZlgKind),
            ("data", Meaning::Data(Coding::Marked)),
        ],
        optional: &[
            ("id", Meaning::Id(Base::Hex)),
            ("frame id", Meaning::Id(Base::Hex)),
            ("time stamp", Meaning::Time(Stamp::ZlgAdapter)),
            ("channel", Meaning::Bus),
            ("length", Meaning::Length),
            ("len", Meaning::Length),
            ("dlc", Meaning::Length),
        ],
        has_text: false,
    },
    // SavvyCAN, generic: framefileio.cpp, saveGenericCSVFile.
    Dialect {
        required: &[("id", Meaning::Id(Base::Hex)), ("data bytes", Meaning::Data(Coding::Hex))],
        optional: &[],
        has_text: false,
    },
];

/// Names of columns that differ between versions of a program, and the name in [`DIALECTS`].
const SYNONYMS: &[(&str, &str)] = &[
    ("时间", "时间标识"),
    ("方向", "传输方向"),
    ("通道", "can通道"),
    ("通道号", "can通道"),
    ("源通道", "can通道"),
    ("帧id", "id号"),
    ("帧id(hex)", "id号"),
    ("帧id(靠右对齐)", "id号"),
    ("数据长度", "长度"),
    ("数据(hex)", "数据"),
];

/// Text of a header or of a word: UTF-8, or otherwise GBK (also GB 2312). Invalid characters become U+FFFD.
pub(super) fn decoded(text: &[u8], is_gbk: bool) -> Cow<'_, str> {
    if is_gbk {
        return encoding_rs::GBK.decode_without_bom_handling(text).0;
    }
    String::from_utf8_lossy(text)
}

/// The name of a column in [`DIALECTS`].
fn known_name(name: &str) -> &str {
    let synonym = SYNONYMS.iter().find(|(other, _)| name.eq_ignore_ascii_case(other));
    synonym.map_or(name, |(_, known)| known)
}

impl Dialect {
    fn meaning(&self, name: &[u8]) -> Meaning {
        let columns = || self.required.iter().chain(self.optional);
        let found = columns().find(|(known, _)| is_named(name, known));
        found.map_or(Meaning::Nothing, |(_, meaning)| *meaning)
    }
}

/// Whether a column name matches `known`, without regard to case.
fn is_named(name: &[u8], known: &str) -> bool {
    match known.strip_suffix('#') {
        Some(start) => name.split_at_checked(start.len()).is_some_and(|(name, digits)| {
            let numbered = !digits.is_empty() && digits.iter().all(u8::is_ascii_digit);
            numbered && name.eq_ignore_ascii_case(start.as_bytes())
        }),
        None => name.eq_ignore_ascii_case(known.as_bytes()),
    }
}

/// Columns of a capture.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// Column separator.
    pub(super) separator: u8,
    /// Contents of the columns, in order.
    pub(super) columns: Vec<Meaning>,
    /// Whether lines without a separator are text around the table.
    pub(super) has_text: bool,
    /// Whether the text is in GBK, not in UTF-8.
    pub(super) is_gbk: bool,
}

impl Layout {
    /// Layout of the rows after the header `line`; `None` if it is not the header of a known program.
    pub(super) fn of_header(line: &[u8]) -> Option<Self> {
        let is_gbk = std::str::from_utf8(line).is_err();
        let line = decoded(line, is_gbk);
        let line = line.as_bytes();
        for separator in SEPARATORS.iter().copied().filter(|separator| line.contains(separator)) {
            let fields = Fields::new(line, separator).take(MOST_COLUMNS);
            let name = |field: Field<'_>| {
                let name = String::from_utf8_lossy(field.text.trim_ascii());
                known_name(&name).as_bytes().to_vec()
            };
            let names: Vec<_> = fields.map(name).collect();
            let has = |known: &str| names.iter().any(|name| is_named(name, known));
            let fits = |dialect: &&Dialect| dialect.required.iter().all(|(known, _)| has(known));
            if let Some(dialect) = DIALECTS.iter().find(fits) {
                let columns = names.iter().map(|name| dialect.meaning(name)).collect();
                return Some(Self { separator, columns, has_text: dialect.has_text, is_gbk });
            }
        }
        None
    }

    /// Whether a column has this content.
    pub(super) fn has(&self, meaning: Meaning) -> bool {
        self.columns.contains(&meaning)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(header: &str) -> Option<(u8, usize, Vec<Meaning>)> {
        let layout = Layout::of_header(header.as_bytes())?;
        Some((layout.separator, layout.columns.len(), layout.columns))
    }

    #[test]
    fn names_are_found_in_any_order_and_case_behind_any_separator() {
        let (separator, count, columns) = of("\"Data Bytes\"; x ; ID").unwrap();
        assert_eq!((separator, count), (b';', 3));
        assert_eq!(columns, [Meaning::Data(Coding::Hex), Meaning::Nothing, Meaning::Id(Base::Hex)]);
    }

    #[test]
    fn numbered_columns_are_bytes() {
        let (_, _, columns) = of("Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D64,Dx").unwrap();
        assert_eq!(columns[7..], [Meaning::Byte(Base::Hex), Meaning::Byte(Base::Hex), Meaning::Nothing]);
    }

    #[test]
    fn other_headers_are_not_known() {
        for header in ["", "id", "time,bus,id", "ID;DLC;Data", "Time,Channel,PGN,Flags,DLC,Data0,Counter"] {
            assert_eq!(of(header), None, "{header}");
        }
    }

    /// Names as in files of these programs; the order of columns differs between versions.
    #[test]
    fn chinese_heads_in_both_encodings() {
        let heads = [
            "序号,系统时间,时间标识,CAN通道,传输方向,ID号,帧类型,帧格式,长度,数据",
            "序号,系统时间,时间标识,CAN通道,ID号,帧类型,帧格式,CAN类型,长度,数据",
            "序号,传输方向,时间标识,名称,帧ID(靠右对齐),帧格式,帧类型,数据长度,数据(HEX)",
            "序号,方向,时间,名称,帧ID,帧格式,帧类型,数据长度,数据(HEX)",
        ];
        for head in heads {
            let utf_8 = Layout::of_header(head.as_bytes()).unwrap();
            let gbk = Layout::of_header(&encoding_rs::GBK.encode(head).0).unwrap();
            assert_eq!((utf_8.is_gbk, gbk.is_gbk, &utf_8.columns), (false, true, &gbk.columns), "{head}");
            assert!(utf_8.has(Meaning::Id(Base::Hex)) && utf_8.has(Meaning::Length), "{head}");
        }
        let mut broken = encoding_rs::GBK.encode(heads[2]).0.into_owned();
        let name = encoding_rs::GBK.encode("序号,传输方向,时间标识,").0.len();
        broken[name] = 0xFF;
        assert!(Layout::of_header(&broken).is_some(), "a broken name of a column that is not needed");
    }

    #[test]
    fn no_program_hides_another() {
        for (index, dialect) in DIALECTS.iter().enumerate() {
            let names: Vec<_> = dialect.required.iter().map(|(name, _)| *name).collect();
            let has = |known: &str| names.contains(&known);
            let first = DIALECTS.iter().position(|other| other.required.iter().all(|(name, _)| has(name)));
            assert_eq!(first, Some(index), "{names:?}");
        }
    }
}
