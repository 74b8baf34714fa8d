//! Column layouts of known programs, detected by the header.

use std::borrow::Cow;

use super::field::{CsvField, CsvFields};
use crate::capture::TimeUnit;
use crate::capture::text::columns::NumberBase;

/// Column separators, in the order in which they are tried.
const SEPARATORS: [u8; 3] = *b",;\t";

/// Maximum number of columns read: 64 bytes and the other fields.
const MOST_COLUMNS: usize = 96;

/// Content of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColumnMeaning {
    /// Time of the frame.
    Time(CsvTimeFormat),
    /// Bus name.
    Bus,
    /// Identifier, with or without 0x.
    Id(NumberBase),
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
    Data(DataCoding),
    /// One byte of the data.
    Byte(NumberBase),
    /// Ignored column.
    Nothing,
}

/// Format of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CsvTimeFormat {
    /// A number in this unit.
    Unit(TimeUnit),
    /// Microseconds of GVRET; seconds if a decimal point occurs. Some programs write milliseconds.
    Gvret,
    /// Hours, minutes and seconds: `00:30:06.866`.
    Clock,
    /// Time of the computer in ZLG's programs: `="09:15:30.250"`.
    ZlgSystem,
    /// Time of the adapter in ZLG's programs: units of 0.1 ms as `0x592897`, seconds, or a time of day.
    ZlgAdapter,
}

/// Format of a data column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataCoding {
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
struct CsvDialect {
    /// Columns that the header must contain.
    required: &'static [(&'static str, ColumnMeaning)],
    /// Columns that the header may contain.
    optional: &'static [(&'static str, ColumnMeaning)],
    /// Whether lines without a separator are text around the table.
    has_text: bool,
}

/// All known programs; those with more required columns first.
const DIALECTS: &[CsvDialect] = &[
    // cobscope.
    CsvDialect {
        required: &[
            ("time", ColumnMeaning::Time(CsvTimeFormat::Unit(TimeUnit::Second))),
            ("bus", ColumnMeaning::Bus),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("extended", ColumnMeaning::Extended),
            ("remote", ColumnMeaning::Remote),
            ("error", ColumnMeaning::Error),
            ("fd", ColumnMeaning::Fd),
            ("brs", ColumnMeaning::Switch),
            ("esi", ColumnMeaning::State),
            ("direction", ColumnMeaning::Direction),
            ("dlc", ColumnMeaning::Dlc),
            ("length", ColumnMeaning::Length),
            ("data", ColumnMeaning::Data(DataCoding::Hex)),
        ],
        optional: &[],
        has_text: false,
    },
    // CSS Electronics: mdf4-converters, CANedge and webCAN.
    CsvDialect {
        required: &[
            ("timestampepoch", ColumnMeaning::Time(CsvTimeFormat::Unit(TimeUnit::Second))),
            ("buschannel", ColumnMeaning::Bus),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("ide", ColumnMeaning::Extended),
            ("dlc", ColumnMeaning::Dlc),
            ("datalength", ColumnMeaning::Length),
            ("databytes", ColumnMeaning::Data(DataCoding::Hex)),
        ],
        optional: &[
            ("dir", ColumnMeaning::Direction),
            ("edl", ColumnMeaning::Fd),
            ("brs", ColumnMeaning::Switch),
            ("esi", ColumnMeaning::State),
            ("rtr", ColumnMeaning::Remote),
        ],
        has_text: false,
    },
    // python-can: can.CSVWriter; its column dlc contains a length.
    CsvDialect {
        required: &[
            ("timestamp", ColumnMeaning::Time(CsvTimeFormat::Unit(TimeUnit::Second))),
            ("arbitration_id", ColumnMeaning::Id(NumberBase::Hex)),
            ("extended", ColumnMeaning::Extended),
            ("remote", ColumnMeaning::Remote),
            ("error", ColumnMeaning::Error),
            ("dlc", ColumnMeaning::Length),
            ("data", ColumnMeaning::Data(DataCoding::Base64)),
        ],
        optional: &[],
        has_text: false,
    },
    // SavvyCAN: framefileio.cpp, saveNativeCSVFile; older versions have no Dir.
    CsvDialect {
        required: &[
            ("time stamp", ColumnMeaning::Time(CsvTimeFormat::Gvret)),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("extended", ColumnMeaning::Extended),
            ("bus", ColumnMeaning::Bus),
            ("len", ColumnMeaning::Length),
            ("d1", ColumnMeaning::Byte(NumberBase::Hex)),
        ],
        optional: &[("dir", ColumnMeaning::Direction), ("d#", ColumnMeaning::Byte(NumberBase::Hex))],
        has_text: false,
    },
    // Kvaser Memorator: KvaLogWriter_CsvFrame.cpp in Kvaser's linlib samples; the lines before the header
    // state the bases.
    CsvDialect {
        required: &[
            ("time", ColumnMeaning::Time(CsvTimeFormat::Unit(TimeUnit::Second))),
            ("channel", ColumnMeaning::Bus),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("flags", ColumnMeaning::KvaserFlags),
            ("dlc", ColumnMeaning::Dlc),
            ("data0", ColumnMeaning::Byte(NumberBase::Hex)),
            ("counter", ColumnMeaning::Nothing),
        ],
        optional: &[("data#", ColumnMeaning::Byte(NumberBase::Hex))],
        has_text: false,
    },
    // IXXAT MiniMon and canAnalyser.
    CsvDialect {
        required: &[
            ("time", ColumnMeaning::Time(CsvTimeFormat::Clock)),
            ("format", ColumnMeaning::Extended),
            ("flags", ColumnMeaning::IxxatFlags),
        ],
        optional: &[
            ("identifier (hex)", ColumnMeaning::Id(NumberBase::Hex)),
            ("identifier (dec)", ColumnMeaning::Id(NumberBase::Decimal)),
            ("data (hex)", ColumnMeaning::Data(DataCoding::Hex)),
            ("data (dec)", ColumnMeaning::Data(DataCoding::Decimal)),
        ],
        has_text: false,
    },
    // Netronics CANdo.
    CsvDialect {
        required: &[
            ("type", ColumnMeaning::CandoKind),
            ("time", ColumnMeaning::Time(CsvTimeFormat::Unit(TimeUnit::Second))),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("d1", ColumnMeaning::Byte(NumberBase::Hex)),
        ],
        optional: &[("d#", ColumnMeaning::Byte(NumberBase::Hex))],
        has_text: true,
    },
    // canopen-message-interpreter.
    CsvDialect {
        required: &[
            ("message number", ColumnMeaning::Nothing),
            ("time [ms]", ColumnMeaning::Time(CsvTimeFormat::Unit(TimeUnit::Millisecond))),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("dlc", ColumnMeaning::Dlc),
            ("data bytes", ColumnMeaning::Data(DataCoding::Listed)),
        ],
        optional: &[],
        has_text: false,
    },
    // Programs of ZLG and of makers of compatible adapters (USB_CAN TOOL for CANalyst-II, CANTest): in Chinese, in any
    // order of columns.
    CsvDialect {
        required: &[
            ("id号", ColumnMeaning::Id(NumberBase::Hex)),
            ("数据", ColumnMeaning::Data(DataCoding::Marked)),
        ],
        optional: &[
            ("系统时间", ColumnMeaning::Time(CsvTimeFormat::ZlgSystem)),
            ("时间标识", ColumnMeaning::Time(CsvTimeFormat::ZlgAdapter)),
            ("can通道", ColumnMeaning::Bus),
            ("传输方向", ColumnMeaning::ZlgDirection),
            ("帧类型", ColumnMeaning::ZlgKind),
            ("帧格式", ColumnMeaning::ZlgKind),
            ("can类型", ColumnMeaning::ZlgKind),
            ("长度", ColumnMeaning::Length),
        ],
        has_text: false,
    },
    // The same in English.
    CsvDialect {
        required: &[
            ("system time", ColumnMeaning::Time(CsvTimeFormat::ZlgSystem)),
            ("direction", ColumnMeaning::ZlgDirection),
            ("type", ColumnMeaning::ZlgKind),
            ("format", ColumnMeaning::ZlgKind),
            ("data", ColumnMeaning::Data(DataCoding::Marked)),
        ],
        optional: &[
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("frame id", ColumnMeaning::Id(NumberBase::Hex)),
            ("time stamp", ColumnMeaning::Time(CsvTimeFormat::ZlgAdapter)),
            ("channel", ColumnMeaning::Bus),
            ("length", ColumnMeaning::Length),
            ("len", ColumnMeaning::Length),
            ("dlc", ColumnMeaning::Length),
        ],
        has_text: false,
    },
    // Programs that write the form of SavvyCAN with fewer columns, or with the DLC.
    CsvDialect {
        required: &[
            ("time stamp", ColumnMeaning::Time(CsvTimeFormat::Gvret)),
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("d1", ColumnMeaning::Byte(NumberBase::Hex)),
        ],
        optional: &[
            ("extended", ColumnMeaning::Extended),
            ("dir", ColumnMeaning::Direction),
            ("bus", ColumnMeaning::Bus),
            ("len", ColumnMeaning::Length),
            ("dlc", ColumnMeaning::Dlc),
            ("d#", ColumnMeaning::Byte(NumberBase::Hex)),
        ],
        has_text: false,
    },
    // SavvyCAN, generic: framefileio.cpp, saveGenericCSVFile.
    CsvDialect {
        required: &[
            ("id", ColumnMeaning::Id(NumberBase::Hex)),
            ("data bytes", ColumnMeaning::Data(DataCoding::Hex)),
        ],
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
pub(super) fn decode_text(text: &[u8], is_gbk: bool) -> Cow<'_, str> {
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

impl CsvDialect {
    fn column_meaning(&self, name: &[u8]) -> ColumnMeaning {
        let columns = || self.required.iter().chain(self.optional);
        let found = columns().find(|(known, _)| is_named(name, known));
        found.map_or(ColumnMeaning::Nothing, |(_, meaning)| *meaning)
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
pub(super) struct CsvLayout {
    /// Column separator.
    pub(super) separator: u8,
    /// Contents of the columns, in order.
    pub(super) columns: Vec<ColumnMeaning>,
    /// Whether lines without a separator are text around the table.
    pub(super) has_text: bool,
    /// Whether the text is in GBK, not in UTF-8.
    pub(super) is_gbk: bool,
}

impl CsvLayout {
    /// Layout of the rows after the header `line`; `None` if it is not the header of a known program.
    pub(super) fn of_header(line: &[u8]) -> Option<Self> {
        // No coding of a character contains a separator.
        let [first, second, third] = SEPARATORS;
        memchr::memchr3(first, second, third, line)?;
        let is_gbk = std::str::from_utf8(line).is_err();
        let line = decode_text(line, is_gbk);
        let line = line.as_bytes();
        for separator in SEPARATORS.into_iter().filter(|separator| line.contains(separator)) {
            let fields = CsvFields::new(line, separator).take(MOST_COLUMNS);
            let name = |field: CsvField<'_>| {
                let name = String::from_utf8_lossy(field.text.trim_ascii());
                known_name(&name).as_bytes().to_vec()
            };
            let names: Vec<_> = fields.map(name).collect();
            let has = |known: &str| names.iter().any(|name| is_named(name, known));
            let fits = |dialect: &&CsvDialect| dialect.required.iter().all(|(known, _)| has(known));
            if let Some(dialect) = DIALECTS.iter().find(fits) {
                let columns = names.iter().map(|name| dialect.column_meaning(name)).collect();
                return Some(Self { separator, columns, has_text: dialect.has_text, is_gbk });
            }
        }
        None
    }

    /// Whether a column has this content.
    pub(super) fn has_column(&self, meaning: ColumnMeaning) -> bool {
        self.columns.contains(&meaning)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(header: &str) -> Option<(u8, usize, Vec<ColumnMeaning>)> {
        let layout = CsvLayout::of_header(header.as_bytes())?;
        Some((layout.separator, layout.columns.len(), layout.columns))
    }

    #[test]
    fn names_are_found_in_any_order_and_case_behind_any_separator() {
        let (separator, count, columns) = of("\"Data Bytes\"; x ; ID").unwrap();
        assert_eq!((separator, count), (b';', 3));
        assert_eq!(
            columns,
            [
                ColumnMeaning::Data(DataCoding::Hex),
                ColumnMeaning::Nothing,
                ColumnMeaning::Id(NumberBase::Hex)
            ]
        );
    }

    #[test]
    fn numbered_columns_are_bytes() {
        let (_, _, columns) = of("Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D64,Dx").unwrap();
        assert_eq!(
            columns[7..],
            [
                ColumnMeaning::Byte(NumberBase::Hex),
                ColumnMeaning::Byte(NumberBase::Hex),
                ColumnMeaning::Nothing
            ]
        );
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
            let utf_8 = CsvLayout::of_header(head.as_bytes()).unwrap();
            let gbk = CsvLayout::of_header(&encoding_rs::GBK.encode(head).0).unwrap();
            assert_eq!((utf_8.is_gbk, gbk.is_gbk, &utf_8.columns), (false, true, &gbk.columns), "{head}");
            assert!(
                utf_8.has_column(ColumnMeaning::Id(NumberBase::Hex))
                    && utf_8.has_column(ColumnMeaning::Length),
                "{head}"
            );
        }
        let mut broken = encoding_rs::GBK.encode(heads[2]).0.into_owned();
        let name = encoding_rs::GBK.encode("序号,传输方向,时间标识,").0.len();
        broken[name] = 0xFF;
        assert!(CsvLayout::of_header(&broken).is_some(), "a broken name of a column that is not needed");
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
