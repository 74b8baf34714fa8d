//! Whose columns a header names, and what they mean.

use super::field::Fields;
use crate::capture::text::columns::Base;

/// Separators of columns, in the order they are tried.
const SEPARATORS: &[u8] = b",;\t";

/// Columns that are looked at: 64 bytes and what stands around them.
const MOST_COLUMNS: usize = 96;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// When the frame was recorded.
    Time(Stamp),
    /// Name of the bus.
    Bus,
    /// Identifier, with or without 0x.
    Id(Base),
    /// Whether the identifier is extended: 0 and 1, false and true, Std and Ext.
    Extended,
    /// Whether it is a remote frame.
    Remote,
    /// Whether it is an error frame.
    Error,
    /// Whether it is an FD frame.
    Fd,
    /// Bit rate switch.
    Switch,
    /// Error state indicator.
    State,
    /// rx and tx, or 0 and 1.
    Direction,
    /// Flags of Kvaser's library as a number (canlib.h, `canMSG_`).
    KvaserFlags,
    /// Words of IXXAT's programs: `Rtr`.
    IxxatFlags,
    /// Kind of frame in Netronics' words: `RD11`, `TR29`, `EF`.
    CandoKind,
    /// The DLC.
    Dlc,
    /// Length in bytes.
    Length,
    /// All data.
    Data(Coding),
    /// One byte of the data.
    Byte(Base),
    /// Nothing that a frame has.
    Nothing,
}

/// How times are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stamp {
    /// Seconds.
    Seconds,
    /// Milliseconds.
    Milliseconds,
    /// Microseconds, or with a decimal point seconds.
    Microseconds,
    /// `00:30:06.866`
    Clock,
}

/// How all data of a frame are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coding {
    /// Hex, two digits a byte, blanks between them or not.
    Hex,
    /// Decimal, blanks between them.
    Decimal,
    /// Base64 of RFC 4648.
    Base64,
    /// `[0x05 0x7f]`, which a remote frame leaves out.
    Listed,
}

/// Columns of a program: names in lower case, `#` for a number.
struct Dialect {
    /// Columns a header must name.
    required: &'static [(&'static str, Meaning)],
    /// Columns it may name.
    optional: &'static [(&'static str, Meaning)],
    /// Lines without a separator are text around the table.
    has_text: bool,
}

/// All known programs, those that need more columns first.
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
    // python-can: can.CSVWriter: what it calls dlc is a length.
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
    // SavvyCAN: framefileio.cpp, saveNativeCSVFile; older ones have no Dir.
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
    // Kvaser Memorator: Kvaser's linlib samples, KvaLogWriter_CsvFrame.cpp; the lines before the header name the bases.
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
    // SavvyCAN, generic: framefileio.cpp, saveGenericCSVFile.
    Dialect {
        required: &[("id", Meaning::Id(Base::Hex)), ("data bytes", Meaning::Data(Coding::Hex))],
        optional: &[],
        has_text: false,
    },
];

impl Dialect {
    fn meaning(&self, name: &[u8]) -> Meaning {
        let columns = || self.required.iter().chain(self.optional);
        let found = columns().find(|(known, _)| is_named(name, known));
        found.map_or(Meaning::Nothing, |(_, meaning)| *meaning)
    }
}

/// Whether a header's name is `known`, whatever its case.
fn is_named(name: &[u8], known: &str) -> bool {
    match known.strip_suffix('#') {
        Some(start) => name.split_at_checked(start.len()).is_some_and(|(name, digits)| {
            let numbered = !digits.is_empty() && digits.iter().all(u8::is_ascii_digit);
            numbered && name.eq_ignore_ascii_case(start.as_bytes())
        }),
        None => name.eq_ignore_ascii_case(known.as_bytes()),
    }
}

/// What the columns of a capture mean.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// What stands between columns.
    pub(super) separator: u8,
    /// Their meanings, in order.
    pub(super) columns: Vec<Meaning>,
    /// Lines without a separator are text around the table.
    pub(super) has_text: bool,
}

impl Layout {
    /// What `line` says of the rows behind it, if it is a known program's header.
    pub(super) fn of_header(line: &[u8]) -> Option<Self> {
        for separator in SEPARATORS.iter().copied().filter(|separator| line.contains(separator)) {
            let fields = Fields::new(line, separator).take(MOST_COLUMNS);
            let names: Vec<_> = fields.map(|field| field.text.trim_ascii()).collect();
            let has = |known: &str| names.iter().any(|name| is_named(name, known));
            let fits = |dialect: &&Dialect| dialect.required.iter().all(|(known, _)| has(known));
            if let Some(dialect) = DIALECTS.iter().find(fits) {
                let columns = names.iter().map(|name| dialect.meaning(name)).collect();
                return Some(Self { separator, columns, has_text: dialect.has_text });
            }
        }
        None
    }

    /// Whether some column has this meaning.
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
