//! The pass over a capture: frames to events, rules, findings and whatever the caller adds.
//!
//! ```text
//! Reading::builder() ─▶ Reading ─┬─ run(source)                 a file
//!                                ├─ take(batch), close          a reader of the caller
//!                                ├─ push, advance, close        live buses
//!                                └─ PlacedReading::step         positions, for a display
//!                                                 │
//!               frames ─▶ Decoder ─▶ JudgedPart: rules + ReadingPart ─▶ Summary
//! ```

mod builder;
mod error;
mod part;
mod parts;
mod pass;
mod placed;
mod short_path;
mod signal_list;
mod stories;
mod survey;

pub use builder::ReadingBuilder;
pub use error::ReadingError;
pub use part::{Borrowed, FrameDemand, ReadingPart};
pub use pass::{Reading, Summary};
pub use placed::{PlacedReading, PlacedSummary};
pub use signal_list::{ListedSignal, MOST_SIGNALS, SignalList};
pub use stories::{diagnosis, diagnosis_of};
pub use survey::{
    BoundedList, MOST_ERRORS, MOST_NMT, MOST_OPENED, MOST_TRANSFERS, NmtMoment, OpenedFinding, Survey,
    TransferRow, bit_rate_change,
};
