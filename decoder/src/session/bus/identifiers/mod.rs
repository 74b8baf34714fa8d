//! Services of identifiers, SDO channels, ISO-TP links, and the configured users of PDO identifiers.

mod channels;
mod last_payload;
mod link;
mod pdo_users;
mod plan;
mod routes;
mod shared_gap;

pub(in crate::session) use channels::SdoChannels;
pub(in crate::session) use last_payload::LastPayload;
pub(in crate::session) use link::{UdsLink, UdsPairs};
pub(in crate::session) use pdo_users::{PdoUsers, Users};
pub(in crate::session) use plan::{IdentifierPlan, RecentFrames, WatchPlan};
pub(in crate::session) use routes::{IdentifierRoutes, IdentifierService, IdentifierState, RouteOrigin};
pub(in crate::session) use shared_gap::shared_gap;
