//! Dispatch of bus events to nodes with device rules.

use super::case::RuleCase;
use super::kinds::{self, frames};
use super::node_judge::CheckOccasion;
use super::pdo_targets::{IdentifierTargets, PdoTargets};
use super::roster::{NodeRoster, may_attach};
use crate::event::{DecodedPdo, Event, EventKind, J1939Message, KindSet};
use crate::frame::CanId;
use crate::profile::device::DeviceRule;
use crate::rules::ledger::FindingLedger;
use crate::rules::need::FrameNeed;
use crate::rules::{Rule, RuleContext};
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::j1939::ALL;

/// Rules of all devices on a bus.
pub(in crate::rules) struct DeviceRules {
    roster: NodeRoster,
    targets: PdoTargets,
}

impl DeviceRules {
    /// Creates the rules for the devices already identified on a bus.
    pub(in crate::rules) fn new(bus: &Bus, ledger: &mut FindingLedger) -> Self {
        let mut roster = NodeRoster::default();
        roster.attach_rules(bus, ledger);
        Self { roster, targets: PdoTargets::default() }
    }

    /// Event kinds that the rules need.
    pub(in crate::rules) fn needed_kinds(&self) -> KindSet {
        self.roster.needed_kinds()
    }

    fn on_pdo(&mut self, pdo: &DecodedPdo, event: &Event, context: &mut RuleContext<'_>) {
        let Some(place) = context.traffic.current_slot().map(|slot| slot.place) else { return };
        if self.targets.get(place, pdo).is_none() {
            let nodes = &mut self.roster.nodes;
            let targets = IdentifierTargets::new((place, pdo), event, nodes, context.bus);
            self.targets.put_targets(place, targets);
        }
        let Some(known) = self.targets.get(place, pdo) else { return };
        for target in &known.targets {
            self.roster.judge_at(target.id, context.bus, |judge| judge.on_pdo(target, pdo, event, context));
        }
        if known.is_reserved {
            let id = pdo.cob_id;
            self.judge_reserved(Some(id), event, context, &|case, context| {
                frames::judge_pdo_id(case, pdo, context);
            });
        }
    }

    /// Forgets which rules concern a PDO, after a change of identifiers or rules.
    #[cold]
    fn clear_targets(&mut self, context: &mut RuleContext<'_>) {
        self.targets.clear();
        self.roster.drop_carriers();
        context.ask_again();
    }

    fn on_message(&mut self, message: &J1939Message, event: &Event, context: &mut RuleContext<'_>) {
        let bus = context.bus;
        for place in 0..self.roster.ids.len() {
            let Some(id) = self.roster.ids.get(place).copied() else { return };
            let Some(address) = id.j1939() else { continue };
            self.roster.judge_at(id, bus, |judge| judge.on_message(address, message, event, context));
        }
    }

    /// Handles all events other than PDOs, messages and frames.
    fn on_other(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let bus = context.bus;
        match &event.kind {
            EventKind::NmtCommand { target: 0, .. } | EventKind::Lss { .. } | EventKind::Sync { .. } => {
                let is_sync = matches!(event.kind, EventKind::Sync { .. });
                for place in 0..self.roster.ids.len() {
                    let id = self.roster.ids.get(place).copied().filter(|id| id.canopen().is_some());
                    if let Some(id) = id.filter(|id| !is_sync || self.roster.waits_for_sync(*id)) {
                        self.roster.judge_at(id, bus, |judge| judge.on_event(event, context));
                    }
                }
            }
            EventKind::BusSilent { .. } | EventKind::LostFrames { .. } | EventKind::Link { .. } => {
                for id in self.roster.ids.clone() {
                    self.roster.judge_at(id, bus, |judge| judge.own.interrupt_measurements());
                }
            }
            EventKind::J1939Request(request) => {
                for id in self.roster.ids.clone() {
                    let is_asked = id.j1939().is_some_and(|own| [own, ALL].contains(&request.destination));
                    if is_asked {
                        self.roster.judge_at(id, bus, |judge| judge.on_request(request.pgn, event, context));
                    }
                }
            }
            EventKind::SdoTransfer(transfer) => {
                if transfer.object.is_some_and(|object| holds_id(object.index)) {
                    self.clear_targets(context);
                }
                self.on_node_event(event, context);
                self.judge_reserved(None, event, context, &|case, context| {
                    frames::judge_cob_id(case, transfer, context);
                });
            }
            EventKind::BootUp { .. } => {
                self.forget_identifiers(event, context);
                self.on_node_event(event, context);
            }
            EventKind::Emcy(emergency) => {
                if emergency.boot.is_some() {
                    self.forget_identifiers(event, context);
                }
                self.on_node_event(event, context);
            }
            _ => self.on_node_event(event, context),
        }
    }

    /// After a restart, identifiers fall back to the stored ones.
    fn forget_identifiers(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if event.node.is_some_and(|id| self.roster.nodes.get(id).is_some()) {
            self.clear_targets(context);
        }
    }

    fn on_node_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let bus = context.bus;
        if let Some(id) = event.node {
            self.roster.judge_at(id, bus, |judge| judge.on_event(event, context));
        }
    }

    /// Runs `reserved-id` rules at the first device that has one; with `can_id`, only the rules that reserve
    /// it.
    fn judge_reserved(
        &mut self,
        can_id: Option<CanId>,
        event: &Event,
        context: &mut RuleContext<'_>,
        task: &dyn Fn(&RuleCase<'_>, &mut RuleContext<'_>),
    ) {
        let is_about = |rule: &DeviceRule| {
            can_id.is_none_or(|can_id| frames::is_reserved(rule, can_id)) && rule.ids.is_some()
        };
        let nodes = &self.roster.nodes;
        let has_rule = |id: &NodeId| {
            nodes.get(*id).is_some_and(|own| own.record.plan.active_rules().any(|(_, rule)| is_about(rule)))
        };
        let Some(id) = self.roster.ids.iter().copied().find(has_rule) else { return };
        let bus = context.bus;
        self.roster.judge_at(id, bus, |judge| {
            for number in judge.active_rules(is_about) {
                judge.judge_one(number, CheckOccasion::occasion_of(event), context, |case, _, context| {
                    task(case, context);
                });
            }
        });
    }
}

/// Whether an object may contain an identifier.
const fn holds_id(index: u16) -> bool {
    matches!(index, 0x1005 | 0x1012 | 0x1014 | 0x1400..=0x1BFF)
}

impl Rule for DeviceRules {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if may_attach(&event.kind) {
            self.roster.move_node(event);
            self.roster.attach_rules(context.bus, context.ledger);
            self.clear_targets(context);
        }
        match &event.kind {
            EventKind::Pdo(pdo) => self.on_pdo(pdo, event, context),
            EventKind::J1939Message(message) => self.on_message(message, event, context),
            EventKind::Frame(undecoded) => {
                let frame = &undecoded.frame;
                self.judge_reserved(Some(frame.id), event, context, &|case, context| {
                    frames::judge_frame(case, frame, context);
                });
            }
            _ => self.on_other(event, context),
        }
    }

    fn changed_kinds(&self) -> Option<KindSet> {
        Some(self.needed_kinds())
    }

    fn frame_need(&self, event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let EventKind::Pdo(pdo) = &event.kind else { return FrameNeed::EACH };
        let known = context.traffic.current_slot().and_then(|slot| self.targets.get(slot.place, pdo));
        if known.is_some_and(IdentifierTargets::is_empty) { FrameNeed::NOTHING } else { FrameNeed::EACH }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let mut ids = self.roster.ids.iter().copied();
        let Some(id) = ids.find(|id| id.table_place() as u64 == token >> 16) else { return };
        let Ok(number) = usize::try_from(token & 0xFFFF) else { return };
        let bus = context.bus;
        self.roster.judge_at(id, bus, |judge| {
            judge.judge_one(number, CheckOccasion::of_time(bus), context, kinds::on_deadline);
        });
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        let bus = context.bus;
        for id in self.roster.ids.clone() {
            self.roster.judge_at(id, bus, |judge| {
                judge.note_last_frame(context);
                for number in judge.active_rules(|_| true) {
                    judge.judge_one(number, CheckOccasion::of_time(bus), context, kinds::on_end);
                }
            });
        }
    }
}
