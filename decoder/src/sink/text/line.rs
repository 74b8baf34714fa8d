//! Text of each kind of event.

use super::parts::{EventWords, LineContent, node_label, push_node};
use super::pdo_head::{self, push_who};
use super::tone::LineTone;
use super::transfer::TransferWords;
use super::{bus, device, emcy, finding, j1939, node, pdo, sdo, uds};
use crate::event::{Event, EventKind};
use crate::query::record::event_device as device_of;
use crate::session::Bus;

/// Columns after the time, as UTF-8, with control characters not yet escaped.
#[derive(Default)]
pub(super) struct LineColumns {
    /// Node, or source → destination.
    pub(super) who: Vec<u8>,
    /// KIND column, at most six letters.
    pub(super) kind: &'static str,
    /// Description of the event.
    pub(super) what: Vec<u8>,
    /// Emphasis of the line.
    pub(super) tone: LineTone,
}

/// Event as text in columns, with control characters not yet escaped.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EventLine {
    /// Node, or source → destination.
    pub who: String,
    /// KIND column, at most six letters.
    pub kind: &'static str,
    /// Description of the event.
    pub what: String,
    /// Emphasis of the line.
    pub tone: LineTone,
}

impl EventLine {
    /// Describes an event on its bus.
    pub fn describe_event(event: &Event, bus: &Bus) -> Self {
        let mut columns = LineColumns::default();
        columns.fill_columns(event, bus);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self { who: text(&columns.who), kind: columns.kind, what: text(&columns.what), tone: columns.tone }
    }
}

impl LineColumns {
    /// Replaces all columns with those of an event.
    pub(super) fn fill_columns(&mut self, event: &Event, bus: &Bus) {
        self.who.clear();
        self.what.clear();
        // PDO, SDO transfer and EMCY are the most frequent events; they are written without `fmt`.
        match &event.kind {
            EventKind::Pdo(pdo) => {
                (self.kind, self.tone) = (pdo_head::KIND, LineTone::Plain);
                push_who(event.node, bus, &mut self.who);
                pdo::push_name(pdo.name, &mut self.what);
                pdo::push_payload(pdo, &mut self.what);
                pdo::push_text(pdo, event, bus, pdo.layout.is_none(), &mut self.what);
            }
            EventKind::Emcy(emergency) => {
                (self.kind, self.tone) = emcy::push_words(emergency, device_of(event, bus), &mut self.what);
                if let Some(node) = event.node {
                    push_node(node, bus, &mut self.who);
                }
            }
            EventKind::SdoTransfer(transfer) => {
                (self.kind, self.tone) = sdo::push_words(transfer, event, bus, &mut self.who, &mut self.what);
            }
            _ => self.fill_general(event, bus),
        }
    }

    fn fill_general(&mut self, event: &Event, bus: &Bus) {
        let words = event_words(event, bus);
        (self.kind, self.tone) = (words.kind, words.tone);
        self.who.extend_from_slice(words.who.as_bytes());
        self.what.extend_from_slice(words.what.as_bytes());
    }
}

fn event_words(event: &Event, bus: &Bus) -> EventWords {
    let of_node = |(kind, what, tone): LineContent| {
        let who = event.node.map_or(String::new(), |node| node_label(node, bus));
        EventWords { who, kind, what, tone }
    };
    match &event.kind {
        // Written by `fill` without `fmt`.
        EventKind::Pdo(_) | EventKind::Emcy(_) | EventKind::SdoTransfer(_) => EventWords::default(),
        EventKind::NmtCommand { service, target, from, to } => {
            node::nmt_command(*service, *target, [*from, *to], bus)
        }
        EventKind::NmtState(change) => of_node(node::nmt_state(change)),
        EventKind::BootUp { cause, lost } => of_node(node::boot_up(*cause, *lost)),
        EventKind::Heartbeat { state, code } => of_node(node::heartbeat_line(*state, *code)),
        EventKind::GuardRequest => node::guard_request(event.node, bus),
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            of_node(node::guard_reply(*state, *code, *toggle, *toggle_error))
        }
        EventKind::NodeLost(silence) => of_node(node::node_lost(silence)),
        EventKind::NodeBack(silence) => of_node(node::node_back(silence)),
        EventKind::Sync { counter, expected } => of_node(bus::sync_line(*counter, *expected)),
        EventKind::Time { milliseconds, days } => of_node(bus::time_line(*milliseconds, *days)),
        EventKind::Lss { command, from_master, content } => node::lss_words(*command, *from_master, content),
        EventKind::NodeIdChange { from, to, by } => of_node(node::node_id_change(*from, *to, *by)),
        EventKind::NodeIdentified(node) => of_node(device::identified_line(node, event.node)),
        EventKind::DeviceState(state) => of_node(device::state_line(state)),
        EventKind::BitsChanged(bits) => of_node(device::bits_line(bits)),
        EventKind::SetPoint(point) => of_node(device::set_point(point)),
        EventKind::Mode(mode) => of_node(device::mode_line(mode)),
        EventKind::Procedure(procedure) => of_node(device::procedure_line(procedure)),
        EventKind::Conflict(conflict) => of_node(device::conflict_line(conflict)),
        EventKind::ObjectChange(change) => of_node(device::object_change(change)),
        EventKind::J1939Message(message) => j1939::message_line(message, bus),
        EventKind::J1939Transfer(transfer) => j1939::transfer_line(transfer, bus),
        EventKind::J1939Request(request) => j1939::request_line(request, bus),
        EventKind::Acknowledgement(answer) => j1939::acknowledgement_line(answer, bus),
        EventKind::AddressClaim(claim) => j1939::claim_line(claim, bus),
        EventKind::CommandedAddress(command) => j1939::commanded_address(command, bus),
        EventKind::Dtc(dtc) => j1939::trouble_code(dtc, event, bus),
        EventKind::MessageGap(gap) => j1939::message_gap(gap, event, bus),
        EventKind::TransportIrregularity(irregularity) => j1939::irregularity_line(irregularity, bus),
        EventKind::IsoTpTransfer(message) => uds::isotp_line(message),
        EventKind::UdsExchange(exchange) => uds::exchange_line(exchange, event, bus),
        EventKind::FindingOpened(news) => of_node(finding::opened_line(news)),
        EventKind::FindingClosed(news) => of_node(finding::closed_line(news)),
        EventKind::CanError(error) => of_node(bus::can_error(*error)),
        EventKind::TestCase(marker) => of_node(bus::test_case(*marker)),
        EventKind::Frame(undecoded) => of_node(bus::frame_line(undecoded)),
        EventKind::Malformed { error, reason } => of_node(bus::malformed_line(error, reason)),
        EventKind::Evicted { what, count } => of_node(bus::evicted_line(*what, *count)),
        EventKind::ClockStep { step } => of_node(bus::clock_step(*step)),
        EventKind::BusSilent { gap } => of_node(bus::bus_silent(*gap)),
        EventKind::LostFrames { count } => of_node(bus::lost_frames(*count)),
        EventKind::Link { state, bit_rate } => of_node(bus::link_line(*state, *bit_rate)),
        EventKind::Unreadable { file, line, offset, reason, .. } => {
            of_node(bus::unreadable_line(file.as_deref(), *line, *offset, reason))
        }
        EventKind::Note { text } => of_node(("NOTE", text.clone(), LineTone::Caution)),
    }
}
impl TransferWords {
    /// The text of a transfer; None for other events.
    pub fn of_event(event: &Event, bus: &Bus) -> Option<Self> {
        match &event.kind {
            EventKind::SdoTransfer(transfer) => Some(sdo::transfer_words(transfer, device_of(event, bus))),
            EventKind::UdsExchange(exchange) => Some(uds::transfer_words(exchange, device_of(event, bus))),
            EventKind::J1939Transfer(transfer) => Some(j1939::transfer_words(transfer)),
            _ => None,
        }
    }
}
