//! What is known of one node.

use std::sync::Arc;

use super::behaviour::Behaviour;
use super::conflicts::Conflicts;
use super::faults::J1939State;
use super::monitoring::{Guarding, Heartbeat};
use super::restart::Restart;
use super::store::{Origin, Store};
use crate::event::{Certainty, StateCause};
use crate::frame::{CanId, Timestamp};
use crate::profile::device::PdoField;
use crate::profile::{Device, Introduction, Meaning, PdoName, Resolver, plain_device};
use crate::session::limits::ACTIVE_ERROR_LIMIT;
use crate::session::options::AssignedBy;
use crate::wire::NodeId;
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::j1939::Name;

/// NMT state with its certainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NmtStatus {
    /// The state.
    pub state: NmtState,
    /// How sure it is.
    pub certainty: Certainty,
    /// What told it last.
    pub cause: StateCause,
    /// Frame that brought the state.
    pub frame: u64,
    /// Monotonic nanoseconds of that frame.
    pub(in crate::session) since: i64,
}

/// One node.
#[derive(Debug, Clone)]
pub struct Node {
    /// The number it has.
    pub(in crate::session) id: NodeId,
    /// Name the user gave it.
    pub(in crate::session) name: Option<Arc<str>>,
    /// NMT state; `None` = unknown.
    pub(in crate::session) nmt: Option<NmtStatus>,
    /// A PDO of this node needs a closer look: its state is not confirmed operational, or it is lost.
    pub(in crate::session) attention: bool,
    /// It is reported as lost.
    pub(in crate::session) lost: bool,
    /// Last frame it sent, and when.
    pub(in crate::session) last_frame: u64,
    /// First frame heard from it; 0 for none.
    pub(in crate::session) first_frame: u64,
    /// It was told to be another node under a new node-ID.
    pub(in crate::session) is_joined: bool,
    pub(in crate::session) last_seen: Option<Timestamp>,
    /// Monotonic time of its last frame.
    pub(in crate::session) last_heard: i64,
    /// Frame of the reset command since its last boot-up.
    pub(in crate::session) reset_frame: Option<(u64, Restart)>,
    /// Identifier of the SYNC it obeys.
    pub(in crate::session) sync: CanId,
    /// How it started last.
    pub(in crate::session) restart: Restart,
    /// Byte order of EMCY codes, told by the codes.
    pub(in crate::session) emcy_order: Option<LearntOrder>,
    /// An object whose presumed value an EMCY contradicts, to be told.
    pub(in crate::session) contradicted: Option<ObjectAddress>,
    /// Booted, and no EMCY since.
    pub(in crate::session) just_booted: bool,
    /// Boot-ups seen.
    pub(in crate::session) boots: u32,
    pub(in crate::session) heartbeat: Heartbeat,
    pub(in crate::session) guarding: Guarding,
    /// Active error codes, oldest first.
    pub(in crate::session) active_errors: Vec<u16>,
    pub(in crate::session) last_error: Option<u16>,
    /// Parameters were saved (1010) since the last download.
    pub(in crate::session) saved: bool,
    pub(in crate::session) store: Arc<Store>,
    /// What the node is; CiA 301 alone where that is not known.
    pub(in crate::session) device: Arc<Device>,
    /// What told it.
    pub(in crate::session) assigned: Option<AssignedBy>,
    /// What the maker's tool put into PDOs, as the bus file tells.
    pub(in crate::session) given_pdos: Arc<Vec<(PdoName, Vec<PdoField>)>>,
    /// What the device does.
    pub(in crate::session) behaviour: Behaviour,
    /// What it said of itself when it was last compared with all devices.
    pub(in crate::session) introduction: Option<Arc<Introduction>>,
    /// Several devices fit, and that was said.
    pub(in crate::session) ambiguous: bool,
    /// Identifiers it has because its device is delivered with them.
    pub(in crate::session) delivered_ids: Vec<CanId>,
    /// What contradicted the file of its device.
    pub(in crate::session) conflicts: Conflicts,
    /// What is remembered of it as a J1939 device.
    pub(in crate::session) j1939: Option<Box<J1939State>>,
}

/// Byte order of EMCY codes that the codes themselves told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct LearntOrder(pub(in crate::session) ByteOrder);

impl NmtStatus {
    /// Monotonic nanoseconds of the frame that brought the state, in the clock of [`super::Bus::now`].
    pub fn since(&self) -> i64 {
        self.since
    }
}

impl Node {
    pub(in crate::session) fn new(id: NodeId, name: Option<Arc<str>>) -> Self {
        Self {
            id,
            name,
            nmt: None,
            attention: true,
            lost: false,
            last_frame: 0,
            first_frame: 0,
            is_joined: false,
            last_seen: None,
            last_heard: 0,
            reset_frame: None,
            sync: CanId::standard(0x80),
            restart: Restart::PowerOn,
            emcy_order: None,
            contradicted: None,
            just_booted: false,
            boots: 0,
            heartbeat: Heartbeat::default(),
            guarding: Guarding::default(),
            active_errors: Vec::new(),
            last_error: None,
            saved: false,
            store: Arc::default(),
            device: Arc::clone(plain_device()),
            assigned: None,
            given_pdos: Arc::default(),
            behaviour: Behaviour::default(),
            introduction: None,
            ambiguous: false,
            delivered_ids: Vec::new(),
            conflicts: Conflicts::default(),
            j1939: None,
        }
    }

    /// Its number now.
    pub fn id(&self) -> NodeId {
        self.id
    }

    /// Name the user gave it.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// NMT state; `None` = unknown.
    pub fn nmt(&self) -> Option<NmtStatus> {
        self.nmt
    }

    /// Boot-ups seen.
    pub fn boots(&self) -> u32 {
        self.boots
    }

    /// Codes of errors raised and not cleared; an upper bound where the device does not clear each.
    pub fn active_errors(&self) -> &[u16] {
        &self.active_errors
    }

    /// Number of the last frame it sent, and its time.
    pub fn last_seen(&self) -> (u64, Option<Timestamp>) {
        (self.last_frame, self.last_seen)
    }

    /// Identifier of the SYNC it obeys.
    pub fn sync(&self) -> CanId {
        self.sync
    }

    /// Raw number of an object that was seen or given and did not change unseen since, and the frame that told it.
    pub fn proven(&self, object: ObjectAddress) -> Option<(i64, Origin)> {
        let entry = self.store.seen(object).filter(|entry| !entry.stale)?;
        let number = self.resolver().number(object).filter(|number| !number.assumed)?;
        Some((number.raw, entry.origin))
    }

    /// Whether it is silent longer than its monitoring allows.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Its objects.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// What the node is; CiA 301 alone where that is not known.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// What told which device it is.
    pub fn assigned(&self) -> Option<AssignedBy> {
        self.assigned
    }

    /// Title of the device, where one was assigned.
    pub fn device_title(&self) -> Option<&str> {
        self.assigned.map(|_| self.device.title.as_str())
    }

    /// Profile and variant, where one was assigned.
    pub fn device_id(&self) -> Option<&str> {
        self.assigned.map(|_| self.device.full_id.as_str())
    }

    /// What the bus file says is in a PDO.
    pub(in crate::session) fn given_pdo(&self, name: PdoName) -> Option<&[PdoField]> {
        self.given_pdos.iter().find(|(given, _)| *given == name).map(|(_, fields)| fields.as_slice())
    }

    /// What an object means now.
    pub fn meaning(&self, object: ObjectAddress) -> Option<Meaning> {
        self.resolver().meaning(object)
    }

    /// What its objects mean, and the numbers they hold.
    pub(in crate::session) fn resolver(&self) -> Resolver<'_> {
        Resolver::for_node(&self.device.dictionary, &*self.store, self.id.number())
    }

    /// Sets `attention` from the rest.
    pub(in crate::session) fn refresh_attention(&mut self) {
        let settled = self
            .nmt
            .is_some_and(|nmt| nmt.state == NmtState::Operational && nmt.certainty == Certainty::Confirmed);
        self.attention = !settled || self.lost;
    }

    /// What is wrong now, in words for people: codes of EMCY messages, faults of DM1.
    pub(in crate::session) fn errors(&self) -> impl Iterator<Item = String> {
        let codes = self.active_errors.iter().map(|code| format!("{code:04X}"));
        codes.chain(self.active_dtcs().map(|(spn, fmi)| format!("SPN {spn} FMI {fmi}")))
    }

    /// Adds an active error; `false` when an old one had to go.
    pub(in crate::session) fn raise(&mut self, code: u16) -> bool {
        self.last_error = Some(code);
        if self.active_errors.contains(&code) {
            return true;
        }
        let fits = self.active_errors.len() < ACTIVE_ERROR_LIMIT;
        if !fits {
            self.active_errors.remove(0);
        }
        self.active_errors.push(code);
        fits
    }

    /// Bytes held, the store apart.
    pub(in crate::session) fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.active_errors.capacity() * 2
            + self.behaviour.footprint()
            + self.delivered_ids.capacity() * size_of::<CanId>()
            + self.conflicts.footprint()
            + self.j1939.as_ref().map_or(0, |state| state.footprint())
    }
}

impl Node {
    /// SPN and FMI of trouble codes that its last DM1 has.
    pub fn active_dtcs(&self) -> impl Iterator<Item = (u32, u8)> {
        self.j1939.iter().flat_map(|state| state.faults.active())
    }
}

impl Node {
    /// NAME of a J1939 device, once it was seen.
    pub fn j1939_name(&self) -> Option<Name> {
        self.j1939.as_ref()?.name
    }

    /// What is remembered of it as a J1939 device, made if new.
    pub(in crate::session) fn j1939_state(&mut self) -> &mut J1939State {
        self.j1939.get_or_insert_default()
    }
}
