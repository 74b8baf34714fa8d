//! Settings that a restart erased and that were not rewritten before the start.

use crate::event::{BootCause, ChangeOrigin, Event, EventKind, FrameRange, Kind, SdoOutcome, SdoTransfer};
use crate::finding::Severity;
use crate::profile::{ObjectRole, Persistence};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// Settings in RAM, or in objects that are stored on command only (1010), were written in this capture
    /// and lost by a restart. The node becomes operational before they are rewritten. It is a warning if the
    /// master commanded the restart.
    ///
    /// # Why it matters
    /// The node works with other settings than the controller assumes, or does not send at all.
    ///
    /// # Source
    /// Storage of each object: manual of the device. CiA 301 §7.3.2.2 (initialisation), §7.5.2.13 (1010).
    ///
    /// # What to look at first
    /// Let the controller write its configuration at each boot-up. Find the cause of the restart.
    ///
    /// # Mutation
    /// insert a boot-up and a start after the configuration
    "config-lost", Error, "settings lost at restart and not rewritten",
    kinds: [
        Kind::SdoTransfer, Kind::ObjectChange, Kind::BootUp, Kind::Emcy, Kind::NmtCommand, Kind::NmtState,
    ],
    needs: "written settings in RAM, a restart, then operational",
    word: "LOST",
}

/// Maximum number of settings per node.
const SETTING_LIMIT: usize = 1024;

/// Maximum number of objects listed in the finding.
const NAMED: usize = 6;

/// End of the objects that a communication reset affects (CiA 301 §7.3.2.2.2).
const COMMUNICATION_END: u16 = 0x2000;

#[derive(Default)]
struct NodeSettings {
    written: Vec<ObjectAddress>,
    lost: Vec<ObjectAddress>,
    /// Frame of the latest boot-up, and whether it was commanded.
    boot: Option<(u64, bool)>,
    /// The latest reset was a communication reset.
    communication_only: bool,
}

#[derive(Default)]
struct ConfigLost {
    nodes: NodeMap<NodeSettings>,
}

fn new(_policy: &RulePolicy) -> ConfigLost {
    ConfigLost::default()
}

impl ConfigLost {
    fn on_written(&mut self, event: &Event, node: NodeId, transfer: &SdoTransfer, context: &RuleContext<'_>) {
        let (SdoOutcome::Complete, Some(object)) = (transfer.outcome, transfer.object) else { return };
        if !matches!(transfer.persists, Some(Persistence::No | Persistence::NeedsSave)) {
            return;
        }
        let meaning = context.event_node(event).and_then(|node| node.meaning(object));
        let role = meaning.and_then(|meaning| meaning.role);
        // Commands and measured values are not settings.
        if matches!(
            role,
            Some(ObjectRole::Control | ObjectRole::SetPoint | ObjectRole::Status | ObjectRole::Actual)
        ) {
            return;
        }
        let Some(settings) = self.nodes.entry(node) else { return };
        settings.lost.retain(|lost| *lost != object);
        if settings.written.len() < SETTING_LIMIT && !settings.written.contains(&object) {
            settings.written.push(object);
        }
    }

    fn on_boot(&mut self, event: &Event, node: NodeId, cause: BootCause) {
        let Some(settings) = self.nodes.get_mut(node) else { return };
        let is_commanded = matches!(cause, BootCause::Commanded { .. });
        settings.communication_only &= is_commanded;
        settings.boot = Some((event.frames.last, is_commanded));
    }

    fn fell_back(&mut self, node: NodeId, object: ObjectAddress) {
        let Some(settings) = self.nodes.get_mut(node) else { return };
        // For other objects, the effect of a communication reset is only presumed.
        let is_certain = !settings.communication_only || object.index < COMMUNICATION_END;
        if is_certain && settings.written.contains(&object) && !settings.lost.contains(&object) {
            settings.lost.push(object);
        }
    }

    fn on_command(&mut self, target: u8, service: NmtService) {
        let note = |settings: &mut NodeSettings| match service {
            NmtService::ResetCommunication => settings.communication_only = true,
            NmtService::ResetNode => settings.communication_only = false,
            _ => {}
        };
        let all = NodeId::all_ids().filter(|node| match node {
            NodeId::Canopen(number) => target == 0 || *number == target,
            NodeId::J1939(_) => false,
        });
        for node in all {
            if let Some(settings) = self.nodes.get_mut(node) {
                note(settings);
            }
        }
    }

    fn on_start(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let Some(settings) = self.nodes.get_mut(node) else { return };
        let Some((boot, is_commanded)) = settings.boot.take() else { return };
        if settings.written.is_empty() {
            return;
        }
        let mut lost = std::mem::take(&mut settings.lost);
        if lost.is_empty() {
            return context.count_pass();
        }
        settings.written.retain(|object| !lost.contains(object));
        lost.sort_unstable();
        let severity = if is_commanded { Severity::Warning } else { Severity::Error };
        let frames = FrameRange { first: boot, last: event.frames.last };
        let alarm = context.start_finding(event).with_severity(severity).with_frames(frames);
        alarm.report_finding(|| {
            let named: Vec<_> = lost.iter().take(NAMED).map(ToString::to_string).collect();
            let more = if lost.len() > NAMED { ", …" } else { "" };
            let what = if lost.len() == 1 { "setting" } else { "settings" };
            let named = named.join(", ");
            format!("{} {what} lost at restart {{{boot}}} and not rewritten ({named}{more})", lost.len())
        });
    }
}

impl Rule for ConfigLost {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::NmtCommand { target, service, .. } = event.kind {
            return self.on_command(target, service);
        }
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::SdoTransfer(transfer) => self.on_written(event, node, transfer, context),
            EventKind::ObjectChange(change) if change.origin == ChangeOrigin::Reset => {
                self.fell_back(node, change.object);
            }
            EventKind::BootUp { cause, .. } => self.on_boot(event, node, *cause),
            EventKind::Emcy(emergency) => {
                if let Some(cause) = emergency.boot {
                    self.on_boot(event, node, cause);
                }
            }
            EventKind::NmtState(change) if change.to == NmtState::Operational => {
                self.on_start(event, node, context);
            }
            _ => {}
        }
    }
}
