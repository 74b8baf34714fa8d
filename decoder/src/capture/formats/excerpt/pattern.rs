//! The patterns of pasted rows, the most specific first.

use super::row::Column::{Bus, Colon, Cycle, Data, Direction, Hex, Id, Kind, Length, Number, Time};
use super::row::{Row, candump, columns, python_can, trc};

/// A pattern of rows.
pub(super) struct Pattern {
    /// Notice for the user.
    pub(super) note: &'static str,
    /// Parses a row; `None` if it does not fit.
    pub(super) read: fn(&[u8]) -> Option<Row<'_>>,
}

/// All patterns.
pub(super) const PATTERNS: &[Pattern] = &[
    Pattern {
        note: "no header: rows read as PEAK TRC 2.1, times in milliseconds",
        read: |row| trc(row, "2.1"),
    },
    Pattern {
        note: "no header: rows read as PEAK TRC 2.0, times in milliseconds",
        read: |row| trc(row, "2.0"),
    },
    Pattern {
        note: "no header: rows read as PEAK TRC 1.3, times in milliseconds",
        read: |row| trc(row, "1.3"),
    },
    Pattern {
        note: "no header: rows read as PEAK TRC 1.2, times in milliseconds",
        read: |row| trc(row, "1.2"),
    },
    Pattern {
        note: "no header: rows read as PEAK TRC 1.1, times in milliseconds",
        read: |row| trc(row, "1.1"),
    },
    Pattern {
        note: "no header: rows read as PEAK TRC 1.0, times in milliseconds",
        read: |row| trc(row, "1.0"),
    },
    Pattern { note: "rows read as candump text without interface", read: candump },
    Pattern { note: "rows read as messages printed by python-can, times in seconds", read: python_can },
    Pattern {
        note: "no header: rows read as time in seconds, identifier, direction, type, length, data (PCAN-View)",
        read: |row| columns(row, &[Time, Id, Direction, Kind, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as number, time in seconds, identifier, direction, type, length, data",
        read: |row| columns(row, &[Number, Time, Id, Direction, Kind, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as time in seconds, bus, identifier, direction, type, length, data",
        read: |row| columns(row, &[Time, Bus, Id, Direction, Kind, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as identifier, direction, type, length, data, without times",
        read: |row| columns(row, &[Id, Direction, Kind, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as bus, identifier, direction, type, length, data, without times",
        read: |row| columns(row, &[Bus, Id, Direction, Kind, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as time in seconds, identifier, direction, length, data",
        read: |row| columns(row, &[Time, Id, Direction, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as time in seconds, direction, identifier, length, data",
        read: |row| columns(row, &[Time, Direction, Id, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as identifier, direction, length, data, without times",
        read: |row| columns(row, &[Id, Direction, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as direction, identifier, length, data, without times",
        read: |row| columns(row, &[Direction, Id, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as time in seconds, identifier, length, data",
        read: |row| columns(row, &[Time, Id, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as the message list of PCAN-View (one frame per identifier), without times",
        read: |row| columns(row, &[Hex, Length, Data, Cycle, Number]),
    },
    Pattern {
        note: "no header: rows read as identifier with h, length, data, without times",
        read: |row| columns(row, &[Hex, Length, Data]),
    },
    Pattern {
        note: "no header: rows read as time in seconds, identifier, data",
        read: |row| columns(row, &[Time, Colon, Data]),
    },
    Pattern {
        note: "no header: rows read as identifier, data, without times",
        read: |row| columns(row, &[Colon, Data]),
    },
];
