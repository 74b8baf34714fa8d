//! Columns of text captures that the user states: `--columns 'time:ms id len data'`.

use std::fmt;
use std::str::FromStr;

/// Maximum number of columns before or after the data.
pub(in crate::capture) const MOST_COLUMNS: usize = 32;

/// Content of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(in crate::capture) enum ColumnRole {
    /// Ignored.
    #[default]
    Skip,
    /// Time of the frame.
    Time,
    /// Time since the frame before.
    Delta,
    /// Date before a time of day.
    Date,
    /// Identifier.
    Id,
    /// Length in bytes, or the DLC.
    Length,
    /// First byte of the data, or all of it.
    Data,
    /// Bus.
    Bus,
    /// Direction.
    Direction,
    /// Frame type in words.
    Kind,
    /// Whether the identifier is extended, as a number or a truth value.
    Extended,
    /// Whether the frame is a remote frame, as a number or a truth value.
    Remote,
    /// A count of the lines.
    Counter,
}

impl ColumnRole {
    /// Name in `--columns`.
    pub(in crate::capture) const fn name(self) -> &'static str {
        match self {
            Self::Skip | Self::Counter => "skip",
            Self::Time => "time",
            Self::Delta => "delta",
            Self::Date => "date",
            Self::Id => "id",
            Self::Length => "len",
            Self::Data => "data",
            Self::Bus => "bus",
            Self::Direction => "dir",
            Self::Kind => "kind",
            Self::Extended => "ext",
            Self::Remote => "rtr",
        }
    }
}

/// Unit of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::capture) enum ColumnUnit {
    Seconds,
    Milliseconds,
    /// 0.1 ms.
    TenthMilliseconds,
    Microseconds,
    Nanoseconds,
}

impl ColumnUnit {
    /// Nanoseconds of one unit.
    pub(in crate::capture) const fn nanoseconds(self) -> i64 {
        match self {
            Self::Seconds => 1_000_000_000,
            Self::Milliseconds => 1_000_000,
            Self::TenthMilliseconds => 100_000,
            Self::Microseconds => 1_000,
            Self::Nanoseconds => 1,
        }
    }

    /// Symbol of the unit.
    pub(in crate::capture) const fn symbol(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Milliseconds => "ms",
            Self::TenthMilliseconds => "0.1ms",
            Self::Microseconds => "us",
            Self::Nanoseconds => "ns",
        }
    }

    /// Parses a symbol or a word.
    pub(in crate::capture) fn of_word(word: &str) -> Option<Self> {
        match word {
            "s" | "sec" | "secs" | "second" | "seconds" | "sek" | "sekunden" => Some(Self::Seconds),
            "ms" | "msec" | "msecs" | "millis" | "millisecond" | "milliseconds" | "毫秒" => {
                Some(Self::Milliseconds)
            }
            "0.1ms" | "100us" | "0,1ms" => Some(Self::TenthMilliseconds),
            "us" | "usec" | "µs" | "μs" | "micros" | "microsecond" | "microseconds" => {
                Some(Self::Microseconds)
            }
            "ns" | "nsec" | "nanos" | "nanoseconds" => Some(Self::Nanoseconds),
            _ => None,
        }
    }
}

/// A column that the user states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::capture) struct StatedColumn {
    pub(in crate::capture) role: ColumnRole,
    pub(in crate::capture) unit: Option<ColumnUnit>,
    pub(in crate::capture) is_decimal: bool,
}

/// Columns of the lines of a text capture, in their order: `time:ms id len data`.
///
/// `time` and `delta` (time since the frame before) may have a unit (`s`, `ms`, `0.1ms`, `us`, `ns`); without one, numbers are
/// seconds. `id` and `data` may be decimal (`id:dec`). `len` is a length or DLC. `bus`, `dir`, `kind`, `ext`, `rtr` and `date` are
/// further columns; `skip` is a number or cell without meaning. Words other than bus names are not columns, unless each
/// cell of the lines has a separator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColumnList {
    columns: [StatedColumn; MOST_COLUMNS],
    count: u8,
}

impl ColumnList {
    /// The columns in order.
    pub(in crate::capture) fn columns(&self) -> &[StatedColumn] {
        self.columns.get(..usize::from(self.count)).unwrap_or_default()
    }
}

impl fmt::Display for ColumnList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, column) in self.columns().iter().enumerate() {
            let separator = if index == 0 { "" } else { " " };
            write!(f, "{separator}{}", column.role.name())?;
            match column.unit {
                Some(unit) => write!(f, ":{}", unit.symbol())?,
                None if column.is_decimal => f.write_str(":dec")?,
                None => {}
            }
        }
        Ok(())
    }
}

impl FromStr for ColumnList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut columns = [StatedColumn::default(); MOST_COLUMNS];
        let mut count = 0;
        for word in text.split([' ', ',']).filter(|word| !word.is_empty()) {
            let slot = columns.get_mut(count).ok_or(format!("more than {MOST_COLUMNS} columns"))?;
            *slot = parse_column(word)?;
            count += 1;
        }
        let list = Self { columns, count: u8::try_from(count).unwrap_or(u8::MAX) };
        for role in [ColumnRole::Id, ColumnRole::Data] {
            let count = list.columns().iter().filter(|column| column.role == role).count();
            if count != 1 {
                return Err(format!(
                    "{count} columns {}; expected one, as in 'time:s id len data'",
                    role.name()
                ));
            }
        }
        Ok(list)
    }
}

const ROLES: &[ColumnRole] = &[
    ColumnRole::Time,
    ColumnRole::Delta,
    ColumnRole::Date,
    ColumnRole::Id,
    ColumnRole::Length,
    ColumnRole::Data,
    ColumnRole::Bus,
    ColumnRole::Direction,
    ColumnRole::Kind,
    ColumnRole::Extended,
    ColumnRole::Remote,
    ColumnRole::Skip,
];

fn parse_column(word: &str) -> Result<StatedColumn, String> {
    let (name, detail) = word.split_once(':').map_or((word, None), |(name, detail)| (name, Some(detail)));
    let name = if name == "dlc" { "len" } else { name };
    let role = ROLES.iter().copied().find(|role| role.name() == name);
    let names = || ROLES.iter().map(|role| role.name()).collect::<Vec<_>>().join(", ");
    let role = role.ok_or_else(|| format!("unknown column {name:?}; expected {}", names()))?;
    let mut column = StatedColumn { role, ..StatedColumn::default() };
    match (role, detail) {
        (ColumnRole::Time | ColumnRole::Delta, Some(unit)) => {
            column.unit = Some(
                ColumnUnit::of_word(unit)
                    .ok_or_else(|| format!("unknown unit {unit:?}; expected s, ms, 0.1ms, us or ns"))?,
            );
        }
        (ColumnRole::Id | ColumnRole::Data, Some("dec")) => column.is_decimal = true,
        (ColumnRole::Id | ColumnRole::Data, Some("hex")) | (_, None) => {}
        (_, Some(detail)) => {
            return Err(format!(
                "{name}:{detail}; expected a unit after time or delta, hex or dec after id or data"
            ));
        }
    }
    Ok(column)
}
