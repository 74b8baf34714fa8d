//! Present service of each identifier.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use foldhash::fast::FixedState;

use super::last_payload::LastPayload;
use super::link::UdsLink;
use super::plan::IdentifierPlan;
use super::service::{IdentifierService, SRDO};
use super::shared_gap::shared_gap;
use crate::event::{DecodedPdo, Event, EventKind};
use crate::frame::{CanId, Frame};
use crate::profile::{IdentifierOwner, PayloadLayout, PdoDirection, PdoName, connection_set};
use crate::session::bus::time::{Cadence, IdentifierIntervals, SkippedTimes};
use crate::session::limits::EXTENDED_ID_LIMIT;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::SdoSide;
use crate::wire::j1939::{J1939Id, NO_ADDRESS};

/// State of one identifier, created at its first frame.
#[derive(Debug, Clone)]
pub(in crate::session) struct IdentifierState {
    pub(in crate::session) service: IdentifierService,
    /// Last data frame.
    pub(in crate::session) last: LastPayload,
    /// Payload bits that the session itself needs, unless it needs each frame; see [`Self::needed_bits`].
    needed: u64,
    needs_each: bool,
    /// Index of the sender of a TPDO or J1939 message in tables by node; [`NO_SENDER`] for other services.
    pub(in crate::session) sender: u16,
    /// Number of the prepared event; it changes with node, service and layout.
    pub(in crate::session) version: u32,
    /// Event of a PDO or J1939 message, updated in place to avoid one allocation per frame. It is that of the last frame
    /// that an observer needed.
    pub(in crate::session) prepared: Option<Box<Event>>,
    /// Fields that concern the device's state.
    pub(in crate::session) plan: Option<Box<IdentifierPlan>>,
    /// Intervals, if a manual limits them.
    pub(in crate::session) cadence: Option<Box<Cadence>>,
    /// Frames of an RPDO without an event.
    pub(in crate::session) skipped: Option<Box<SkippedTimes>>,
    /// Last frame, if only a database describes it.
    pub(in crate::session) described: Option<Box<Frame>>,
    pub(in crate::session) pulse: IdentifierIntervals,
}

impl IdentifierState {
    fn new(service: IdentifierService) -> Self {
        Self {
            service,
            last: LastPayload::NONE,
            needed: 0,
            needs_each: true,
            sender: sender_slot(service),
            version: 0,
            prepared: None,
            plan: None,
            cadence: None,
            skipped: None,
            described: None,
            pulse: IdentifierIntervals::NEW,
        }
    }

    /// Drops the prepared event; the next frame uses the present layout.
    pub(in crate::session) fn drop_event(&mut self) {
        (self.prepared, self.needs_each) = (None, true);
        self.version = self.version.wrapping_add(1);
    }

    /// Payload bits that the session itself needs; `None` if it needs each frame.
    #[inline]
    pub(in crate::session) fn needed_bits(&self) -> Option<u64> {
        (!self.needs_each).then_some(self.needed)
    }

    /// Sets the payload bits that the session itself needs; `None` if it needs each frame.
    pub(in crate::session) fn set_needed_bits(&mut self, needed: Option<u64>) {
        (self.needed, self.needs_each) = (needed.unwrap_or(0), needed.is_none());
    }

    /// Whether nodes receive the PDO or message, and its sender is not known.
    #[inline]
    pub(in crate::session) const fn is_received(&self) -> bool {
        self.sender == NO_SENDER
    }

    /// Intervals of its frames.
    pub(in crate::session) fn intervals(&self) -> &IdentifierIntervals {
        &self.pulse
    }

    /// Registers a frame at a monotonic time.
    #[inline]
    pub(in crate::session) fn note_frame(&mut self, now: i64, frame: u64) {
        self.pulse.note_frame(now, frame);
    }
}

const NO_SLOT: u16 = u16::MAX;

/// Places of [`IdentifierRoutes::front`].
const FRONT_PLACES: usize = 512;

/// Place of a 29-bit identifier: the highest bits of a product with 2³² by the golden ratio, which all bits change.
#[inline]
fn front_place(id: u32) -> usize {
    usize::try_from(id.wrapping_mul(0x9E37_79B1) >> 23).unwrap_or(FRONT_PLACES)
}

/// No node has this index.
const NO_SENDER: u16 = u16::MAX;

fn sender_slot(service: IdentifierService) -> u16 {
    let node = match service {
        IdentifierService::Pdo(name, node) if name.direction == PdoDirection::Transmit => node,
        IdentifierService::J1939(id) if id.source < NO_ADDRESS => NodeId::J1939(id.source),
        _ => return NO_SENDER,
    };
    u16::try_from(node.table_place()).unwrap_or(NO_SENDER)
}

/// Services of all identifiers of one bus.
#[derive(Debug, Clone)]
pub struct IdentifierRoutes {
    /// Index of the state of each 11-bit identifier.
    standard: Box<[u16; 2048]>,
    /// The same for 29-bit identifiers.
    extended: HashMap<u32, u16, FixedState>,
    /// Most of `extended`, by [`front_place`]: one comparison instead of a search per frame. Empty before the first one.
    front: Vec<(u32, u16)>,
    slots: Vec<IdentifierState>,
    /// Services from the user; they override all others.
    given: Arc<BTreeMap<CanId, IdentifierService>>,
    /// Services learnt from messages; they override the defaults.
    learnt: Arc<BTreeMap<CanId, IdentifierService>>,
    /// UDS servers from the user; they override only the defaults.
    named: Arc<BTreeMap<CanId, IdentifierService>>,
    refused: bool,
    /// Index of the identifier whose PDO or message is being sent to the observer.
    current: Option<usize>,
}

impl Default for IdentifierRoutes {
    fn default() -> Self {
        Self {
            standard: Box::new([NO_SLOT; 2048]),
            extended: HashMap::default(),
            front: Vec::new(),
            slots: Vec::new(),
            given: Arc::default(),
            learnt: Arc::default(),
            named: Arc::default(),
            refused: false,
            current: None,
        }
    }
}

/// Source of the service at the first frame of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum RouteOrigin {
    /// From the user, from messages, or from ISO-TP addresses in the identifier.
    Learnt(IdentifierService),
    /// From the predefined connection set.
    Default(IdentifierOwner),
    /// From the fields of a 29-bit identifier.
    J1939(J1939Id),
}

impl IdentifierRoutes {
    /// Index of an identifier in order of appearance; `None` before its first frame.
    #[inline]
    pub(crate) fn find_slot(&self, id: CanId) -> Option<usize> {
        let slot = match id {
            CanId::Standard(id) => self.standard.get(usize::from(id)).copied()?,
            CanId::Extended(id) => match self.front.get(front_place(id)) {
                Some((known, slot)) if *known == id => *slot,
                _ => self.extended.get(&id).copied()?,
            },
        };
        (slot != NO_SLOT).then_some(usize::from(slot))
    }

    /// Registers a frame at a monotonic time, if its service can be periodic; service of its slot.
    #[inline]
    pub(in crate::session) fn note_frame(
        &mut self,
        slot: usize,
        (now, frame): (i64, u64),
    ) -> Option<IdentifierService> {
        let slot = self.slots.get_mut(slot)?;
        if slot.service.is_periodic() {
            slot.pulse.note_frame(now, frame);
        }
        Some(slot.service)
    }

    /// Services of all slots with their intervals.
    pub(in crate::session) fn pulses(
        &self,
    ) -> impl Iterator<Item = (IdentifierService, &IdentifierIntervals)> {
        self.slots.iter().map(|slot| (slot.service, &slot.pulse))
    }

    /// All identifiers with their states, in ascending order.
    pub(in crate::session) fn identifiers(&self) -> impl Iterator<Item = (CanId, &IdentifierState)> {
        let standard = (0..).zip(self.standard.iter()).filter(|(_, slot)| **slot != NO_SLOT);
        let standard = standard.map(|(id, slot)| (CanId::from_standard(id), *slot));
        let mut extended: Vec<_> =
            self.extended.iter().map(|(id, slot)| (CanId::from_extended(*id), *slot)).collect();
        extended.sort_unstable();
        let known = |(id, slot): (CanId, u16)| Some((id, self.slots.get(usize::from(slot))?));
        standard.chain(extended).filter_map(known)
    }

    /// Whether a node sent a TPDO whose next one is not late at a monotonic time.
    pub(in crate::session) fn sends_pdos(&self, id: NodeId, time: i64) -> bool {
        let is_own = |service: IdentifierService| matches!(service, IdentifierService::Pdo(name, node) if name.is_sent() && node == id);
        self.slots
            .iter()
            .any(|slot| is_own(slot.service) && slot.pulse.due_time().is_some_and(|due| due >= time))
    }

    /// Moves the last frame of all identifiers by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_frames(&mut self, delay: i64) {
        self.slots.iter_mut().for_each(|slot| slot.pulse.postpone_frame(delay));
    }

    #[inline]
    pub(in crate::session) fn slot(&self, index: usize) -> Option<&IdentifierState> {
        self.slots.get(index)
    }

    #[inline]
    pub(in crate::session) fn slot_mut(&mut self, index: usize) -> Option<&mut IdentifierState> {
        self.slots.get_mut(index)
    }

    /// Service of an identifier before its first frame.
    pub(in crate::session) fn route_origin(&self, id: CanId) -> RouteOrigin {
        let known = [&self.given, &self.learnt, &self.named].into_iter().find_map(|map| map.get(&id));
        let known = known.copied().or_else(|| {
            UdsLink::link_of(id).filter(|link| !link.needs_evidence()).map(IdentifierService::IsoTp)
        });
        if let Some(service) = known {
            return RouteOrigin::Learnt(service);
        }
        match id {
            CanId::Standard(id) => RouteOrigin::Default(connection_set().owner_of(id)),
            CanId::Extended(id) => J1939Id::from_identifier(id)
                .map_or(RouteOrigin::Default(IdentifierOwner::Unclassified), RouteOrigin::J1939),
        }
    }

    /// Creates the slot of an identifier; `None` if the table of 29-bit identifiers is full.
    pub(in crate::session) fn add_slot(&mut self, id: CanId, service: IdentifierService) -> Option<usize> {
        let index = self.slots.len();
        let slot = u16::try_from(index).ok()?;
        match id {
            CanId::Standard(id) => *self.standard.get_mut(usize::from(id))? = slot,
            CanId::Extended(id) => {
                if self.extended.len() >= EXTENDED_ID_LIMIT {
                    return None;
                }
                self.extended.insert(id, slot);
                // No identifier has 32 bits.
                self.front.resize(FRONT_PLACES, (u32::MAX, NO_SLOT));
                if let Some(place) = self.front.get_mut(front_place(id)) {
                    *place = (id, slot);
                }
            }
        }
        self.slots.push(IdentifierState::new(service));
        Some(index)
    }

    /// Whether a 29-bit identifier occurred.
    pub(in crate::session) fn has_extended(&self) -> bool {
        !self.extended.is_empty()
    }

    /// Sets the learnt service of `id`.
    pub(in crate::session) fn learn_service(&mut self, id: CanId, service: IdentifierService) {
        if self.learnt.get(&id) == Some(&service) {
            return;
        }
        if self.learnt.len() < EXTENDED_ID_LIMIT || self.learnt.contains_key(&id) {
            Arc::make_mut(&mut self.learnt).insert(id, service);
            self.reroute(id, service);
        } else {
            self.refused = true;
        }
    }

    /// Whether an identifier was rejected, because the table is full, since the last call.
    pub(in crate::session) fn take_refused(&mut self) -> bool {
        std::mem::take(&mut self.refused)
    }

    /// Removes the learnt service of `id`; the default `replaces` applies again.
    pub(in crate::session) fn forget_service(
        &mut self,
        id: CanId,
        service: IdentifierService,
        replaces: IdentifierService,
    ) {
        if self.learnt.get(&id) == Some(&service) {
            Arc::make_mut(&mut self.learnt).remove(&id);
            self.reroute(id, replaces);
        }
    }

    /// Sets the service of `id` from the user.
    pub(in crate::session) fn set_service(&mut self, id: CanId, service: IdentifierService) {
        Arc::make_mut(&mut self.given).insert(id, service);
    }

    /// Whether the user stated the service of `id`.
    pub(in crate::session) fn is_given(&self, id: CanId) -> bool {
        self.given.contains_key(&id)
    }

    /// Assigns `id` to a UDS link from the user; the first assignment wins.
    pub(in crate::session) fn assign_named_link(&mut self, id: CanId, link: UdsLink) {
        Arc::make_mut(&mut self.named).entry(id).or_insert(IdentifierService::IsoTp(link));
    }

    /// Whether an end of a link sends on another one with addresses of the same scheme.
    pub(in crate::session) fn has_sender_of(&self, link: UdsLink) -> bool {
        let UdsLink::Addressed { scheme, source, target, .. } = link else { return false };
        self.named.values().any(|service| match *service {
            IdentifierService::IsoTp(UdsLink::Addressed { scheme: other, source: sender, .. }) => {
                other == scheme && (sender == target || sender == source)
            }
            _ => false,
        })
    }

    /// Assigns `id` to a UDS link that the traffic revealed; services from the user and from messages remain.
    pub(in crate::session) fn assign_link(&mut self, id: CanId, link: UdsLink) {
        if !self.learnt.contains_key(&id) && !self.named.contains_key(&id) {
            self.assign_named_link(id, link);
            self.reroute(id, IdentifierService::IsoTp(link));
        }
    }

    /// Sets the service of `id` until another one is learnt.
    pub(in crate::session) fn reroute(&mut self, id: CanId, service: IdentifierService) {
        if self.given.contains_key(&id) {
            return;
        }
        if let Some(slot) = self.find_slot(id).and_then(|index| self.slots.get_mut(index)) {
            let version = slot.version.wrapping_add(1);
            *slot = IdentifierState { version, ..IdentifierState::new(service) };
        }
    }

    /// Identifier learnt for a service.
    pub(in crate::session) fn learnt_id(&self, service: IdentifierService) -> Option<CanId> {
        self.learnt.iter().find(|(_, learnt)| **learnt == service).map(|(id, _)| *id)
    }

    /// Present service of an identifier; `None` before its first frame.
    pub(in crate::session) fn service_of(&self, id: CanId) -> Option<IdentifierService> {
        self.slot(self.find_slot(id)?).map(|slot| slot.service)
    }

    /// Service learnt for an identifier.
    pub(in crate::session) fn learnt_at(&self, id: CanId) -> Option<IdentifierService> {
        self.learnt.get(&id).copied()
    }

    /// Whether a service has an identifier, learnt or from the user.
    pub(in crate::session) fn is_placed(&self, service: IdentifierService) -> bool {
        self.given.values().chain(self.learnt.values()).any(|placed| *placed == service)
    }

    /// Copies all learnt services, for moving them to another node-ID.
    pub(in crate::session) fn learnt_services(&self) -> Vec<(CanId, IdentifierService)> {
        self.learnt.iter().map(|(id, service)| (*id, *service)).collect()
    }

    /// PDOs received so far, with their layouts.
    pub(in crate::session) fn layouts(&self) -> impl Iterator<Item = (IdentifierService, &PayloadLayout)> {
        self.slots.iter().filter_map(|slot| match &slot.prepared.as_deref()?.kind {
            EventKind::Pdo(pdo) => Some((slot.service, pdo.layout.as_deref()?)),
            _ => None,
        })
    }

    /// Drops the prepared event of a PDO, so that the next one uses the present layout.
    pub(in crate::session) fn refresh_pdo(&mut self, name: PdoName, node: NodeId) {
        for slot in &mut self.slots {
            if slot.service == IdentifierService::Pdo(name, node) {
                slot.drop_event();
            }
        }
    }

    /// Drops prepared events of the node's PDOs whose layout depends on an object. PDOs without a layout are
    /// refreshed when their mapping becomes known.
    pub(in crate::session) fn refresh_dependents(&mut self, id: NodeId, object: ObjectAddress) {
        for slot in &mut self.slots {
            let depends = matches!(slot.service, IdentifierService::Pdo(_, node) if node == id)
                && slot.prepared.as_deref().is_some_and(|event| match &event.kind {
                    EventKind::Pdo(DecodedPdo { layout: Some(layout), .. }) => {
                        layout.depends.contains(&object)
                    }
                    _ => false,
                });
            if depends {
                slot.drop_event();
            }
        }
    }

    /// Drops prepared events of all PDOs of a node.
    pub(in crate::session) fn refresh_pdos_of(&mut self, id: NodeId) {
        for slot in &mut self.slots {
            if matches!(slot.service, IdentifierService::Pdo(_, node) if node == id) {
                slot.drop_event();
            }
        }
    }

    /// Messages with a monitored interval.
    pub(in crate::session) fn cadences(&self) -> impl Iterator<Item = &Cadence> {
        self.slots.iter().filter_map(|slot| slot.cadence.as_deref())
    }

    /// Messages with a monitored interval, mutable.
    pub(in crate::session) fn cadences_mut(&mut self) -> impl Iterator<Item = &mut Cadence> {
        self.slots.iter_mut().filter_map(|slot| slot.cadence.as_deref_mut())
    }

    /// Drops the prepared events of J1939 messages; removes and returns their cadences, by slot.
    pub(in crate::session) fn refresh_messages(&mut self) -> Vec<(u16, Box<Cadence>)> {
        let mut dropped = Vec::new();
        for (number, slot) in (0..).zip(&mut self.slots) {
            if matches!(slot.service, IdentifierService::J1939(_)) {
                slot.drop_event();
                dropped.extend(slot.cadence.take().map(|cadence| (number, cadence)));
            }
        }
        dropped
    }

    /// PDO that an identifier carries now, and its node.
    pub fn pdo_on(&self, id: CanId) -> Option<(PdoName, NodeId)> {
        match self.slot(self.find_slot(id)?)?.service {
            IdentifierService::Pdo(name, node) => Some((name, node)),
            _ => None,
        }
    }

    /// Device that must receive a J1939 message within a time, and the time from its manual, in ns.
    pub fn awaited_message(&self, id: CanId) -> Option<(NodeId, i64)> {
        let slot = self.slot(self.find_slot(id)?)?;
        slot.cadence.as_deref().map(Cadence::max_interval)
    }

    /// Whether a frame belongs to an SRDO of which the other frame was never seen. An SRDO is a pair: data on
    /// an odd identifier, and the inverted data on the next one (CiA 304, 301 §7.3.3).
    pub(in crate::session) fn is_lone(&self, id: CanId, name: &str) -> bool {
        let CanId::Standard(number) = id else { return false };
        let other =
            if number.is_multiple_of(2) { number.saturating_sub(1) } else { number.saturating_add(1) };
        name == SRDO && self.find_slot(CanId::from_standard(other)).is_none()
    }

    /// Routes both identifiers of a channel.
    pub(in crate::session) fn route_channel(&mut self, channel: u16, request: CanId, response: CanId) {
        self.learn_service(request, IdentifierService::Sdo(SdoSide::Client, channel));
        self.learn_service(response, IdentifierService::Sdo(SdoSide::Server, channel));
    }

    /// Time in ns after `received`, the monotonic time of a frame, at which at least three periodic producers have missed all
    /// their messages, if no frame follows.
    pub(in crate::session) fn shared_gap(&self, received: i64) -> Option<i64> {
        shared_gap(self.pulses(), received).map(|due| due.saturating_sub(received))
    }

    /// Sets the index of the identifier whose PDO or message is being sent to the observer.
    #[inline]
    pub(in crate::session) fn set_current(&mut self, slot: Option<usize>) {
        self.current = slot;
    }

    /// Index of the identifier of the PDO or J1939 message that an observer receives.
    #[inline]
    pub(crate) fn identifier_of_event(&self, id: CanId) -> Option<usize> {
        self.current.or_else(|| self.find_slot(id))
    }

    /// PDO and node of an identifier by its index; `None` for other services.
    #[inline]
    pub(crate) fn pdo_at(&self, identifier: usize) -> Option<(PdoName, NodeId)> {
        match self.slot(identifier)?.service {
            IdentifierService::Pdo(name, node) => Some((name, node)),
            _ => None,
        }
    }

    /// Frames without an event of an RPDO, by the index of its identifier.
    pub(crate) fn skipped_times(&self, identifier: usize) -> Option<&SkippedTimes> {
        self.slot(identifier)?.skipped.as_deref()
    }

    /// Number of the present service and layout of an identifier; it changes with them.
    #[inline]
    pub(crate) fn version_of(&self, identifier: usize) -> u32 {
        self.slot(identifier).map_or(0, |state| state.version)
    }

    /// Layout of the last PDO with an identifier.
    pub(crate) fn pdo_layout(&self, id: CanId) -> Option<&PayloadLayout> {
        match &self.slot(self.find_slot(id)?)?.prepared.as_deref()?.kind {
            EventKind::Pdo(pdo) => pdo.layout.as_deref(),
            _ => None,
        }
    }

    /// Bytes held by the tables.
    pub(in crate::session) fn footprint(&self) -> usize {
        let events = self.slots.iter().filter(|slot| slot.prepared.is_some()).count() * size_of::<Event>();
        size_of::<[u16; 2048]>()
            + self.extended.capacity() * 8
            + self.front.capacity() * size_of::<(u32, u16)>()
            + self.slots.capacity() * size_of::<IdentifierState>()
            + events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_identifier_of_a_full_table_is_found() {
        let mut routes = IdentifierRoutes::default();
        let ids = (0..1_000_u32).map(|n| CanId::from_extended(n * 0x100 + n % 7));
        for id in ids.clone() {
            assert_eq!(routes.find_slot(id), None);
            routes.add_slot(id, IdentifierService::Unclassified);
        }
        assert!(ids.clone().enumerate().all(|(place, id)| routes.find_slot(id) == Some(place)));
        assert_eq!(routes.find_slot(CanId::from_extended(0xFFFF)), None);
    }
}
