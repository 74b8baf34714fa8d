//! The rules devices bring: `[[rule]]` of their profiles.
//!
//! ```text
//! Event ─DeviceRules─▶ nodes it concerns ─NodeJudge─▶ TriggerEvent ─kinds─▶ one file per family of kinds ─▶ Context
//! ```
//!
//! The rules of a device begin to act when a node is known to be that device. `profile/device/rule.rs` defines the
//! kinds of rules, `profile/device/evaluate/` the operators of triggers and conditions; nothing here knows a device.
//!
//! A file imports only from files above it:
//!
//! | file | holds |
//! | --- | --- |
//! | `info` | name, severity and documentation of a rule |
//! | `plan` | what the rules of a device look at |
//! | `carrier` | what they look at in a PDO or message of one layout |
//! | `proofs` | cached results of conditions |
//! | `progress`, `node` | what is remembered of a rule, of a node |
//! | `describe`, `transfer` | events and values as text; transfers as updates |
//! | `facts`, `conditions` | proven facts, and conditions on them |
//! | `case`, `kinds/` | a rule at a node, and how each kind of rule is judged |
//! | `node_judge` | an event at a node |
//! | `pdo_targets`, `carried` | a PDO or message at a node |
//! | `roster`, `dispatch` | the nodes of a bus, and which of them an event concerns |

mod carried;
mod carrier;
mod case;
mod conditions;
mod describe;
mod dispatch;
mod facts;
mod info;
mod kinds;
mod node;
mod node_judge;
mod pdo_targets;
mod plan;
mod progress;
mod proofs;
mod roster;
mod transfer;

pub(super) use dispatch::DeviceRules;
pub(super) use roster::may_attach;
