//! What is known of one node.

use std::sync::Arc;

use super::ACTIVE_ERROR_LIMIT;
use super::device::{Behaviour, Conflicts, Restart};
use super::j1939::J1939State;
use super::store::{Origin, Store};
use crate::event::{Certainty, StateCause};
use crate::frame::{CanId, Timestamp};
use crate::profile::device::PdoField;
use crate::profile::{Device, Introduction, Meaning, PdoName, Resolver, plain_device};
use crate::wire::NodeId;
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::canopen::{NmtState, ObjectAddress};

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
    pub(super) since: i64,
}

/// Heartbeat of a node.
#[derive(Debug, Clone, Default)]
pub(super) struct Heartbeat {
    /// Monotonic time of the last one; `None` before the first and after a reset.
    pub(super) last: Option<i64>,
    /// The last intervals, newest first, zero = none.
    pub(super) intervals: [i64; 4],
    /// Monotonic deadline, `None` = not monitored.
    pub(super) deadline: Option<i64>,
    /// An entry is in the timer queue.
    pub(super) queued: bool,
    /// Producer time (object 0x1017) in nanoseconds as learnt; 0 = switched off.
    pub(super) configured: Option<i64>,
}

impl Heartbeat {
    /// The interval to expect: configured, else the longest of the last four once there are four.
    pub(super) fn expected(&self) -> Option<i64> {
        match self.configured {
            Some(0) => None,
            Some(time) => Some(time),
            None if self.intervals.contains(&0) => None,
            None => self.intervals.iter().copied().max(),
        }
    }
}

/// Guarding of a node.
#[derive(Debug, Clone, Default)]
pub(super) struct Guarding {
    /// A request waits for its reply.
    pub(super) is_open: bool,
    /// Requests without reply in a row.
    pub(super) missed: u8,
    /// Toggle bit of the last reply.
    pub(super) toggle: Option<bool>,
    /// Monotonic time of the last reply.
    pub(super) last_reply: Option<i64>,
    /// Any request was seen.
    pub(super) seen: bool,
}

/// One node.
#[derive(Debug, Clone)]
pub struct Node {
    /// The number it has.
    pub(super) id: NodeId,
    /// Name the user gave it.
    pub(super) name: Option<Arc<str>>,
    /// NMT state; `None` = unknown.
    pub(super) nmt: Option<NmtStatus>,
    /// A PDO of this node needs a closer look: its state is not confirmed operational, or it is lost.
    pub(super) attention: bool,
    /// It is reported as lost.
    pub(super) lost: bool,
    /// Last frame it sent, and when.
    pub(super) last_frame: u64,
    /// First frame heard from it; 0 for none.
    pub(super) first_frame: u64,
    /// It was told to be another node under a new node-ID.
    pub(super) is_joined: bool,
    pub(super) last_seen: Option<Timestamp>,
    /// Monotonic time of its last frame.
    pub(super) last_heard: i64,
    /// Frame of the reset command since its last boot-up.
    pub(super) reset_frame: Option<(u64, Restart)>,
    /// Identifier of the SYNC it obeys.
    pub(super) sync: CanId,
    /// How it started last.
    pub(super) restart: Restart,
    /// Byte order of EMCY codes, told by the codes.
    pub(super) emcy_order: Option<LearntOrder>,
    /// An object whose presumed value an EMCY contradicts, to be told.
    pub(super) contradicted: Option<ObjectAddress>,
    /// Booted, and no EMCY since.
    pub(super) just_booted: bool,
    /// Boot-ups seen.
    pub(super) boots: u32,
    pub(super) heartbeat: Heartbeat,
    pub(super) guarding: Guarding,
    /// Active error codes, oldest first.
    pub(super) active_errors: Vec<u16>,
    pub(super) last_error: Option<u16>,
    /// Parameters were saved (1010) since the last download.
    pub(super) saved: bool,
    pub(super) store: Arc<Store>,
    /// What the node is; CiA 301 alone where that is not known.
    pub(super) device: Arc<Device>,
    /// What told it.
    pub(super) assigned: Option<AssignedBy>,
    /// What the maker's tool put into PDOs, as the bus file tells.
    pub(super) given_pdos: Arc<Vec<(PdoName, Vec<PdoField>)>>,
    /// What the device does.
    pub(super) behaviour: Behaviour,
    /// What it said of itself when it was last compared with all devices.
    pub(super) introduction: Option<Arc<Introduction>>,
    /// Several devices fit, and that was said.
    pub(super) ambiguous: bool,
    /// Identifiers it has because its device is delivered with them.
    pub(super) delivered_ids: Vec<CanId>,
    /// What contradicted the file of its device.
    pub(super) conflicts: Conflicts,
    /// What is remembered of it as a J1939 device.
    pub(super) j1939: Option<Box<J1939State>>,
}

/// Byte order of EMCY codes that the codes themselves told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LearntOrder(pub(super) ByteOrder);

/// What told which device a node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AssignedBy {
    /// The command line.
    Option,
    /// The bus file.
    BusFile,
    /// An EDS, DCF or XDD file.
    DeviceFile,
    /// What the node said of itself.
    Identity,
    /// Its device type alone, which says what sort of device it is: anything better takes its place.
    DeviceType,
}

impl AssignedBy {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Option => "option",
            Self::BusFile => "bus-file",
            Self::DeviceFile => "device-file",
            Self::Identity => "identity",
            Self::DeviceType => "device-type",
        }
    }
}

impl NmtStatus {
    /// Monotonic nanoseconds of the frame that brought the state, in the clock of [`super::Bus::now`].
    pub fn since(&self) -> i64 {
        self.since
    }
}

impl Node {
    pub(super) fn new(id: NodeId, name: Option<Arc<str>>) -> Self {
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
    pub(super) fn given_pdo(&self, name: PdoName) -> Option<&[PdoField]> {
        self.given_pdos.iter().find(|(given, _)| *given == name).map(|(_, fields)| fields.as_slice())
    }

    /// What an object means now.
    pub fn meaning(&self, object: ObjectAddress) -> Option<Meaning> {
        self.resolver().meaning(object)
    }

    /// What its objects mean, and the numbers they hold.
    pub(super) fn resolver(&self) -> Resolver<'_> {
        Resolver::for_node(&self.device.dictionary, &*self.store, self.id.number())
    }

    /// Sets `attention` from the rest.
    pub(super) fn refresh_attention(&mut self) {
        let settled = self
            .nmt
            .is_some_and(|nmt| nmt.state == NmtState::Operational && nmt.certainty == Certainty::Confirmed);
        self.attention = !settled || self.lost;
    }

    /// What is wrong now, in words for people: codes of EMCY messages, faults of DM1.
    pub(super) fn errors(&self) -> impl Iterator<Item = String> {
        let codes = self.active_errors.iter().map(|code| format!("{code:04X}"));
        codes.chain(self.active_dtcs().map(|(spn, fmi)| format!("SPN {spn} FMI {fmi}")))
    }

    /// Adds an active error; `false` when an old one had to go.
    pub(super) fn raise(&mut self, code: u16) -> bool {
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
    pub(super) fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.active_errors.capacity() * 2
            + self.behaviour.footprint()
            + self.delivered_ids.capacity() * size_of::<CanId>()
            + self.conflicts.footprint()
            + self.j1939.as_ref().map_or(0, |state| state.footprint())
    }
}
