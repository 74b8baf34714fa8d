//! One row of the table: what is shown, and how bad it is.

use cobscope_decoder::event::Effective;
use cobscope_decoder::frame::{BusIndex, CanId};
use cobscope_decoder::wire::NodeId;

use super::values::Values;
use crate::theme::Role;

/// What a row is of: it stays the selected one when others come and go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// A bus, where there are several.
    Bus(BusIndex),
    /// Whoever commands the nodes of a bus.
    Master(BusIndex),
    /// A node; of one with several outputs one of them.
    Node(BusIndex, NodeId, Option<u8>),
    /// An identifier nobody owns.
    Orphan(BusIndex, CanId),
}

impl Key {
    /// The node it is of.
    pub fn node(self) -> Option<(BusIndex, NodeId)> {
        match self {
            Self::Node(bus, node, _) => Some((bus, node)),
            _ => None,
        }
    }

    /// The output of its node, where that has several.
    pub fn channel(self) -> Option<u8> {
        match self {
            Self::Node(_, _, channel) => channel,
            _ => None,
        }
    }
}

/// How bad it is, the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Grade {
    /// An error, a fault, settings that are gone.
    Error,
    /// Set points do not act.
    NoEffect,
    /// Silent for too long.
    Silent,
    /// Nothing of these.
    #[default]
    Others,
}

/// A text with its look.
#[derive(Debug, Clone)]
pub struct Shown {
    /// The text.
    pub text: String,
    /// Its look.
    pub role: Role,
}

impl Shown {
    /// A text with a look.
    pub fn new(text: impl Into<String>, role: Role) -> Self {
        Self { text: text.into(), role }
    }
}

/// Nothing to say.
impl Default for Shown {
    fn default() -> Self {
        Self::new("–", Role::Quiet)
    }
}

/// A row.
#[derive(Debug, Clone)]
pub struct Line {
    /// What it is of.
    pub key: Key,
    /// Number, decimal and hexadecimal.
    pub id: String,
    /// Name the user gave.
    pub name: String,
    /// What it is.
    pub device: String,
    /// NMT state.
    pub nmt: Shown,
    /// State of the device.
    pub state: Shown,
    /// Set points and actual values, or what there is to say instead.
    pub values: Values,
    /// Whether set points act.
    pub effective: Option<Effective>,
    /// Last sign of life.
    pub alive: Shown,
    /// Errors.
    pub errors: Shown,
    /// How bad it is.
    pub grade: Grade,
}

impl Line {
    /// A row that says nothing yet.
    pub fn new(key: Key) -> Self {
        Self {
            key,
            id: String::new(),
            name: String::new(),
            device: String::new(),
            nmt: Shown::default(),
            state: Shown::default(),
            values: Values::default(),
            effective: None,
            alive: Shown::default(),
            errors: Shown::default(),
            grade: Grade::default(),
        }
    }

    /// Whether set points act, in a word.
    pub fn effect(&self) -> Shown {
        match self.effective {
            Some(Effective::Yes) => Shown::new("yes", Role::Good),
            Some(Effective::No) => Shown::new("NO", Role::Bad),
            Some(Effective::Unknown) => Shown::new("?", Role::Caution),
            None => Shown::default(),
        }
    }
}

/// Nanoseconds as seconds with a digit behind the point: `0.4`, `10.2`.
pub fn seconds(nanoseconds: i64) -> String {
    let tenths = nanoseconds.max(0) / 100_000_000;
    format!("{}.{}", tenths / 10, tenths % 10)
}

/// A limit in seconds, with as many digits as it has: `1.0`, `0.25`.
pub fn limit(nanoseconds: i64) -> String {
    let hundredths = (nanoseconds.max(0) + 5_000_000) / 10_000_000;
    let text = format!("{}.{:02}", hundredths / 100, hundredths % 100);
    text.strip_suffix('0').map_or(text.clone(), str::to_owned)
}

/// How long ago: `<1s`, `41s`, `3m`, `2h`.
pub fn age(nanoseconds: i64) -> String {
    match nanoseconds.max(0) / 1_000_000_000 {
        0 => "<1s".to_owned(),
        whole @ 1..120 => format!("{whole}s"),
        whole @ 120..7_200 => format!("{}m", whole / 60),
        whole => format!("{}h", whole / 3_600),
    }
}

/// A period: `10.0 ms`, `1.0 s`.
pub fn period(nanoseconds: i64) -> String {
    if nanoseconds >= 1_000_000_000 {
        return format!("{} s", seconds(nanoseconds + 50_000_000));
    }
    let tenths = (nanoseconds.max(0) + 50_000) / 100_000;
    format!("{}.{} ms", tenths / 10, tenths % 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_as_short_as_they_can_be() {
        assert_eq!([age(449_000_000), age(41_900_000_000), age(200_000_000_000)], ["<1s", "41s", "3m"]);
        assert_eq!([limit(1_000_000_000), limit(250_000_000), limit(500_000_000)], ["1.0", "0.25", "0.5"]);
        assert_eq!([period(9_950_000), period(1_000_000_000)], ["10.0 ms", "1.0 s"]);
    }
}
