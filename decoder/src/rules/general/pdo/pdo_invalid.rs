//! PDOs whose COB-ID is marked as not valid.

use crate::event::{DecodedPdo, Event, EventKind, FrameRange, Kind, SdoDirection, SdoTransfer};
use crate::finding::{FindingSubject, Severity};
use crate::frame::CanId;
use crate::profile::{PdoName, WriteEffect};
use crate::rules::general::facts::{INVALID, cob_identifier, transfer_number};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

declare_rule! {
    /// # What it checks
    /// A node sends a TPDO more than `send-ms` after bit 31 of its COB-ID (18xx:01) was set. An RPDO is sent
    /// to an operational node more than `receive-ms` after bit 31 of 14xx:01 was set, and no other node is
    /// configured to receive the identifier.
    ///
    /// # Why it matters
    /// The PDO does not exist: values of such a TPDO may have another mapping than expected, and such an RPDO
    /// has no effect.
    ///
    /// # Source
    /// CiA 301 §7.5.2.35, §7.5.2.37 (bit 31: the PDO does not exist)
    ///
    /// # What to look at first
    /// Clear bit 31 after the configuration. Check whether a second device uses the identifier.
    ///
    /// # Mutation
    /// write bit 31 of a TPDO's COB-ID while the TPDO continues
    "pdo-invalid", Error, "PDO sent although marked as not valid",
    kinds: [Kind::Pdo, Kind::SdoTransfer, Kind::BootUp, Kind::NodeIdChange],
    transfers: TransferSubset::Communication,
    needs: "a PDO with bit 31 of its COB-ID set",
    cases: &["3.4", "3.20"],
    is_timing: true,
    word: "PDO",
    tolerances: &[
        define_tolerance("send-ms", 20.0, "ms", "after bit 31 of 18xx:01 was set, in which a queued TPDO is permitted"),
        define_tolerance("receive-ms", 1_000.0, "ms", "after bit 31 of 14xx:01 was set, in which RPDOs are permitted"),
    ],
}

/// Maximum number of PDOs per bus; further ones are not checked.
const PDO_LIMIT: usize = 1024;

/// A PDO with bit 31 set.
struct InvalidPdo {
    name: PdoName,
    node: NodeId,
    id: CanId,
    since: i64,
    frame: u64,
}

struct PdoInvalid {
    send: i64,
    receive: i64,
    all: Vec<InvalidPdo>,
}

fn new(policy: &RulePolicy) -> PdoInvalid {
    PdoInvalid {
        send: policy.tolerance_ns(&DECLARATION, "send-ms"),
        receive: policy.tolerance_ns(&DECLARATION, "receive-ms"),
        all: Vec::new(),
    }
}

impl PdoInvalid {
    /// Updates a PDO after its COB-ID was written or read.
    #[cold]
    fn on_cob_id(
        &mut self,
        event: &Event,
        (name, node): (PdoName, NodeId),
        cob_id: u64,
        context: &mut RuleContext<'_>,
    ) {
        let invalid = Some(cob_id).filter(|cob_id| cob_id & INVALID != 0);
        let place = self.all.iter().position(|known| (known.name, known.node) == (name, node));
        let id = invalid.and_then(|cob_id| cob_identifier(cob_id & !INVALID));
        match (place, id) {
            (Some(place), None) => {
                self.all.swap_remove(place);
            }
            (None, Some(id)) if self.all.len() < PDO_LIMIT => {
                let (since, frame) = (context.now, event.frames.last);
                self.all.push(InvalidPdo { name, node, id, since, frame });
                context.count_pass();
            }
            _ => {}
        }
    }

    #[cold]
    fn judge_pdo(&self, event: &Event, pdo: &DecodedPdo, node: NodeId, context: &mut RuleContext<'_>) {
        let is_same =
            |known: &&InvalidPdo| (known.name, known.node, known.id) == (pdo.name, node, pdo.cob_id);
        let Some(known) = self.all.iter().find(is_same) else { return };
        let after = context.now.saturating_sub(known.since);
        let (limit, severity) =
            if pdo.name.is_sent() { (self.send, Severity::Error) } else { (self.receive, Severity::Warning) };
        if after <= limit || (!pdo.name.is_sent() && !is_unheard(node, pdo, context)) {
            return;
        }
        let frames = FrameRange { first: known.frame, last: event.frames.last };
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Id(pdo.cob_id))
            .with_severity(severity)
            .with_frames(frames);
        alarm.report_finding(|| {
            let (name, object) = (pdo.name, pdo.name.communication_index());
            let (ms, limit, frame) = (after / 1_000_000, limit / 1_000_000, known.frame);
            let consumer = if name.is_sent() { "" } else { ", no known consumer" };
            format!("{name} sent {ms} ms after bit 31 of {object:04X}:01 was set {{{frame}}} (limit {limit} ms){consumer}")
        });
    }
}

/// Whether an RPDO reaches an operational node that does not receive it, and no other one.
fn is_unheard(node: NodeId, pdo: &DecodedPdo, context: &RuleContext<'_>) -> bool {
    let is_operational = context.confirmed_state(node) == Some(NmtState::Operational);
    let users = context.bus.node_table().pdo_users(pdo.cob_id);
    is_operational && !context.is_tested && users.iter().all(|(name, _)| name.is_sent())
}

/// PDO of a COB-ID object.
fn of_cob_id(object: ObjectAddress) -> Option<PdoName> {
    let name = PdoName::of_parameter(object.index).filter(|_| object.sub == 1)?;
    (name.communication_index() == object.index).then_some(name)
}

/// Whether the value of a transfer is in effect: it was read, or the device does not wait for a restart.
fn is_effective(transfer: &SdoTransfer, node: NodeId, context: &RuleContext<'_>) -> bool {
    let entry = |object| context.bus.node(node)?.device().dictionary.find_object(object)?.entry;
    let effect = transfer.object.and_then(entry).map(|entry| entry.effect);
    transfer.direction == Some(SdoDirection::Upload) || !effect.is_some_and(WriteEffect::needs_restart)
}

impl Rule for PdoInvalid {
    fn wants_pdos(&self) -> bool {
        !self.all.is_empty()
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request && !self.all.is_empty() => {
                self.judge_pdo(event, pdo, node, context);
            }
            EventKind::SdoTransfer(transfer) => {
                let Some(name) = transfer.object.and_then(of_cob_id) else { return };
                if let Some(cob_id) =
                    transfer_number(transfer).filter(|_| is_effective(transfer, node, context))
                {
                    self.on_cob_id(event, (name, node), cob_id, context);
                }
            }
            EventKind::BootUp { .. } | EventKind::NodeIdChange { .. } => {
                self.all.retain(|known| known.node != node);
            }
            _ => {}
        }
    }
}
