//! Relevant changes before a fault: the last few of a node and of its bus.

use std::collections::VecDeque;

use crate::event::{ClaimAction, DtcAction, Event, EventKind, SdoDirection, SdoOutcome, StateCause};
use crate::wire::NodeId;

/// Maximum number of changes per node, and of events per moment.
pub const SHOWN: usize = 10;

/// Maximum number of data bytes of a transfer.
const DATA: usize = 256;

/// Scope of a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ChangeScope {
    /// One node.
    Node(NodeId),
    /// The whole bus.
    Bus,
}

/// Scope of an event that is a relevant change; `None` for repetitions, PDOs, successful reads and the like.
pub(super) fn change_scope(event: &Event) -> Option<ChangeScope> {
    let is_relevant = match &event.kind {
        EventKind::NmtCommand { target, .. } => {
            return Some(if *target == 0 { ChangeScope::Bus } else { ChangeScope::Node((*target).into()) });
        }
        EventKind::CanError(error) if error.is_only_counters() => return None,
        EventKind::CanError(_)
        | EventKind::BusSilent { .. }
        | EventKind::LostFrames { .. }
        | EventKind::Link { .. } => {
            return Some(ChangeScope::Bus);
        }
        EventKind::Sync { expected, .. } => return expected.map(|_| ChangeScope::Bus),
        // States that follow from a command or a boot-up are already in the line of that event.
        EventKind::NmtState(change) => !is_known_otherwise(change.cause),
        EventKind::GuardReply { toggle_error, .. } => *toggle_error,
        EventKind::SdoTransfer(transfer) => {
            // A read matters only if there is no response.
            let is_write = transfer.direction == Some(SdoDirection::Download);
            transfer.waited.is_some()
                || is_write
                    && matches!(
                        transfer.outcome,
                        SdoOutcome::Complete | SdoOutcome::Aborted | SdoOutcome::Timeout
                    )
        }
        // Previously active faults and responses to a global request for address claimed are not changes.
        EventKind::Dtc(dtc) => dtc.action != DtcAction::PreviouslyActive,
        EventKind::AddressClaim(claim) => claim.action != ClaimAction::Confirmed,
        EventKind::BootUp { .. }
        | EventKind::NodeLost(_)
        | EventKind::NodeBack(_)
        | EventKind::Emcy(_)
        | EventKind::NodeIdChange { .. }
        | EventKind::DeviceState(_)
        | EventKind::BitsChanged(_)
        | EventKind::SetPoint(_)
        | EventKind::Mode(_)
        | EventKind::Procedure(_)
        | EventKind::CommandedAddress(_)
        | EventKind::MessageGap(_) => true,
        _ => false,
    };
    event.node.filter(|_| is_relevant).map(ChangeScope::Node)
}

/// Whether `new` makes `old` redundant.
fn makes_redundant(new: &EventKind, old: &EventKind) -> bool {
    match (new, old) {
        (EventKind::SetPoint(new), EventKind::SetPoint(old)) => {
            (new.object, new.channel, &new.carrier) == (old.object, old.channel, &old.carrier)
        }
        (EventKind::BitsChanged(new), EventKind::BitsChanged(old)) => {
            (new.object, &new.set, &new.cleared) == (old.object, &old.set, &old.cleared)
        }
        (EventKind::Emcy(new), EventKind::Emcy(old)) => (new.code, new.action) == (old.code, old.action),
        (EventKind::Dtc(new), EventKind::Dtc(old)) => {
            (new.spn, new.fmi, new.action) == (old.spn, old.fmi, old.action)
        }
        (EventKind::MessageGap(new), EventKind::MessageGap(old)) => {
            (&new.message, new.source) == (&old.message, old.source)
        }
        (EventKind::SdoTransfer(new), EventKind::SdoTransfer(old)) => {
            (new.object, new.outcome) == (old.object, old.outcome)
        }
        (EventKind::CanError(new), EventKind::CanError(old)) => {
            (new.classes, new.controller) == (old.classes, old.controller)
        }
        (
            EventKind::NmtCommand { service: new, target: to, .. },
            EventKind::NmtCommand { service: old, target: of, .. },
        ) => (new, to) == (old, of),
        (EventKind::Sync { .. }, EventKind::Sync { .. })
        | (EventKind::GuardReply { .. }, EventKind::GuardReply { .. }) => true,
        _ => false,
    }
}

/// The last changes of a node or of a bus, with their sequence numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct RecentChanges(VecDeque<(u64, Event)>);

impl RecentChanges {
    /// Adds a change; `sequence` counts all events of the bus.
    pub(super) fn add_change(&mut self, sequence: u64, event: &Event) {
        if let Some(place) = self.0.iter().position(|(_, old)| makes_redundant(&event.kind, &old.kind)) {
            self.0.remove(place);
        }
        self.0.push_back((sequence, shorten_event(event)));
        if self.0.len() > SHOWN {
            self.0.pop_front();
        }
    }

    /// Last changes of several lists after event number `after`, oldest first.
    pub(super) fn last_changes<'a>(lists: impl IntoIterator<Item = &'a Self>, after: u64) -> Vec<Event> {
        let all = lists.into_iter().flat_map(|list| &list.0).filter(|(sequence, _)| *sequence > after);
        let mut all: Vec<_> = all.collect();
        all.sort_by_key(|(sequence, _)| *sequence);
        let old = all.len().saturating_sub(SHOWN);
        all.into_iter().skip(old).map(|(_, event)| event.clone()).collect()
    }
}

/// The event with long data truncated.
pub(super) fn shorten_event(event: &Event) -> Event {
    match &event.kind {
        EventKind::SdoTransfer(transfer) if transfer.data.len() > DATA => {
            let mut transfer = transfer.clone();
            transfer.data.truncate(DATA);
            transfer.data.shrink_to_fit();
            transfer.truncated = true;
            if let Some(previous) = &mut transfer.previous {
                previous.truncate(DATA);
            }
            Event { kind: EventKind::SdoTransfer(transfer), ..event.clone() }
        }
        _ => event.clone(),
    }
}

/// Whether another line states the change: the command, the boot-up, or the bus file.
const fn is_known_otherwise(cause: StateCause) -> bool {
    matches!(cause, StateCause::Command | StateCause::BootUp | StateCause::BusFile { .. })
}
