//! Requests of the page, one JSON object each.

use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::wire::NodeId;
use serde::Deserialize;

/// A request of the page.
#[derive(Debug, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case")]
pub enum PageRequest {
    /// Opens captures; everything opened before is dropped.
    Open(OpenRequest),
    /// Works for at most `frames` frames on whatever is pending.
    Step { frames: u64 },
    /// Results of the whole capture.
    Overview,
    /// Rows of the event list.
    Rows { list: ListName, from: u64, count: u64 },
    /// Row of the event list at a position.
    Locate { list: ListName, at: RequestPosition },
    /// Starts to search for the events of a filter.
    Filter { text: String, only_news: bool },
    /// Possible next words of a filter.
    Complete { text: String },
    /// State of nodes, identifiers and signals at a frame.
    State { frame: u64 },
    /// Known objects of a node at a frame.
    Objects { frame: u64, bus: u8, node: NodeName },
    /// All fields of an event.
    Event { frame: u64, ordinal: u32 },
    /// Transfers in order of their end.
    Transfers { from: usize, count: usize },
    /// Starts to sample signals over the capture.
    Plot { signals: Vec<FieldOfIdentifier>, from: Option<f64>, to: Option<f64> },
    /// Samples of the plotted signals.
    Curves,
    /// Starts to write a report.
    Report { finding: Option<u64>, page: String },
    /// Starts to write events, or frames as `pcapng`; of the frames `frames` only, if they are stated.
    Export { format: String, list: ListName, frames: Option<(u64, u64)> },
    /// Position of the next error event after a position, or of the previous one.
    Error { from: RowPosition, backward: bool },
    /// Starts to search for the next row with a text, or for the previous one.
    Search { text: String, list: ListName, from: RowPosition, backward: bool },
    /// Next bytes of a finished report or of an export in progress.
    Bytes { what: Product },
}

/// Captures with the files next to them.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct OpenRequest {
    /// Captures to merge.
    pub captures: Vec<NamedFile>,
    /// Bus file, device files and databases.
    pub beside: Vec<NamedFile>,
    /// Profiles of nodes.
    pub nodes: Vec<NodeProfile>,
    /// Current date, at which suppressions expire: `2026-01-31`.
    pub today: Option<String>,
}

/// A file of the user.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub struct NamedFile {
    /// Number for [`Files::read`](crate::files::Files::read).
    pub file: u32,
    /// Name without a folder.
    pub name: String,
    /// Size in bytes.
    pub size: u64,
    /// Node that a device file is for.
    pub node: Option<u8>,
}

/// Number of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NodeName {
    /// Node-ID.
    Canopen(u8),
    /// J1939 source address.
    J1939(u8),
}

impl From<NodeName> for NodeId {
    fn from(name: NodeName) -> Self {
        match name {
            NodeName::Canopen(id) => Self::Canopen(id),
            NodeName::J1939(address) => Self::J1939(address),
        }
    }
}

/// Profile assigned to a node.
#[derive(Debug, Clone, Deserialize)]
pub struct NodeProfile {
    /// Name of the bus; `None` for all buses.
    pub bus: Option<String>,
    /// The node.
    pub node: NodeName,
    /// Profile id, such as `wandfluh-md2:controller`.
    pub profile: String,
}

/// Selection of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ListName {
    /// All events.
    All,
    /// Changes only.
    News,
    /// Events of the filter.
    Filter,
}

/// Position of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct RowPosition {
    /// Number of the frame.
    pub frame: u64,
    /// Number of the event among those of the frame.
    pub ordinal: u32,
}

impl From<RowPosition> for EventPosition {
    fn from(spot: RowPosition) -> Self {
        Self { frame: spot.frame, ordinal: spot.ordinal }
    }
}

/// Position in a capture.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RequestPosition {
    /// An event, or the first one after it.
    Spot(RowPosition),
    /// Seconds since the first frame.
    Time(f64),
}

/// Field of an identifier.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct FieldOfIdentifier {
    /// Index of the bus.
    pub bus: u8,
    /// Identifier as text, as in the list of signals.
    pub id: String,
    /// Index of the field in the layout at `frame`.
    pub field: usize,
    /// Frame at which the signal was chosen.
    pub frame: u64,
}

/// Result to fetch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Product {
    /// Page of a report.
    Report,
    /// Cut-out capture of a report.
    Cut,
    /// Events.
    Export,
}
