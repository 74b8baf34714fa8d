//! Index of the objects, PDOs and events that the rules of a device use, computed once per device.

use std::sync::Arc;

use super::info;
use crate::event::{Kind, KindSet};
use crate::profile::device::{
    CountWindow, DeviceCondition, DeviceConditions, DeviceRule, ProfileTrigger, ProfileTriggers, RuleKind,
    TriggerEvent, VariableWindow,
};
use crate::profile::{DeviceProfile, ObjectRole, PdoName};
use crate::rules::ledger::FindingLedger;
use crate::wire::canopen::ObjectAddress;

/// Rules of a device with their index.
#[derive(Debug)]
pub(super) struct RulePlan {
    pub(super) device: Arc<DeviceProfile>,
    /// Rules of the bus file for the node; their indices follow those of the profile.
    pub(super) added: Vec<Arc<DeviceRule>>,
    /// Ledger index of each rule, in this order; None for a rule that is switched off.
    pub(super) places: Vec<Option<u16>>,
    /// Objects that rules use, sorted.
    watched: Vec<WatchedObject>,
    /// PDOs that rules use as triggers.
    pub(super) pdos: Vec<PdoName>,
    /// Rules about SYNC.
    pub(super) syncs: Vec<usize>,
    /// Rules that need an update of `while` after every event.
    pub(super) stretches: Vec<usize>,
    /// Rules about events that must not occur.
    pub(super) forbidding: Vec<usize>,
    /// Groups sent on request only, and their rules.
    pub(super) requested: Vec<(u32, usize)>,
    /// Event kinds that the rules need, for CANopen and for J1939 nodes.
    pub(super) kinds: (KindSet, KindSet),
}

/// An object that at least one rule uses.
#[derive(Debug)]
pub(super) struct WatchedObject {
    pub(super) object: ObjectAddress,
    /// Rules that check each value of the object.
    pub(super) rules: Vec<usize>,
    /// Measured value, which expires.
    pub(super) is_measured: bool,
    /// Conditions use the object.
    pub(super) is_condition: bool,
}

impl RulePlan {
    /// Creates the plan of a device with rules of the bus file, and registers all rules in the ledger.
    pub(super) fn new(
        device: &Arc<DeviceProfile>,
        added: Vec<Arc<DeviceRule>>,
        ledger: &mut FindingLedger,
    ) -> Self {
        let mut plan = Self {
            device: Arc::clone(device),
            added: Vec::new(),
            places: Vec::new(),
            watched: Vec::new(),
            pdos: Vec::new(),
            syncs: Vec::new(),
            stretches: Vec::new(),
            forbidding: Vec::new(),
            requested: Vec::new(),
            kinds: (KindSet::NONE, KindSet::NONE),
        };
        let mut kinds = ALWAYS;
        let own = device
            .rules
            .iter()
            .map(|rule| (rule, info::rule_info(device, rule), info::rule_relations(device, rule)));
        let of_node =
            added.iter().map(|rule| (&**rule, info::node_rule_info(rule), info::node_rule_relations(rule)));
        for (number, (rule, info, relations)) in own.chain(of_node).enumerate() {
            let place = ledger.add_rule(info, relations);
            plan.places.push(place);
            if place.is_some() {
                plan.take_rule(number, rule, &mut kinds);
            }
        }
        plan.watched.sort_by_key(|watched| watched.object);
        plan.pdos.sort_unstable();
        plan.pdos.dedup();
        plan.added = added;
        plan.kinds = (kinds.and(OF_J1939.complement()), kinds.and(OF_J1939.or(OF_J1939_AND_CANOPEN)));
        plan
    }

    /// Entry of an object with its index.
    pub(super) fn watched_object(&self, object: ObjectAddress) -> Option<(usize, &WatchedObject)> {
        let place = self.watched.binary_search_by_key(&object, |watched| watched.object).ok()?;
        Some((place, self.watched.get(place)?))
    }

    /// Number of entries.
    pub(super) fn watched_count(&self) -> usize {
        self.watched.len()
    }

    /// A rule and its ledger index; None if it is switched off.
    #[inline]
    pub(super) fn active_rule(&self, number: usize) -> Option<(&DeviceRule, u16)> {
        let place = self.places.get(number).copied().flatten()?;
        Some((self.rule(number)?, place))
    }

    fn rule(&self, number: usize) -> Option<&DeviceRule> {
        let of_node = || Some(&**self.added.get(number.checked_sub(self.device.rules.len())?)?);
        self.device.rules.get(number).or_else(of_node)
    }

    /// All rules in the order of their indices.
    pub(super) fn all_rules(&self) -> impl Iterator<Item = &DeviceRule> {
        self.device.rules.iter().chain(self.added.iter().map(|rule| &**rule))
    }

    /// Active rules with their indices.
    pub(super) fn active_rules(&self) -> impl Iterator<Item = (usize, &DeviceRule)> {
        let on = self.all_rules().zip(&self.places).enumerate();
        on.filter(|(_, (_, place))| place.is_some()).map(|(number, (rule, _))| (number, rule))
    }

    /// Whether a new value of an object may change the `while` of a rule. If all conditions are on lasting
    /// values, only these values can change it.
    pub(super) fn may_begin_or_end(&self, rule: &DeviceRule, object: ObjectAddress) -> bool {
        let concerns = |condition: &DeviceCondition| {
            condition.object().is_none_or(|of| of == object || !self.is_lasting(condition))
        };
        rule.during.0.iter().any(concerns)
    }

    /// Whether a condition is on a value that never expires.
    pub(super) fn is_lasting(&self, condition: &DeviceCondition) -> bool {
        let watched = condition.object().and_then(|object| self.watched_object(object));
        watched.is_some_and(|(_, watched)| !watched.is_measured)
    }

    fn take_rule(&mut self, number: usize, rule: &DeviceRule, kinds: &mut KindSet) {
        for trigger in rule_triggers(rule) {
            *kinds = kinds.or(kinds_of(trigger));
            match trigger {
                ProfileTrigger::Bit(bit, _) => self.watch_object(bit.object.object, Some(number)),
                ProfileTrigger::Set(set) | ProfileTrigger::Shows(set) => {
                    self.watch_object(set.object.object, Some(number));
                }
                ProfileTrigger::Pdo(name) => self.pdos.push(*name),
                _ => {}
            }
        }
        for condition in rule.needs.0.iter().chain(&rule.during.0) {
            self.watch_condition(condition, kinds);
        }
        for object in rule.rule_objects() {
            *kinds = kinds.or(VALUES);
            self.watch_object(object.object, Some(number));
        }
        let own: &[Kind] = match rule.kind {
            RuleKind::ReservedId => &[Kind::Frame, Kind::Pdo, Kind::SdoTransfer],
            RuleKind::Expedited | RuleKind::AbortCode => &[Kind::SdoTransfer],
            RuleKind::RemoteLength => &[Kind::Pdo],
            RuleKind::OnRequest => {
                self.requested.extend(rule.groups.iter().map(|group| (*group, number)));
                &[Kind::J1939Request, Kind::J1939Message, Kind::J1939Transfer]
            }
            RuleKind::UdsServices => &[Kind::UdsExchange],
            RuleKind::MaxCount if rule.per == Some(CountWindow::Variable(VariableWindow::Sync)) => {
                &[Kind::Sync]
            }
            _ => &[],
        };
        *kinds = kinds.or(KindSet::of(own));
        if concerns_rule(rule, &TriggerEvent::Sync) {
            self.syncs.push(number);
        }
        if follows_while(rule) {
            self.stretches.push(number);
        }
        if rule.kind == RuleKind::Never {
            self.forbidding.push(number);
        }
    }

    fn watch_condition(&mut self, condition: &DeviceCondition, kinds: &mut KindSet) {
        if let Some(object) = condition.object() {
            *kinds = kinds.or(VALUES);
            self.watch_object(object, None);
            if let Some(watched) = self.watched.iter_mut().find(|watched| watched.object == object) {
                watched.is_condition = true;
            }
        }
        match condition {
            DeviceCondition::State(_) => *kinds = kinds.or(KindSet::of(&[Kind::DeviceState])),
            DeviceCondition::Other(DeviceConditions(all)) => {
                for one in all {
                    self.watch_condition(one, kinds);
                }
            }
            _ => {}
        }
    }

    fn watch_object(&mut self, object: ObjectAddress, rule: Option<usize>) {
        let known = self.watched.iter().position(|watched| watched.object == object);
        let place = known.unwrap_or(self.watched.len());
        if known.is_none() {
            let entry = self.device.dictionary.find_object(object).and_then(|found| found.entry);
            let is_measured = entry.is_some_and(|entry| entry.look.role == Some(ObjectRole::Actual));
            self.watched.push(WatchedObject { object, rules: Vec::new(), is_measured, is_condition: false });
        }
        if let (Some(watched), Some(rule)) = (self.watched.get_mut(place), rule)
            && !watched.rules.contains(&rule)
        {
            watched.rules.push(rule);
        }
    }
}

/// Event kinds that the rules of each device need.
const ALWAYS: KindSet = KindSet::of(&[
    Kind::BootUp,
    Kind::Emcy,
    Kind::NmtCommand,
    Kind::NmtState,
    Kind::NodeLost,
    Kind::BusSilent,
    Kind::LostFrames,
    Kind::Link,
]);

/// Event kinds of J1939 nodes only.
const OF_J1939: KindSet =
    KindSet::of(&[Kind::J1939Message, Kind::J1939Request, Kind::J1939Transfer, Kind::MessageGap, Kind::Dtc]);

/// Event kinds of J1939 and CANopen nodes.
const OF_J1939_AND_CANOPEN: KindSet =
    KindSet::of(&[Kind::BusSilent, Kind::DeviceState, Kind::LostFrames, Kind::Link, Kind::UdsExchange]);

/// Event kinds that contain values.
const VALUES: KindSet = KindSet::of(&[Kind::Pdo, Kind::J1939Message, Kind::SdoTransfer]);

/// Whether `while` must be updated after every event, not only at the triggers of the rule.
fn follows_while(rule: &DeviceRule) -> bool {
    match rule.kind {
        RuleKind::MaxInterval => true,
        RuleKind::Follow | RuleKind::Never => !rule.during.0.is_empty(),
        RuleKind::Precondition => rule.ms.is_some() && !rule.during.0.is_empty(),
        RuleKind::MaxCount => rule.per == Some(CountWindow::Variable(VariableWindow::While)),
        _ => false,
    }
}

/// All triggers of a rule.
pub(super) fn rule_triggers(rule: &DeviceRule) -> impl Iterator<Item = &ProfileTrigger> {
    let lists: [&ProfileTriggers; 6] =
        [&rule.on, &rule.then, &rule.before, &rule.since, &rule.until, &rule.after];
    lists.into_iter().chain(&rule.steps).flat_map(|triggers| &triggers.0)
}

/// Whether an event concerns a rule.
pub(super) fn concerns_rule(rule: &DeviceRule, event: &TriggerEvent<'_>) -> bool {
    let always = match event {
        TriggerEvent::Value(update) => rule.rule_objects().any(|of| of.object == update.object),
        TriggerEvent::Boot { .. } => {
            matches!(rule.kind, RuleKind::Order | RuleKind::Follow | RuleKind::Sequence) || rule.is_scoped()
        }
        TriggerEvent::Sync => rule.per == Some(CountWindow::Variable(VariableWindow::Sync)),
        _ => false,
    };
    always || rule_triggers(rule).any(|trigger| trigger.is_attempted_by(event))
}

/// Whether a PDO is a trigger of a rule.
pub(super) fn waits_for(rule: &DeviceRule, name: PdoName) -> bool {
    rule.kind != RuleKind::Constant
        && rule_triggers(rule).any(|trigger| *trigger == ProfileTrigger::Pdo(name))
}

/// Event kinds that may match a trigger.
fn kinds_of(trigger: &ProfileTrigger) -> KindSet {
    KindSet::of(match trigger {
        ProfileTrigger::Write(..) | ProfileTrigger::Read(..) | ProfileTrigger::Writes(_) => {
            &[Kind::SdoTransfer]
        }
        ProfileTrigger::Bit(..) | ProfileTrigger::Set(_) | ProfileTrigger::Shows(_) => return VALUES,
        ProfileTrigger::Pdo(_) => &[Kind::Pdo],
        ProfileTrigger::Message(_) => &[Kind::J1939Message, Kind::MessageGap],
        ProfileTrigger::Dtc(_) => &[Kind::Dtc],
        ProfileTrigger::Nmt(_) => &[Kind::NmtCommand],
        ProfileTrigger::State(_) => &[Kind::DeviceState],
        ProfileTrigger::Sync => &[Kind::Sync],
        ProfileTrigger::Emcy(_) => &[Kind::Emcy],
        ProfileTrigger::Boot | ProfileTrigger::PowerOn => &[Kind::BootUp, Kind::Emcy],
        ProfileTrigger::Lss(_) => &[Kind::Lss],
        ProfileTrigger::Guard => &[Kind::GuardRequest, Kind::Heartbeat, Kind::GuardReply],
        ProfileTrigger::Reports(_) => &[Kind::Heartbeat, Kind::GuardReply],
    })
}
