//! Rules of devices: `[[rule]]` in their profiles, and of single nodes in the bus file.
//!
//! ```text
//! Event ─DeviceRules─▶ nodes it concerns ─NodeJudge─▶ TriggerEvent ─kinds─▶ one file per family of kinds ─▶ Context
//! ```
//!
//! The rules of a device apply from the moment a node is identified as that device. `profile/device/rule.rs`
//! defines the kinds of rules, `profile/device/evaluate/` the operators of triggers and conditions. Nothing
//! in this folder depends on a particular device.
//!
//! A file imports only from files in rows above its own:
//!
//! | file | content |
//! | --- | --- |
//! | `info` | name, severity and documentation of a rule |
//! | `plan` | objects, PDOs and event kinds that the rules of a device use |
//! | `carrier` | fields that the rules use in a PDO or message of one layout |
//! | `proofs` | cached results of conditions |
//! | `values` | last values in PDOs and messages |
//! | `progress`, `node` | state of a rule, state of a node |
//! | `describe`, `transfer` | events and values as text; transfers as updates |
//! | `facts`, `conditions` | proven facts, and conditions on them |
//! | `case`, `kinds/` | a rule at a node; the checks of each kind of rule |
//! | `node_judge` | an event at a node |
//! | `pdo_targets`, `carried` | a PDO or message at a node |
//! | `roster`, `dispatch` | the nodes of a bus; dispatch of events to nodes |

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
mod values;

pub(super) use dispatch::DeviceRules;
pub(super) use info::node_rule_info;
pub(super) use roster::may_attach;
