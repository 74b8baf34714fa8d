//! Decodes CAN captures and live CAN frames to events of CANopen, J1939/ISOBUS and UDS devices, and checks
//! them with rules.
//!
//! [`Reading`] combines all stages: it reads a capture from any [`Read`](std::io::Read) (candump, pcap, ASC,
//! BLF, TRC, MDF4, MCAP, CSV and others, plain or compressed), or accepts single frames, and passes each [`Event`]
//! to a [`ReadingPart`](reading::ReadingPart), such as a closure.
//!
//! ```
//! use cobscope_decoder::{Bus, Event, NodeId, Reading};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let capture = &b"(1700000000.000000) can0 702#00\n(1700000000.500000) can0 182#08A01F0020\n"[..];
//! # let mut printed = Vec::new();
//! # macro_rules! println { ($($part:tt)*) => { printed.push(format!($($part)*)) } }
//! // let capture = std::fs::File::open("customer.log")?;
//! let mut reading = Reading::builder().device(NodeId::Canopen(2), "rexroth-sydfec").build(|event: &Event, bus: &Bus| {
//!     println!("{} {}", bus.name(), event.kind.name());
//!     for signal in event.decode_signals() {
//!         println!("  {} = {}", signal.name().unwrap_or_default(), signal.text());
//!     }
//! })?;
//! reading.run(capture)?;
//! let findings = reading.finish().findings;
//! for group in findings.reported_groups() {
//!     println!("{}: {} [{}]", group.severity.name(), group.text, group.rule);
//! }
//! # assert_eq!(printed[0], "can0 boot-up");
//! # assert_eq!(printed[5], "  Angle actual value = 49.4 %", "{printed:?}");
//! # Ok(())
//! # }
//! ```
//!
//! # Starting points
//!
//! | task | start at |
//! | --- | --- |
//! | Read a capture | [`Reading::run`], example `print_events` |
//! | Values of PDOs and messages, with units | [`Event::decode_signals`], [`DecodedSignal`], example `signal_table` |
//! | Findings, for example in CI | [`Summary::findings`], [`Severity`], example `findings` |
//! | Frames of a live bus | [`Reading::push`], [`Reading::advance`], example `live_frames` |
//! | Names, devices, bit rates, databases | [`ReadingBuilder`] |
//! | Statistics, stories, comparisons in the same pass | [`reading::ReadingPart`] |
//! | State of nodes and objects | [`Bus`], [`Node`] |
//! | Filter events by an expression | [`Filter`] |
//! | Write JSON Lines, text, CSV, MCAP, Parquet | [`sink`] |
//! | Frames only, or writing captures | [`capture`] |
//! | Individual stages | [`capture::CaptureReader`], [`Decoder`] |
//!
//! # Structure
//!
//! ```text
//! bytes ─capture─▶ Frame ─session: route─▶ wire ─▶ Message ─session (+ profile)─▶ Event ─rules─▶ Finding ─▶ sink, query, statistics
//! ```
//!
//! Each module is one of these arrows and imports only modules to the left of it; [`reading`] imports all.
//! The crate opens no file, reads no clock and starts no thread: all times are those of the frames. Malformed
//! input never causes a panic and never stops decoding: it results in an event.
//!
//! # Features
//!
//! All features are enabled by default: `gzip` and `zstd` (compressed captures), `mcap` (reads and writes
//! MCAP), `parquet` (writes Parquet). Without a C compiler, `rust-codecs` reads zstd and LZ4.

pub mod answers;
mod ascii;
pub mod bus_file;
pub mod capture;
pub mod comparison;
pub mod conclusion;
pub mod decoder;
pub mod diagnosis;
pub mod escape;
pub mod event;
pub mod figures;
pub mod finding;
pub mod frame;
mod marked_line;
mod observation;
pub mod profile;
pub mod query;
pub mod reading;
pub mod replay;
pub mod report;
pub mod rules;
pub mod samples;
pub mod series;
pub mod session;
pub mod sink;
pub mod standard_tables;
pub mod statistics;
pub mod suggestion;
pub mod why;
pub mod wire;
pub mod words;

pub use decoder::Decoder;
pub use event::{Event, EventKind};
pub use finding::{CaptureFindings, Severity};
pub use frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
pub use profile::DecodedSignal;
pub use query::Filter;
pub use reading::{Reading, ReadingBuilder, ReadingError, Summary};
pub use session::{Bus, Node, Observer};
pub use wire::NodeId;

#[cfg(test)]
#[path = "../../tests/decoder/inside/mod.rs"]
mod inside;
