//! Conclusions: what fails in the machine, from the messages of all senders.
//!
//! ```text
//! streams of a bus ─senders─▶ silences ─moments─▶ hypothesis of a node, a group, the wire or the controller
//!                  └─────────▶ single messages: stopped, slower, frozen, sent by two, sent too often
//! ```
//!
//! A rule judges one thing in isolation; a conclusion names the simplest part of the machine that explains what happened to
//! several messages at one moment. Commands explain their consequences. `hypotheses.toml` has the rows, with what the capture must
//! show, what to do and what to record next.

mod commands;
mod drives;
mod failure;
mod hypothesis;
mod messages;
mod reports;
mod silences;

use crate::finding::FindingGroup;
use crate::observation::{NodeMoment, NodeMoments, SenderSilence, observe_senders};
use crate::session::Bus;

pub(crate) use failure::Conclusion;
pub use hypothesis::{ExplainedFindings, Hypothesis, all_hypotheses, find_hypothesis};

/// What fails on a bus up to its last frame; nothing if its clock was set.
pub(crate) fn conclude(bus: &Bus, moments: &NodeMoments, groups: &[FindingGroup]) -> Vec<Conclusion> {
    let end = bus.now();
    // Times before the clock was set have no place on the present one.
    if moments.has_moment(NodeMoment::ClockStep, (bus.index(), None), (i64::MIN, i64::MAX)) {
        return Vec::new();
    }
    let senders = observe_senders(bus);
    let silences: Vec<SenderSilence> = senders.iter().flat_map(|sender| sender.silences(end)).collect();
    let silent = silences::conclude_silences(bus, &senders, silences, moments);
    let mut all = messages::conclude_messages(bus, &senders, &silent.silences, moments);
    // A message that takes the bus delays all others.
    let babbling: Vec<_> =
        all.iter().filter(|one| one.hypothesis == "babbling").map(Conclusion::range).collect();
    let is_free = |one: &Conclusion| !babbling.iter().any(|(from, to)| (*from..=*to).contains(&one.began.0));
    all.retain(|one| one.hypothesis == "babbling" || is_free(one));
    all.extend(silent.conclusions.into_iter().filter(is_free));
    all.extend(commands::conclude_commands(bus, &senders, moments));
    all.extend(drives::conclude_drives(bus));
    all.extend(reports::conclude_reports(bus, &silent.silences, groups));
    all.extend(messages::absent_terminal(bus));
    all.sort_by_key(|conclusion| conclusion.began);
    all
}
