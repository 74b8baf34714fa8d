//! Messages to events: the complete state of a bus.
//!
//! ```text
//! Frame ─BusDecoder::push─▶ clock, deadlines ─▶ route of identifier ─▶ service machine ─▶ Observer::event
//!                                                                        │ Context: bus, timers, observer
//!            bus/ state for observers ◀──────────────────────────────────┘
//! ```
//!
//! A [`BusDecoder`] is cloneable and holds no handles: a clone is a checkpoint. All state is bounded;
//! state over a limit is evicted, with an `evicted` event.

mod bus;
mod buses;
mod canopen;
mod context;
mod decoder;
mod detection;
mod device;
mod given;
mod identity;
mod j1939;
mod learning;
mod limits;
mod machine;
mod objects;
mod observer;
mod options;
mod presence;
mod short_path;
mod snapshot;
mod timers;
mod uds;
mod undecided;

pub use crate::profile::device::GateStatus;
pub use bus::{
    Bus, BusHints, BusNodes, BusProtocols, EmittedSetPoint, GateState, IdentifierRoutes, LifeSign, LifeWatch,
    NmtStatus, Node, ObjectStore, OriginKind, PendingNodeId, PendingValue, SdoPairHint, StoredObject,
    StoredOrigin, UdsPairHint,
};
pub(crate) use bus::{BusStream, ProfileSigns, SkippedTimes, StreamRegularity, StreamService};
pub use buses::Buses;
pub use decoder::BusDecoder;
pub use limits::{
    ACTIVE_ERROR_LIMIT, ADDRESSLESS_LIMIT, CHANNEL_LIMIT, EXCHANGE_LIMIT, EXTENDED_ID_LIMIT, OBJECT_LIMIT,
    OPEN_DATA_LIMIT, TRANSFER_DATA_LIMIT, TRANSPORT_LIMIT,
};

pub use crate::event::AssignedBy;
pub(crate) use limits::CLOCK_SET;
pub use observer::{MessagePreview, NoObserver, Observer};
pub use options::{Assignment, ProtocolChoice, SessionOptions};
pub use snapshot::BusSnapshot;
