//! Services of identifiers, SDO channels and ISO-TP links.

mod channels;
mod last_payload;
mod link;
mod plan;
mod routes;
mod service;
mod shared_gap;

pub(in crate::session) use channels::SdoChannels;
pub(in crate::session) use last_payload::LastPayload;
pub(in crate::session) use link::{UdsLink, UdsPairs};
pub(in crate::session) use plan::{IdentifierPlan, RecentFrames, WatchPlan};
pub use routes::IdentifierRoutes;
pub(in crate::session) use routes::RouteOrigin;
pub(in crate::session) use service::{IdentifierService, SRDO};
