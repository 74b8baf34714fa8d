//! What each identifier means now.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use foldhash::fast::FixedState;

use super::cadence::Cadence;
use super::link::Link;
use super::plan::Planned;
use crate::event::{Event, EventKind, Pdo};
use crate::frame::{CanId, Frame};
use crate::profile::{Layout, Owner, PdoName, connection_set};
use crate::session::limits::EXTENDED_ID_LIMIT;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::Side;
use crate::wire::j1939::J1939Id;

/// Service and node of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum Service {
    /// Nobody's.
    Unclassified,
    /// Named, not decoded.
    Named(&'static str),
    Nmt,
    Sync,
    Time,
    /// EMCY of a node.
    Emcy(NodeId),
    /// PDO of a node.
    Pdo(PdoName, NodeId),
    /// A side of an SDO channel.
    Sdo(Side, u16),
    /// Heartbeat, boot-up and guarding of a node.
    ErrorControl(NodeId),
    /// LSS; `true` = from the master.
    Lss(bool),
    /// Marks of CiA's conformance test tool.
    TestMarker,
    /// A J1939 message.
    J1939(J1939Id),
    /// ISO-TP between two ends.
    IsoTp(Link),
}

/// State of one identifier that was seen.
#[derive(Debug, Clone)]
pub(in crate::session) struct Slot {
    pub(in crate::session) service: Service,
    /// The event of its last PDO or J1939 message, updated in place: no allocation a frame.
    pub(in crate::session) prepared: Option<Box<Event>>,
    /// What of it matters to the device's doings.
    pub(in crate::session) plan: Option<Box<Planned>>,
    /// How often it comes, where a manual bounds that.
    pub(in crate::session) cadence: Option<Box<Cadence>>,
    /// Its last frame, where no service is decoded of it and a database describes it.
    pub(in crate::session) described: Option<Box<Frame>>,
}

impl Service {
    /// Whether its machine handles remote frames: only PDOs and error control are requested by them (CiA 301 §7.2.2,
    /// §7.2.8.3.2.1); frames of unknown services are passed on as they are.
    pub(in crate::session) const fn has_remote_frames(self) -> bool {
        matches!(
            self,
            Self::Pdo(..) | Self::ErrorControl(_) | Self::J1939(_) | Self::Unclassified | Self::Named(_)
        )
    }
}

impl Slot {
    const fn new(service: Service) -> Self {
        Self { service, prepared: None, plan: None, cadence: None, described: None }
    }
}

const NO_SLOT: u16 = u16::MAX;

/// Routes of one bus.
#[derive(Debug, Clone)]
pub(in crate::session) struct Routes {
    /// Slot of each 11-bit identifier.
    standard: Box<[u16; 2048]>,
    /// Slot of 29-bit identifiers.
    extended: HashMap<u32, u16, FixedState>,
    slots: Vec<Slot>,
    /// Services the user gave; they go before everything else.
    given: Arc<BTreeMap<CanId, Service>>,
    /// Services learnt on the wire; they go before the defaults.
    learnt: Arc<BTreeMap<CanId, Service>>,
    /// UDS servers the user named; they go before the defaults only.
    named: Arc<BTreeMap<CanId, Service>>,
    refused: bool,
}

impl Default for Routes {
    fn default() -> Self {
        Self {
            standard: Box::new([NO_SLOT; 2048]),
            extended: HashMap::default(),
            slots: Vec::new(),
            given: Arc::default(),
            learnt: Arc::default(),
            named: Arc::default(),
            refused: false,
        }
    }
}

/// What an identifier's first frame is routed to before channels are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum RouteOrigin {
    /// Given, learnt, or told by the bits of the identifier.
    Learnt(Service),
    /// By the predefined connection set.
    Default(Owner),
    /// By its 29 bits.
    J1939(J1939Id),
}

impl Routes {
    /// Slot of an identifier, if it was seen.
    #[inline]
    pub(in crate::session) fn find(&self, id: CanId) -> Option<usize> {
        let slot = match id {
            CanId::Standard(id) => self.standard.get(usize::from(id)).copied()?,
            CanId::Extended(id) => self.extended.get(&id).copied()?,
        };
        (slot != NO_SLOT).then_some(usize::from(slot))
    }

    #[inline]
    pub(in crate::session) fn slot(&self, index: usize) -> Option<&Slot> {
        self.slots.get(index)
    }

    #[inline]
    pub(in crate::session) fn slot_mut(&mut self, index: usize) -> Option<&mut Slot> {
        self.slots.get_mut(index)
    }

    /// What an identifier means before its first frame.
    pub(in crate::session) fn origin(&self, id: CanId) -> RouteOrigin {
        let known = [&self.given, &self.learnt, &self.named].into_iter().find_map(|map| map.get(&id));
        let known = known.copied().or_else(|| Link::of(id).map(Service::IsoTp));
        if let Some(service) = known {
            return RouteOrigin::Learnt(service);
        }
        match id {
            CanId::Standard(id) => RouteOrigin::Default(connection_set().owner(id)),
            CanId::Extended(id) => {
                J1939Id::of(id).map_or(RouteOrigin::Default(Owner::Unclassified), RouteOrigin::J1939)
            }
        }
    }

    /// Makes the slot of an identifier; `None` when there are too many of 29 bits.
    pub(in crate::session) fn add(&mut self, id: CanId, service: Service) -> Option<usize> {
        let index = self.slots.len();
        let slot = u16::try_from(index).ok()?;
        match id {
            CanId::Standard(id) => *self.standard.get_mut(usize::from(id))? = slot,
            CanId::Extended(id) => {
                if self.extended.len() >= EXTENDED_ID_LIMIT {
                    return None;
                }
                self.extended.insert(id, slot);
            }
        }
        self.slots.push(Slot::new(service));
        Some(index)
    }

    /// From now on `id` is `service`.
    pub(in crate::session) fn learn(&mut self, id: CanId, service: Service) {
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

    /// Whether an identifier could not be learnt since the last question.
    pub(in crate::session) fn take_refused(&mut self) -> bool {
        std::mem::take(&mut self.refused)
    }

    /// Takes back what was learnt of `id`; a default that `replaces` it holds again.
    pub(in crate::session) fn forget(&mut self, id: CanId, service: Service, replaces: Service) {
        if self.learnt.get(&id) == Some(&service) {
            Arc::make_mut(&mut self.learnt).remove(&id);
            self.reroute(id, replaces);
        }
    }

    /// The user says that `id` is `service`.
    pub(in crate::session) fn give(&mut self, id: CanId, service: Service) {
        Arc::make_mut(&mut self.given).insert(id, service);
    }

    /// The user names `id` as one of a UDS server; the first word counts.
    pub(in crate::session) fn name(&mut self, id: CanId, link: Link) {
        Arc::make_mut(&mut self.named).entry(id).or_insert(Service::IsoTp(link));
    }

    fn reroute(&mut self, id: CanId, service: Service) {
        if self.given.contains_key(&id) {
            return;
        }
        if let Some(slot) = self.find(id).and_then(|index| self.slots.get_mut(index)) {
            *slot = Slot::new(service);
        }
    }

    /// Identifier learnt for a service.
    pub(in crate::session) fn learnt_id(&self, service: Service) -> Option<CanId> {
        self.learnt.iter().find(|(_, learnt)| **learnt == service).map(|(id, _)| *id)
    }

    /// What an identifier was learnt to be.
    pub(in crate::session) fn learnt_at(&self, id: CanId) -> Option<Service> {
        self.learnt.get(&id).copied()
    }

    /// Whether an identifier was learnt or given for a service.
    pub(in crate::session) fn is_placed(&self, service: Service) -> bool {
        self.given.values().chain(self.learnt.values()).any(|placed| *placed == service)
    }

    /// Everything learnt, for moving it.
    pub(in crate::session) fn learnt(&self) -> Vec<(CanId, Service)> {
        self.learnt.iter().map(|(id, service)| (*id, *service)).collect()
    }

    /// The PDOs that were seen, with their layouts.
    pub(in crate::session) fn layouts(&self) -> impl Iterator<Item = (Service, &Layout)> {
        self.slots.iter().filter_map(|slot| match &slot.prepared.as_deref()?.kind {
            EventKind::Pdo(pdo) => Some((slot.service, pdo.layout.as_deref()?)),
            _ => None,
        })
    }

    /// Drops the prepared events of a PDO, so that its next one has the present layout.
    pub(in crate::session) fn refresh_pdo(&mut self, name: PdoName, node: NodeId) {
        for slot in &mut self.slots {
            if slot.service == Service::Pdo(name, node) {
                slot.prepared = None;
            }
        }
    }

    /// The same for PDOs of a node whose layout depends on an object. Of those without a layout nothing
    /// is known to depend on it: a mapping that becomes known refreshes them itself.
    pub(in crate::session) fn refresh_dependents(&mut self, id: NodeId, object: ObjectAddress) {
        for slot in &mut self.slots {
            let depends = matches!(slot.service, Service::Pdo(_, node) if node == id)
                && slot.prepared.as_deref().is_some_and(|event| match &event.kind {
                    EventKind::Pdo(Pdo { layout: Some(layout), .. }) => layout.depends.contains(&object),
                    _ => false,
                });
            if depends {
                slot.prepared = None;
            }
        }
    }

    /// The same for all PDOs of a node.
    pub(in crate::session) fn refresh_pdos_of(&mut self, id: NodeId) {
        for slot in &mut self.slots {
            if matches!(slot.service, Service::Pdo(_, node) if node == id) {
                slot.prepared = None;
            }
        }
    }

    /// Messages whose cadence is watched.
    pub(in crate::session) fn cadences(&self) -> impl Iterator<Item = &Cadence> {
        self.slots.iter().filter_map(|slot| slot.cadence.as_deref())
    }

    /// The same, to change them.
    pub(in crate::session) fn cadences_mut(&mut self) -> impl Iterator<Item = &mut Cadence> {
        self.slots.iter_mut().filter_map(|slot| slot.cadence.as_deref_mut())
    }

    /// Drops the prepared events of J1939 messages; gives the cadences that were watched, by slot.
    pub(in crate::session) fn refresh_messages(&mut self) -> Vec<(u16, Box<Cadence>)> {
        let mut dropped = Vec::new();
        for (number, slot) in (0..).zip(&mut self.slots) {
            if matches!(slot.service, Service::J1939(_)) {
                slot.prepared = None;
                dropped.extend(slot.cadence.take().map(|cadence| (number, cadence)));
            }
        }
        dropped
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        let events = self.slots.iter().filter(|slot| slot.prepared.is_some()).count() * size_of::<Event>();
        size_of::<[u16; 2048]>()
            + self.extended.capacity() * 8
            + self.slots.capacity() * size_of::<Slot>()
            + events
    }
}
