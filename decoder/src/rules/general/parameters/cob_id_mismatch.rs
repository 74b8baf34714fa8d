//! Identifiers in use against the COB-ID objects.

use crate::event::{Event, EventKind, Kind, SdoDirection, SdoTransfer};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::rules::general::facts::{cob_identifier, confirmed_number, transfer_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The first SDO server must use the identifiers in 1200:01 and 1200:02. EMCY must use the identifier in
    /// 1014, and must not be sent while 1014 is marked invalid.
    ///
    /// # Why it matters
    /// A tool that reads these objects uses wrong identifiers.
    ///
    /// # Source
    /// CiA 301 §7.5.2.16 (1014), §7.5.2.33 (1200), §7.3.3 (predefined connection set)
    ///
    /// # What to look at first
    /// Check whether the node-ID changed after configuration. Check for a second device on the identifier.
    ///
    /// # Mutation
    /// change the identifier in the response to an upload of 1200:01
    "cob-id-mismatch", Warning, "service on another identifier than configured",
    kinds: [Kind::SdoTransfer, Kind::Emcy, Kind::NodeIdChange],
    transfers: TransferSubset::Communication,
    needs: "1014:00 or 1200, and the service that uses it",
    cases: &["2.12", "5.1", "6.1", "7.4"],
    word: "COBID",
}

const EMCY_ID: ObjectAddress = ObjectAddress::new(0x1014, 0);

#[derive(Default)]
struct CobIdMismatch {
    /// Frame of the latest node-ID change; values read earlier may be outdated.
    moved: NodeMap<u64>,
}

fn new(_policy: &RulePolicy) -> CobIdMismatch {
    CobIdMismatch::default()
}

impl CobIdMismatch {
    fn check_server(event: &Event, transfer: &SdoTransfer, context: &mut RuleContext<'_>) {
        let used = match transfer.object.map(|object| (object.index, object.sub)) {
            Some((0x1200, 1)) => transfer.request,
            Some((0x1200, 2)) => transfer.response,
            _ => return,
        };
        let is_read = transfer.direction == Some(SdoDirection::Upload);
        let Some(cob_id) = transfer_number(transfer).filter(|_| is_read) else { return };
        if cob_identifier(cob_id) == Some(used) {
            return context.count_pass();
        }
        // Otherwise another SDO channel of the same server is in use.
        let predefined = event.node.and_then(NodeId::canopen).is_some_and(|node| {
            let offset = if used == transfer.request { 0x600 } else { 0x580 };
            used == CanId::from_standard(offset + u16::from(node))
        });
        if predefined {
            let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
            alarm.report_finding(|| format!("{cob_id:X}h, but the server uses {used}"));
        }
    }

    fn check_emcy(&self, event: &Event, used: CanId, context: &mut RuleContext<'_>) {
        let Some(node) = context.event_node(event) else { return };
        let is_old = |frame: u64| self.moved.get(node.id()).is_some_and(|moved| frame < *moved);
        let known = node.store().seen_value(EMCY_ID).filter(|entry| !is_old(entry.origin.frame));
        let Some(cob_id) = known.and_then(|_| confirmed_number(node, EMCY_ID.index, EMCY_ID.sub)) else {
            let default = CanId::from_standard(0x80 + u16::from(node.id().number()));
            if used == default {
                context.count_pass();
            }
            return;
        };
        if cob_identifier(cob_id) == Some(used) {
            return context.count_pass();
        }
        let alarm = context.start_finding(event).with_subject(FindingSubject::Id(used));
        alarm.report_finding(|| format!("EMCY on {used} (1014:00 = {cob_id:X}h)"));
    }
}

impl Rule for CobIdMismatch {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::SdoTransfer(transfer) => Self::check_server(event, transfer, context),
            EventKind::Emcy(emergency) => self.check_emcy(event, emergency.cob_id, context),
            EventKind::NodeIdChange { .. } => {
                if let Some(moved) = event.node.and_then(|node| self.moved.entry(node)) {
                    *moved = event.frames.last;
                }
            }
            _ => {}
        }
    }
}
