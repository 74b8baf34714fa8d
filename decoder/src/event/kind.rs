//! List of all event kinds. Names, numbers, descriptions and data are derived from [`EventKind`].

use std::sync::Arc;

use strum::{EnumCount, EnumDiscriminants, EnumMessage, EnumProperty, IntoStaticStr, VariantArray};

use super::device::{
    BitsChanged, DeviceState, ModeChange, NodeIdentified, ObjectChange, ProcedureEvent, SetPoint,
    SourceConflict,
};
use super::evicted::EvictedState;
use super::finding::FindingNews;
use super::j1939::{
    AddressClaim, CommandedAddress, Dtc, J1939Acknowledgement, J1939Message, J1939Request, J1939Transfer,
    MessageGap, TransferIrregularity,
};
use super::node::{BootCause, Emergency, NodeIdSource, NodeSilence, StateChange};
use super::transfer::{DecodedPdo, SdoTransfer};
use super::uds::{IsoTpTransfer, UdsExchange};
use super::undecoded::UndecodedFrame;
use crate::frame::LinkState;
use crate::wire::MalformedPayload;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::LssContent;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::error_frame::ErrorFrameFields;

/// Kind of an event with its data.
///
/// The name of a kind in all output is its variant in kebab case; its description is the doc comment.
/// `single_frame` marks a kind that a single frame can show; all others need several frames or earlier
/// knowledge.
#[derive(Debug, Clone, EnumDiscriminants)]
#[strum_discriminants(
    name(Kind),
    doc = "A kind of event, without its data; its place in the list is its number.",
    non_exhaustive,
    derive(EnumCount, EnumMessage, EnumProperty, IntoStaticStr, VariantArray, PartialOrd, Ord, Hash),
    strum(serialize_all = "kebab-case")
)]
#[expect(missing_docs, reason = "fields are documented by the field table in query/")]
#[non_exhaustive]
pub enum EventKind {
    /// An NMT command of the master.
    #[strum_discriminants(strum(props(single_frame = true)))]
    NmtCommand { service: NmtService, target: u8, from: Option<NmtState>, to: Option<NmtState> },
    /// A node's NMT state changed, became known or was confirmed.
    NmtState(StateChange),
    /// A node booted.
    #[strum_discriminants(strum(props(single_frame = true)))]
    BootUp { cause: BootCause, lost: u32 },
    /// A heartbeat of a producer.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Heartbeat { state: Option<NmtState>, code: u8 },
    /// A guarding request of the master, a remote frame.
    #[strum_discriminants(strum(props(single_frame = true)))]
    GuardRequest,
    /// A guarding response of a node.
    #[strum_discriminants(strum(props(single_frame = true)))]
    GuardReply { state: Option<NmtState>, code: u8, toggle: bool, toggle_error: bool },
    /// A monitored node fell silent.
    NodeLost(NodeSilence),
    /// A lost node was received again.
    NodeBack(NodeSilence),
    /// A SYNC message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Sync { counter: Option<u8>, expected: Option<u8> },
    /// A TIME message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Time { milliseconds: u32, days: u16 },
    /// An emergency message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Emcy(Emergency),
    /// A PDO, or a remote request for one.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Pdo(DecodedPdo),
    /// A complete SDO transfer.
    SdoTransfer(Box<SdoTransfer>),
    /// An LSS message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Lss { command: u8, from_master: bool, content: LssContent },
    /// A node changed its node-ID.
    NodeIdChange { from: Option<u8>, to: u8, by: NodeIdSource },
    /// The device of a node was identified.
    NodeIdentified(Box<NodeIdentified>),
    /// A device reports a new state of its state machine.
    DeviceState(Box<DeviceState>),
    /// Bits of a control or status word changed.
    BitsChanged(Box<BitsChanged>),
    /// A set point changed, or became effective or ineffective.
    SetPoint(Box<SetPoint>),
    /// A mode of operation changed, or became known.
    Mode(Box<ModeChange>),
    /// A procedure of a device started, advanced or ended.
    Procedure(Box<ProcedureEvent>),
    /// Two sources contradict each other about an object.
    Conflict(Box<SourceConflict>),
    /// A value in the object store changed.
    ObjectChange(Box<ObjectChange>),
    /// An error reported by the CAN controller.
    #[strum_discriminants(strum(props(single_frame = true)))]
    CanError(ErrorFrameFields),
    /// A frame that belongs to no known protocol.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Frame(UndecodedFrame),
    /// A message too short for its service, or with an undefined command.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Malformed { error: MalformedPayload, reason: &'static str },
    /// State was evicted to keep memory bounded.
    Evicted { what: EvictedState, count: u64 },
    /// Timestamps went backwards, or the clock was set forward during a live capture.
    ClockStep { step: i64 },
    /// All traffic stopped for a while.
    BusSilent { gap: i64 },
    /// Frames were lost during the capture.
    LostFrames { count: Option<u64> },
    /// A line or record of the capture is unreadable; `file` is its file in a capture of several parts.
    Unreadable { file: Option<Arc<str>>, line: Option<u64>, offset: Option<u64>, count: u64, reason: String },
    /// A notice about the bus or the capture, emitted once.
    Note { text: String },
    /// A single-frame J1939 message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    J1939Message(J1939Message),
    /// A multi-packet J1939 message, from its first frame to its last.
    J1939Transfer(Box<J1939Transfer>),
    /// A request for a parameter group.
    #[strum_discriminants(strum(props(single_frame = true)))]
    J1939Request(J1939Request),
    /// A response without data to a request or command.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Acknowledgement(J1939Acknowledgement),
    /// A device claims an address, or cannot.
    #[strum_discriminants(strum(props(single_frame = true)))]
    AddressClaim(AddressClaim),
    /// A device is commanded to change its address.
    #[strum_discriminants(strum(props(single_frame = true)))]
    CommandedAddress(CommandedAddress),
    /// A diagnostic trouble code was raised, is no longer reported or was cleared.
    Dtc(Box<Dtc>),
    /// A message was later than the device manual permits.
    MessageGap(Box<MessageGap>),
    /// An irregularity that does not end a transfer: a gap, a duplicate, a late response.
    TransportIrregularity(Box<TransferIrregularity>),
    /// A complete ISO-TP message, single-frame or multi-frame.
    #[strum_discriminants(strum(serialize = "isotp-transfer"))]
    IsoTpTransfer(Box<IsoTpTransfer>),
    /// A UDS request with its response.
    UdsExchange(Box<UdsExchange>),
    /// A rule reports a defect; repetitions within 5 s only increase the count.
    FindingOpened(Box<FindingNews>),
    /// A finding is over, or did not occur again for 5 s.
    FindingClosed(Box<FindingNews>),
    /// A case of CiA's conformance test tool begins or ends.
    #[strum_discriminants(strum(props(single_frame = true)))]
    TestCase(TestMarker),
    /// The connection to the bus opened or closed: an interface went down, an adapter was unplugged.
    Link { state: LinkState, bit_rate: Option<u32> },
}

impl EventKind {
    /// The kind without its data.
    #[inline]
    pub fn kind(&self) -> Kind {
        self.into()
    }

    /// The name used in all output.
    #[inline]
    pub fn name(&self) -> &'static str {
        self.kind().name()
    }
}

impl Kind {
    /// All kinds, in order of their numbers.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The kind with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.name() == name)
    }

    /// Description of the kind: one sentence without a full stop.
    pub fn description(self) -> &'static str {
        self.get_documentation().unwrap_or_default().trim_end_matches('.')
    }

    /// Whether a single frame can show an event of this kind.
    pub fn is_of_one_frame(self) -> bool {
        self.get_bool("single_frame").unwrap_or_default()
    }
}
