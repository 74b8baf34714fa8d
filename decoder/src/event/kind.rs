//! The one list of kinds of events: names, numbers, descriptions and data come from [`EventKind`].

use strum::{EnumCount, EnumDiscriminants, EnumMessage, EnumProperty, IntoStaticStr, VariantArray};

use super::device::{
    BitsChanged, Conflict, DeviceState, ModeChange, NodeIdentified, ObjectChange, ProcedureEvent, SetPoint,
};
use super::finding::FindingNews;
use super::j1939::{
    AddressClaim, CommandedAddress, Dtc, Irregularity, J1939Acknowledgement, J1939Message, J1939Request,
    J1939Transfer, MessageGap,
};
use super::node::{BootCause, Emergency, Silence, StateChange};
use super::transfer::{Pdo, SdoTransfer};
use super::uds::{IsoTpTransfer, UdsExchange};
use super::undecoded::Undecoded;
use crate::frame::LinkState;
use crate::wire::Malformed;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::error_frame::ErrorFrame;

/// What happened.
///
/// The name of a kind in all output is that of its variant in kebab case, its description the doc comment. `single_frame`: a
/// single frame can say it by itself; all other kinds are made of several frames, or of what was known before.
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
    /// The NMT master commands.
    #[strum_discriminants(strum(props(single_frame = true)))]
    NmtCommand { service: NmtService, target: u8, from: Option<NmtState>, to: Option<NmtState> },
    /// A node's NMT state changed, became known or was confirmed.
    NmtState(StateChange),
    /// A node started.
    #[strum_discriminants(strum(props(single_frame = true)))]
    BootUp { cause: BootCause, lost: u32 },
    /// A producer's heartbeat.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Heartbeat { state: Option<NmtState>, code: u8 },
    /// The master's guarding request, a remote frame.
    #[strum_discriminants(strum(props(single_frame = true)))]
    GuardRequest,
    /// A node's answer to guarding.
    #[strum_discriminants(strum(props(single_frame = true)))]
    GuardReply { state: Option<NmtState>, code: u8, toggle: bool, toggle_error: bool },
    /// A monitored node went silent.
    NodeLost(Silence),
    /// It is heard again.
    NodeBack(Silence),
    /// SYNC.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Sync { counter: Option<u8>, expected: Option<u8> },
    /// TIME.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Time { milliseconds: u32, days: u16 },
    /// An emergency message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Emcy(Emergency),
    /// A PDO, or the request for one.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Pdo(Pdo),
    /// A whole SDO transfer.
    SdoTransfer(Box<SdoTransfer>),
    /// An LSS message.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Lss { command: u8, from_master: bool, content: Content },
    /// A node takes another node-ID.
    NodeIdChange { from: Option<u8>, to: u8, by: &'static str },
    /// What a node said of itself told which device it is.
    NodeIdentified(Box<NodeIdentified>),
    /// A device reports another state of its state machine.
    DeviceState(Box<DeviceState>),
    /// Bits of a control or status word changed.
    BitsChanged(Box<BitsChanged>),
    /// A set point changed, or began or ceased to act.
    SetPoint(Box<SetPoint>),
    /// A mode of operation changed, or became known.
    Mode(Box<ModeChange>),
    /// A procedure of a device started, went a step on, or ended.
    Procedure(Box<ProcedureEvent>),
    /// Two sources say different things of one object.
    Conflict(Box<Conflict>),
    /// The object store learnt another value.
    ObjectChange(Box<ObjectChange>),
    /// The CAN controller's report of an error.
    #[strum_discriminants(strum(props(single_frame = true)))]
    CanError(ErrorFrame),
    /// A frame no protocol explains.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Frame(Undecoded),
    /// Bytes too few for their service, or a command that does not exist.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Malformed { error: Malformed, reason: &'static str },
    /// State was given up to keep memory bounded.
    Evicted { what: &'static str, count: u64 },
    /// Time stamps went backwards.
    ClockStep { step: i64 },
    /// All traffic stopped for a while.
    BusSilent { gap: i64 },
    /// The recorder lost frames.
    LostFrames { count: Option<u64> },
    /// A line or record of the capture that could not be read.
    Unreadable { line: Option<u64>, offset: Option<u64>, count: u64, reason: String },
    /// Something to know about the bus or the capture, said once.
    Note { text: String },
    /// A J1939 message of one frame.
    #[strum_discriminants(strum(props(single_frame = true)))]
    J1939Message(J1939Message),
    /// A J1939 message of several packets, from its first frame to its last.
    J1939Transfer(Box<J1939Transfer>),
    /// A request for a parameter group.
    #[strum_discriminants(strum(props(single_frame = true)))]
    J1939Request(J1939Request),
    /// An answer to a request or command that carries no data.
    #[strum_discriminants(strum(props(single_frame = true)))]
    Acknowledgement(J1939Acknowledgement),
    /// A device claims an address, or cannot.
    #[strum_discriminants(strum(props(single_frame = true)))]
    AddressClaim(AddressClaim),
    /// A device is told to take another address.
    #[strum_discriminants(strum(props(single_frame = true)))]
    CommandedAddress(CommandedAddress),
    /// A diagnostic trouble code was raised, is no longer reported or was cleared.
    Dtc(Box<Dtc>),
    /// A message came later than the device's manual permits.
    MessageGap(Box<MessageGap>),
    /// Something irregular within a transfer that goes on: a gap, a duplicate, a late answer.
    TransportIrregularity(Box<Irregularity>),
    /// A whole ISO-TP message, of one frame or several.
    #[strum_discriminants(strum(serialize = "isotp-transfer"))]
    IsoTpTransfer(Box<IsoTpTransfer>),
    /// A UDS request with its answer.
    UdsExchange(Box<UdsExchange>),
    /// A rule found something wrong; of the same thing again within 5 s only the count grows.
    FindingOpened(Box<FindingNews>),
    /// It is over, or did not come again for 5 s.
    FindingClosed(Box<FindingNews>),
    /// CiA's conformance test tool begins or ends a case.
    #[strum_discriminants(strum(props(single_frame = true)))]
    TestCase(TestMarker),
    /// The way to the bus opened or closed: an interface went down, an adapter was pulled.
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
    /// All kinds in order of their numbers.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What an event of this kind says, in one sentence without its end.
    pub fn description(self) -> &'static str {
        self.get_documentation().unwrap_or_default().trim_end_matches('.')
    }

    /// Whether a single frame can say it by itself.
    pub fn is_of_one_frame(self) -> bool {
        self.get_bool("single_frame").unwrap_or_default()
    }
}
