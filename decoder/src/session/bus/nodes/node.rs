//! State of one node.

use std::sync::Arc;

use super::behaviour::DeviceBehaviour;
use super::conflicts::EmittedConflicts;
use super::errors::ActiveErrors;
use super::faults::J1939State;
use super::monitoring::{GuardingState, HeartbeatState};
use super::restart::RestartType;
use crate::event::{AssignedBy, StateCause, StateCertainty};
use crate::frame::{CanId, Timestamp};
use crate::profile::device::PdoField;
use crate::profile::{DeviceProfile, EntryResolver, ObjectMeaning, PdoName, ReportedIdentity, plain_device};
use crate::session::bus::hints::ProfileSigns;
use crate::session::bus::objects::{ObjectStore, StoredOrigin};
use crate::wire::NodeId;
use crate::wire::canopen::emcy::EmcyByteOrder;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::j1939::J1939Name;

/// NMT state with its certainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NmtStatus {
    /// NMT state of the node.
    pub state: NmtState,
    /// Confirmed or presumed.
    pub certainty: StateCertainty,
    /// Last evidence for the state.
    pub cause: StateCause,
    /// Frame that changed the state.
    pub frame: u64,
    /// Monotonic time of that frame, in ns.
    pub(crate) since: i64,
}

/// State of one node.
#[derive(Debug, Clone)]
pub struct Node {
    /// Present node-ID or address.
    pub(in crate::session) id: NodeId,
    /// Node-ID before its last change; None if it never changed.
    pub(in crate::session) previous_id: Option<NodeId>,
    /// Behaviour that can suggest a profile.
    pub(in crate::session) signs: ProfileSigns,
    /// Name from the user.
    pub(in crate::session) name: Option<Arc<str>>,
    /// NMT state; `None` if unknown.
    pub(in crate::session) nmt: Option<NmtStatus>,
    /// PDOs of this node need checks: it is lost, or not confirmed as operational.
    pub(in crate::session) attention: bool,
    /// The node was reported as lost.
    pub(in crate::session) lost: bool,
    /// Last frame of the node; its time is `last_seen`.
    pub(in crate::session) last_frame: u64,
    /// First frame of the node; 0 for none.
    pub(in crate::session) first_frame: u64,
    /// The bus file states that the node was present before the first frame.
    pub(in crate::session) was_present: bool,
    /// The node was already identified with one under another node-ID.
    pub(in crate::session) is_joined: bool,
    pub(in crate::session) last_seen: Option<Timestamp>,
    /// Monotonic time of its last frame.
    pub(in crate::session) last_received: i64,
    /// NMT reset since the last boot-up: frame and type.
    pub(in crate::session) reset_frame: Option<(u64, RestartType)>,
    /// Identifier of the SYNC that the node uses.
    pub(in crate::session) sync: CanId,
    /// Type of the last restart.
    pub(in crate::session) restart: RestartType,
    /// Byte order of EMCY codes, detected from the codes.
    pub(in crate::session) emcy_order: Option<DetectedByteOrder>,
    /// Object whose presumed value contradicts an EMCY; pending until reported.
    pub(in crate::session) contradicted: Option<ObjectAddress>,
    /// No EMCY since the last boot-up.
    pub(in crate::session) just_booted: bool,
    /// Boot-ups counted.
    pub(in crate::session) boots: u32,
    pub(in crate::session) heartbeat: HeartbeatState,
    pub(in crate::session) guarding: GuardingState,
    pub(in crate::session) errors: ActiveErrors,
    /// Parameters were stored (1010) after the last download.
    pub(in crate::session) saved: bool,
    pub(in crate::session) store: Arc<ObjectStore>,
    /// Assigned device; a device with CiA 301 objects only if none is assigned.
    pub(in crate::session) device: Arc<DeviceProfile>,
    /// Source of the assignment.
    pub(in crate::session) assigned: Option<AssignedBy>,
    /// PDO contents set by the manufacturer's tool, from the bus file.
    pub(in crate::session) given_pdos: Arc<Vec<(PdoName, Vec<PdoField>)>>,
    /// State machines, set points and procedures of the device.
    pub(in crate::session) behaviour: DeviceBehaviour,
    /// Identity used for the last search of a matching device.
    pub(in crate::session) introduction: Option<Arc<ReportedIdentity>>,
    /// Ambiguity between several matching devices was already reported.
    pub(in crate::session) ambiguous: bool,
    /// Identifiers from the delivery state of the device.
    pub(in crate::session) delivered_ids: Vec<CanId>,
    /// Contradictions to the device file.
    pub(in crate::session) conflicts: EmittedConflicts,
    /// State as a J1939 device.
    pub(in crate::session) j1939: Option<Box<J1939State>>,
}

/// Byte order of EMCY codes, detected from the codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct DetectedByteOrder(pub(in crate::session) EmcyByteOrder);

impl NmtStatus {
    /// Whether the node reported the state by heartbeat or guarding.
    pub(in crate::session) fn is_reported(&self) -> bool {
        matches!(
            self.cause,
            StateCause::Heartbeat | StateCause::GuardReply | StateCause::BusFile { is_reported: true }
        )
    }

    /// Monotonic time of the frame that changed the state, in ns, as in [`crate::session::Bus::now`].
    pub fn changed_at(&self) -> i64 {
        self.since
    }
}

impl Node {
    pub(in crate::session) fn new(id: NodeId, name: Option<Arc<str>>) -> Self {
        Self {
            id,
            previous_id: None,
            signs: ProfileSigns::default(),
            name,
            nmt: None,
            attention: true,
            lost: false,
            last_frame: 0,
            first_frame: 0,
            was_present: false,
            is_joined: false,
            last_seen: None,
            last_received: 0,
            reset_frame: None,
            sync: CanId::from_standard(0x80),
            restart: RestartType::PowerOn,
            emcy_order: None,
            contradicted: None,
            just_booted: false,
            boots: 0,
            heartbeat: HeartbeatState::default(),
            guarding: GuardingState::default(),
            errors: ActiveErrors::default(),
            saved: false,
            store: Arc::default(),
            device: Arc::clone(plain_device()),
            assigned: None,
            given_pdos: Arc::default(),
            behaviour: DeviceBehaviour::default(),
            introduction: None,
            ambiguous: false,
            delivered_ids: Vec::new(),
            conflicts: EmittedConflicts::default(),
            j1939: None,
        }
    }

    /// Present node-ID or address.
    pub fn id(&self) -> NodeId {
        self.id
    }

    /// Name from the user.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// NMT state; `None` if unknown.
    pub fn nmt(&self) -> Option<NmtStatus> {
        self.nmt
    }

    /// Boot-ups counted.
    pub fn boot_count(&self) -> u32 {
        self.boots
    }

    /// Error codes raised and not cleared; an upper bound if the device does not clear each code.
    pub fn active_errors(&self) -> &[u16] {
        self.errors.codes()
    }

    /// Behaviour that can suggest a profile.
    pub(crate) fn signs(&self) -> &ProfileSigns {
        &self.signs
    }

    /// Number and time of the last frame of the node.
    pub fn last_seen(&self) -> (u64, Option<Timestamp>) {
        (self.last_frame, self.last_seen)
    }

    /// Identifier of the SYNC that the node uses.
    pub fn sync(&self) -> CanId {
        self.sync
    }

    /// Confirmed raw value of an object, not doubtful since, and its origin.
    pub fn proven_value(&self, object: ObjectAddress) -> Option<(i64, StoredOrigin)> {
        let entry = self.store.seen_value(object).filter(|entry| !entry.stale)?;
        let number = self.resolver().resolve_number(object).filter(|number| !number.assumed)?;
        Some((number.raw, entry.origin))
    }

    /// Whether it is silent for longer than its monitoring time.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Whether a message to the node is older than its time limit.
    pub(crate) fn is_overdue(&self, message: &str) -> bool {
        self.behaviour.overdue.iter().any(|overdue| **overdue == *message)
    }

    /// Object values of the node.
    pub fn store(&self) -> &ObjectStore {
        &self.store
    }

    /// Assigned device; a device with CiA 301 objects only if none is assigned.
    pub fn device(&self) -> &Arc<DeviceProfile> {
        &self.device
    }

    /// Source of the device assignment.
    pub fn assigned_by(&self) -> Option<AssignedBy> {
        self.assigned
    }

    /// Title of the assigned device.
    pub fn device_title(&self) -> Option<&str> {
        self.assigned.map(|_| self.device.title.as_str())
    }

    /// Profile and variant of the assigned device.
    pub fn device_id(&self) -> Option<&str> {
        self.assigned.map(|_| self.device.full_id.as_str())
    }

    /// Contents of a PDO in the bus file.
    pub(in crate::session) fn given_pdo(&self, name: PdoName) -> Option<&[PdoField]> {
        self.given_pdos.iter().find(|(given, _)| *given == name).map(|(_, fields)| fields.as_slice())
    }

    /// Present meaning of an object.
    pub fn meaning(&self, object: ObjectAddress) -> Option<ObjectMeaning> {
        self.resolver().resolve_meaning(object)
    }

    /// Resolver for the meanings and values of the node's objects.
    pub(in crate::session) fn resolver(&self) -> EntryResolver<'_> {
        EntryResolver::for_node(&self.device.dictionary, &*self.store, self.id.number())
    }

    /// Updates `attention` after a change of `nmt` or `lost`.
    pub(in crate::session) fn refresh_attention(&mut self) {
        let settled = self.nmt.is_some_and(|nmt| {
            nmt.state == NmtState::Operational && nmt.certainty == StateCertainty::Confirmed
        });
        self.attention = !settled || self.lost;
    }

    /// Active errors as text: EMCY codes, and faults of DM1.
    pub(in crate::session) fn error_texts(&self) -> impl Iterator<Item = String> {
        let codes = self.errors.codes().iter().map(|code| format!("{code:04X}"));
        codes.chain(self.active_dtcs().map(|(spn, fmi)| format!("SPN {spn} FMI {fmi}")))
    }

    /// Bytes held, without the store.
    pub(in crate::session) fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.errors.footprint()
            + self.behaviour.footprint()
            + self.delivered_ids.capacity() * size_of::<CanId>()
            + self.conflicts.footprint()
            + self.j1939.as_ref().map_or(0, |state| state.footprint())
    }
}

impl Node {
    /// SPN and FMI of the trouble codes in the last DM1.
    pub fn active_dtcs(&self) -> impl Iterator<Item = (u32, u8)> {
        self.j1939.iter().flat_map(|state| state.faults.active_codes())
    }
}

impl Node {
    /// NAME of a J1939 device; `None` before its address claim.
    pub fn j1939_name(&self) -> Option<J1939Name> {
        self.j1939.as_ref()?.name
    }

    /// State as a J1939 device, created on first use.
    pub(in crate::session) fn j1939_state(&mut self) -> &mut J1939State {
        self.j1939.get_or_insert_default()
    }
}
