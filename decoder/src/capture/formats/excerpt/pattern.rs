//! The patterns of pasted rows, the most specific first.

use super::row::ExcerptColumn::{Bus, Colon, Cycle, Data, Direction, Hex, Id, Kind, Length, Number, Time};
use super::row::{ExcerptRow, parse_candump, parse_columns, parse_trc, python_can};

/// A pattern of rows.
pub(super) struct ExcerptPattern {
    /// Notice for the user.
    pub(super) note: &'static str,
    /// Parses a row; `None` if it does not fit.
    pub(super) read: fn(&[u8]) -> Option<ExcerptRow<'_>>,
}

/// All patterns.
pub(super) const PATTERNS: &[ExcerptPattern] = &[
    ExcerptPattern {
        note: "no header: rows read as PEAK TRC 2.1, times in milliseconds",
        read: |row| parse_trc(row, "2.1"),
    },
    ExcerptPattern {
        note: "no header: rows read as PEAK TRC 2.0, times in milliseconds",
        read: |row| parse_trc(row, "2.0"),
    },
    ExcerptPattern {
        note: "no header: rows read as PEAK TRC 1.3, times in milliseconds",
        read: |row| parse_trc(row, "1.3"),
    },
    ExcerptPattern {
        note: "no header: rows read as PEAK TRC 1.2, times in milliseconds",
        read: |row| parse_trc(row, "1.2"),
    },
    ExcerptPattern {
        note: "no header: rows read as PEAK TRC 1.1, times in milliseconds",
        read: |row| parse_trc(row, "1.1"),
    },
    ExcerptPattern {
        note: "no header: rows read as PEAK TRC 1.0, times in milliseconds",
        read: |row| parse_trc(row, "1.0"),
    },
    ExcerptPattern { note: "rows read as candump text without interface", read: parse_candump },
    ExcerptPattern {
        note: "rows read as messages printed by python-can, times in seconds",
        read: python_can,
    },
    ExcerptPattern {
        note: "no header: rows read as time in seconds, identifier, direction, type, length, data (PCAN-View)",
        read: |row| parse_columns(row, &[Time, Id, Direction, Kind, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as number, time in seconds, identifier, direction, type, length, data",
        read: |row| parse_columns(row, &[Number, Time, Id, Direction, Kind, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as time in seconds, bus, identifier, direction, type, length, data",
        read: |row| parse_columns(row, &[Time, Bus, Id, Direction, Kind, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as identifier, direction, type, length, data, without times",
        read: |row| parse_columns(row, &[Id, Direction, Kind, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as bus, identifier, direction, type, length, data, without times",
        read: |row| parse_columns(row, &[Bus, Id, Direction, Kind, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as time in seconds, identifier, direction, length, data",
        read: |row| parse_columns(row, &[Time, Id, Direction, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as time in seconds, direction, identifier, length, data",
        read: |row| parse_columns(row, &[Time, Direction, Id, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as identifier, direction, length, data, without times",
        read: |row| parse_columns(row, &[Id, Direction, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as direction, identifier, length, data, without times",
        read: |row| parse_columns(row, &[Direction, Id, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as time in seconds, identifier, length, data",
        read: |row| parse_columns(row, &[Time, Id, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as the message list of PCAN-View (one frame per identifier), without times",
        read: |row| parse_columns(row, &[Hex, Length, Data, Cycle, Number]),
    },
    ExcerptPattern {
        note: "no header: rows read as identifier with h, length, data, without times",
        read: |row| parse_columns(row, &[Hex, Length, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as time in seconds, identifier, data",
        read: |row| parse_columns(row, &[Time, Colon, Data]),
    },
    ExcerptPattern {
        note: "no header: rows read as identifier, data, without times",
        read: |row| parse_columns(row, &[Colon, Data]),
    },
];
