//! One row of the table: its texts and its grade.

use cobscope_decoder::event::EffectiveState;
use cobscope_decoder::figures::seconds_to;
use cobscope_decoder::frame::{BusIndex, CanId};
use cobscope_decoder::wire::NodeId;

use super::values::SetActualValues;
use crate::theme::TextRole;

/// Subject of a row. The selection follows it when other rows appear or disappear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeRowKey {
    /// Heading of a bus, if there are several.
    Bus(BusIndex),
    /// The sender of NMT commands of a bus.
    Master(BusIndex),
    /// A node, or one of its outputs.
    Node(BusIndex, NodeId, Option<u8>),
    /// An identifier without a known node.
    Orphan(BusIndex, CanId),
}

impl NodeRowKey {
    /// The node of a node row.
    pub fn node(self) -> Option<(BusIndex, NodeId)> {
        match self {
            Self::Node(bus, node, _) => Some((bus, node)),
            _ => None,
        }
    }

    /// The output of the node, if it has several.
    pub fn channel(self) -> Option<u8> {
        match self {
            Self::Node(_, _, channel) => channel,
            _ => None,
        }
    }
}

/// Severity of a row, worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum NodeGrade {
    /// An error, a fault or lost settings.
    Error,
    /// Set points without effect.
    NoEffect,
    /// No frame within the limit.
    Silent,
    /// None of the above.
    #[default]
    Others,
}

/// Text and role of a cell.
#[derive(Debug, Clone)]
pub struct StyledCell {
    /// The text, not escaped.
    pub text: String,
    /// Role that decides the style.
    pub role: TextRole,
}

impl StyledCell {
    /// A text in a role.
    pub fn new(text: impl Into<String>, role: TextRole) -> Self {
        Self { text: text.into(), role }
    }
}

/// An empty cell, drawn as a dash.
impl Default for StyledCell {
    fn default() -> Self {
        Self::new("–", TextRole::Quiet)
    }
}

/// A row of the table.
#[derive(Debug, Clone)]
pub struct NodeRow {
    /// Subject of the row.
    pub key: NodeRowKey,
    /// Number, decimal and hexadecimal.
    pub id: String,
    /// Name from the options or the bus file.
    pub name: String,
    /// Title of the device profile, or `master` or `orphan`.
    pub device: String,
    /// NMT state.
    pub nmt: StyledCell,
    /// State of the device's state machine.
    pub state: StyledCell,
    /// Set points with actual values, or a remark.
    pub values: SetActualValues,
    /// Whether the set points are effective; None without set points.
    pub effective: Option<EffectiveState>,
    /// Age of the last frame that proves the node alive, with its limit.
    pub alive: StyledCell,
    /// Active errors with their age.
    pub errors: StyledCell,
    /// Grade for sorting.
    pub grade: NodeGrade,
}

impl NodeRow {
    /// An empty row.
    pub fn new(key: NodeRowKey) -> Self {
        Self {
            key,
            id: String::new(),
            name: String::new(),
            device: String::new(),
            nmt: StyledCell::default(),
            state: StyledCell::default(),
            values: SetActualValues::default(),
            effective: None,
            alive: StyledCell::default(),
            errors: StyledCell::default(),
            grade: NodeGrade::default(),
        }
    }

    /// The cell `Eff`.
    pub fn effect_cell(&self) -> StyledCell {
        match self.effective {
            Some(EffectiveState::Yes) => StyledCell::new("yes", TextRole::Good),
            Some(EffectiveState::No) => StyledCell::new("NO", TextRole::Bad),
            Some(EffectiveState::Unknown) => StyledCell::new("?", TextRole::Caution),
            None => StyledCell::default(),
        }
    }
}

/// Nanoseconds as seconds with one decimal: `0.4`, `10.2`.
pub fn format_seconds(nanoseconds: i64) -> String {
    seconds_to(nanoseconds.max(0), 1)
}

/// A limit in seconds with one or two decimals: `1.0`, `0.25`.
pub fn format_limit(nanoseconds: i64) -> String {
    let hundredths = (nanoseconds.max(0) + 5_000_000) / 10_000_000;
    let text = format!("{}.{:02}", hundredths / 100, hundredths % 100);
    text.strip_suffix('0').map_or(text.clone(), str::to_owned)
}

/// An age: `<1s`, `41s`, `3m`, `2h`.
pub fn format_age(nanoseconds: i64) -> String {
    match nanoseconds.max(0) / 1_000_000_000 {
        0 => "<1s".to_owned(),
        whole @ 1..120 => format!("{whole}s"),
        whole @ 120..7_200 => format!("{}m", whole / 60),
        whole => format!("{}h", whole / 3_600),
    }
}

/// A period: `10.0 ms`, `1.0 s`.
pub fn format_period(nanoseconds: i64) -> String {
    if nanoseconds >= 1_000_000_000 {
        return format!("{} s", format_seconds(nanoseconds + 50_000_000));
    }
    let tenths = (nanoseconds.max(0) + 50_000) / 100_000;
    format!("{}.{} ms", tenths / 10, tenths % 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_as_short_as_they_can_be() {
        assert_eq!(
            [format_age(449_000_000), format_age(41_900_000_000), format_age(200_000_000_000)],
            ["<1s", "41s", "3m"]
        );
        assert_eq!(
            [format_limit(1_000_000_000), format_limit(250_000_000), format_limit(500_000_000)],
            ["1.0", "0.25", "0.5"]
        );
        assert_eq!([format_period(9_950_000), format_period(1_000_000_000)], ["10.0 ms", "1.0 s"]);
    }
}
