//! Path of a frame: time and deadlines first, then by its identifier to the machine of its service.

use std::sync::Arc;

use super::bus::{AmbiguousGap, Bus, IdentifierService, RouteOrigin, UdsLink};
use super::canopen::{
    ConformanceMarks, EmcyMachine, ErrorControlMachine, LssMachine, NmtMachine, PdoMachine, SdoMachine,
    SyncMachine, TimeStamps, proves_canopen,
};
use super::context::SharedState;
use super::device::DeviceMachine;
use super::given::{apply_given, emit_given_states};
use super::j1939::{
    ClaimMachine, FastPackets, GroupPayload, MessageMachine, RequestMachine, TransportMachine,
    TroubleCodeMachine, mark_sender_alive,
};
use super::learning::learn_object;
use super::machine::{ProtocolMachine, TimedMachine};
use super::observer::Observer;
use super::options::SessionOptions;
use super::timers::DeadlineSubject;
use super::uds::{IsoTpMachine, ObdPairs, PairSearch, UdsMachine};
use crate::event::{Event, EventKind, EventProtocol, EvictedState, FrameRange};
use crate::frame::{BusIndex, Frame, FrameFlags, Timestamp};
use crate::wire::canopen::lss;
use crate::wire::error_frame;
use crate::wire::j1939::{ALL, J1939Id, NO_ADDRESS, Pgn};
use crate::words::count_noun;

/// Decodes the frames of one bus to events. A clone is a checkpoint.
#[derive(Debug, Clone)]
pub struct BusDecoder {
    pub(super) shared: SharedState,
    nmt: NmtMachine,
    error_control: ErrorControlMachine,
    emcy: EmcyMachine,
    sync: SyncMachine,
    time_stamps: TimeStamps,
    marks: ConformanceMarks,
    lss: LssMachine,
    sdo: SdoMachine,
    pdo: PdoMachine,
    requests: RequestMachine,
    claims: ClaimMachine,
    messages: MessageMachine,
    transports: TransportMachine,
    fast_packets: FastPackets,
    trouble_codes: TroubleCodeMachine,
    isotp: IsoTpMachine,
    obd: ObdPairs,
    pub(super) pairs: PairSearch,
    uds: UdsMachine,
    devices: DeviceMachine,
    /// Error counters that the controller reported last: of transmitting, of receiving.
    error_counters: Option<(u8, u8)>,
    /// Consecutive frames that only the observer needed.
    pub(super) needed_in_a_row: u8,
}

impl BusDecoder {
    /// Decoder of a bus before its first frame, with the options for this bus applied.
    pub fn new(index: BusIndex, name: &str, options: Arc<SessionOptions>) -> Self {
        let mut shared = SharedState::new(Bus::new(index, name, options));
        apply_given(&mut shared.lend_context(&mut |_: &Event, _: &Bus| {}));
        Self {
            shared,
            nmt: NmtMachine,
            error_control: ErrorControlMachine,
            emcy: EmcyMachine::default(),
            sync: SyncMachine::default(),
            time_stamps: TimeStamps::default(),
            marks: ConformanceMarks,
            lss: LssMachine::default(),
            sdo: SdoMachine::default(),
            pdo: PdoMachine,
            requests: RequestMachine,
            claims: ClaimMachine::default(),
            messages: MessageMachine,
            transports: TransportMachine::default(),
            fast_packets: FastPackets::default(),
            trouble_codes: TroubleCodeMachine,
            isotp: IsoTpMachine::default(),
            obd: ObdPairs::default(),
            pairs: PairSearch::default(),
            uds: UdsMachine::default(),
            devices: DeviceMachine,
            error_counters: None,
            needed_in_a_row: 0,
        }
    }

    /// Present state of the bus.
    pub fn bus(&self) -> &Bus {
        &self.shared.bus
    }

    /// Decodes the next frame and sends its events to `out`.
    pub fn push(&mut self, frame: &Frame, out: &mut dyn Observer) {
        self.push_all(std::slice::from_ref(frame), out);
    }

    /// Decodes the next frames, as [`Self::push`] with each of them.
    pub(crate) fn push_all(&mut self, frames: &[Frame], out: &mut dyn Observer) {
        for frame in frames {
            let identifier = self.shared.bus.routes.find_slot(frame.id);
            if !identifier.is_some_and(|identifier| self.take_quickly(identifier, frame, out)) {
                self.decode_frame(identifier, frame, out);
            }
        }
    }

    /// An error frame; equal error counters are routine. An overflow of the receive buffer also shows that frames are missing from the capture.
    fn on_error_frame(&mut self, frame: &Frame, out: &mut dyn Observer) {
        let error = error_frame::parse_error_frame(frame.id.number(), frame.data());
        let counters = error.is_only_counters().then_some((error.transmit_errors, error.receive_errors));
        let is_same = counters.is_some() && self.error_counters == counters;
        self.error_counters = counters.or(self.error_counters);
        let mut cx = self.shared.lend_context(out);
        let mut event = cx.canopen_event(frame, EventKind::CanError(error));
        (event.protocol, event.presumed, event.routine) = (EventProtocol::Can, false, is_same);
        cx.send_event(&event);
        if error.is_receive_overflow() {
            cx.emit_can(frame, EventKind::LostFrames { count: None });
        }
    }

    /// Decodes a frame and sends its events to `out`; `identifier` is the index of its identifier, if it is known.
    #[inline(never)]
    fn decode_frame(&mut self, identifier: Option<usize>, frame: &Frame, out: &mut dyn Observer) {
        if let Some(stamp) = frame.time {
            self.advance_clock(stamp, frame.number, out);
        }
        (self.shared.bus.last_frame, self.shared.bus.last_time) = (frame.number, frame.time);
        if self.shared.bus.has_given_states {
            emit_given_states(frame, &mut self.shared.lend_context(out));
        }
        if frame.flags.contains(FrameFlags::ERROR) {
            return self.on_error_frame(frame, out);
        }
        let slot = identifier.or_else(|| self.add_slot(frame, out));
        let Some(slot) = slot else { return self.on_frame_without_slot(frame, out) };
        let bus = &mut self.shared.bus;
        // A request by a remote frame is not a message of the node that the identifier belongs to.
        let noted = if frame.flags.contains(FrameFlags::REMOTE) {
            bus.routes.slot(slot).map(|state| state.service)
        } else {
            bus.routes.note_frame(slot, (bus.clock.now(), frame.number))
        };
        let Some(service) = noted else { return };
        if self.is_pair_undecided(service, frame) && self.on_undecided_frame((slot, service), frame, out) {
            return;
        }
        if frame.flags.contains(FrameFlags::FD) && !matches!(service, IdentifierService::IsoTp(_)) {
            return self.on_fd_frame(frame, service, out);
        }
        if frame.flags.contains(FrameFlags::REMOTE) && !service.has_remote_frames() {
            return self.shared.lend_context(out).emit_undecoded(frame, None);
        }
        let cx = &mut self.shared.lend_context(out);
        if self.emcy.holds_frames() {
            self.emcy.on_proof(proves_canopen(service, frame), frame, cx);
        }
        match service {
            IdentifierService::Pdo(name, node) => self.pdo.on_frame((slot, name, node), frame, cx),
            IdentifierService::J1939(id) => self.on_j1939(Some(slot), id, frame, out),
            IdentifierService::Sync => {
                if self.sync.on_frame((), frame, cx) {
                    self.devices.on_frame((), frame, cx);
                }
            }
            IdentifierService::ErrorControl(node) => self.error_control.on_frame(node, frame, cx),
            IdentifierService::Sdo(side, channel) => {
                if let Some(transfer) = self.sdo.on_frame((side, channel), frame, cx) {
                    learn_object(transfer, frame, cx);
                }
            }
            IdentifierService::Emcy(node) => self.emcy.on_frame(node, frame, cx),
            IdentifierService::Nmt => self.nmt.on_frame((), frame, cx),
            IdentifierService::Time => self.time_stamps.on_frame((), frame, cx),
            IdentifierService::Lss(from_master) => self.on_lss(from_master, service, frame, out),
            IdentifierService::IsoTp(link) => self.on_isotp(link, frame, out),
            IdentifierService::TestMarker => self.marks.on_frame((), frame, cx),
            _ if service.is_undecoded() && ObdPairs::is_obd_identifier(frame.id) => {
                self.on_obd_frame(service, frame, out);
            }
            IdentifierService::Unclassified => cx.emit_undecoded(frame, None),
            IdentifierService::Named(name) => cx.emit_undecoded(frame, Some(name)),
        }
    }

    /// Handles a frame on an identifier of LSS; unless CANopen is confirmed, a server of OBD may use it.
    fn on_lss(
        &mut self,
        from_master: bool,
        service: IdentifierService,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let cx = &mut self.shared.lend_context(out);
        if !cx.bus.protocols.canopen.is_confirmed() {
            self.obd.note_request(frame);
            if frame.data().first().is_some_and(|command| !lss::is_defined_command(*command, from_master)) {
                return self.on_obd_frame(service, frame, out);
            }
        }
        self.lss.on_frame(from_master, frame, cx);
    }

    pub(super) fn on_isotp(&mut self, link: UdsLink, frame: &Frame, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend_context(out);
        if ObdPairs::is_functional(frame.id) {
            self.obd.note_request(frame);
        }
        if let Some(message) = self.isotp.on_frame(link, frame, cx) {
            self.uds.on_frame(message, frame, cx);
        }
    }

    /// Handles a frame on an identifier of OBD that is not decoded; the first response to a request is.
    #[cold]
    fn on_obd_frame(&mut self, service: IdentifierService, frame: &Frame, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend_context(out);
        let Some(pair) = self.obd.take_frame(frame, cx) else {
            let name = if let IdentifierService::Named(name) = service { Some(name) } else { None };
            return cx.emit_undecoded(frame, name);
        };
        // A request to all that is decoded already waits for further responses.
        if !self.uds.is_waiting(pair.request) {
            self.uds.begin_unseen(pair.request, &pair.frame, frame, cx);
        }
        if let Some(message) = self.isotp.on_frame(pair.response, frame, cx) {
            self.uds.on_frame(message, frame, cx);
        }
    }

    /// Handles a frame on a J1939 identifier; `slot` is `None` if the table of 29-bit identifiers is full.
    pub(super) fn on_j1939(
        &mut self,
        slot: Option<usize>,
        id: J1939Id,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let cx = &mut self.shared.lend_context(out);
        if !cx.bus.protocols.j1939.is_confirmed() && !self.follows_group(id, frame, out) {
            return;
        }
        let cx = &mut self.shared.lend_context(out);
        if id.pgn == Pgn::ADDRESS_CLAIMED && id.destination == ALL && id.source <= NO_ADDRESS {
            return self.claims.on_frame(id, frame, cx);
        }
        mark_sender_alive(&mut cx.bus, id.source, frame);
        match id.pgn {
            Pgn::REQUEST | Pgn::ACKNOWLEDGEMENT => self.requests.on_frame(id, frame, cx),
            Pgn::DM1 | Pgn::DM2 | Pgn::COMMANDED_ADDRESS => {
                self.messages.on_frame((slot, id), frame, cx);
                if !frame.flags.contains(FrameFlags::REMOTE) {
                    let frames = FrameRange::one(frame.number);
                    self.on_payload(GroupPayload { id, data: frame.data(), frames }, frame, out);
                }
            }
            Pgn::TP_CM | Pgn::TP_DT | Pgn::ETP_CM | Pgn::ETP_DT => {
                if let Some(transfer) = self.transports.on_frame(id, frame, cx) {
                    self.on_payload(transfer.as_payload(), &transfer.frame, out);
                }
            }
            pgn if cx.bus.protocols.sends_fast_packets(pgn) => self.fast_packets.on_frame(id, frame, cx),
            _ => self.messages.on_frame((slot, id), frame, cx),
        }
    }

    /// Handles a complete payload, from one frame or several, of a group about addresses or faults.
    pub(in crate::session) fn on_payload(
        &mut self,
        payload: GroupPayload<'_>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let cx = &mut self.shared.lend_context(out);
        match payload.id.pgn {
            Pgn::DM1 | Pgn::DM2 => self.trouble_codes.on_frame(payload, frame, cx),
            Pgn::COMMANDED_ADDRESS => self.claims.on_command(payload, frame, cx),
            _ => {}
        }
    }

    /// Handles a frame without a slot: the table of identifiers is full.
    #[cold]
    fn on_frame_without_slot(&mut self, frame: &Frame, out: &mut dyn Observer) {
        self.shared.bus.protocols.omissions.without_slot += 1;
        match self.shared.bus.routes.route_origin(frame.id) {
            RouteOrigin::J1939(id) if !frame.flags.contains(FrameFlags::FD) => {
                self.on_j1939(None, id, frame, out);
            }
            _ => self.shared.lend_context(out).emit_undecoded(frame, None),
        }
    }

    /// CAN FD on CANopen and J1939 identifiers is not decoded (CiA 1301 and J1939-22 define it separately).
    #[cold]
    fn on_fd_frame(&mut self, frame: &Frame, service: IdentifierService, out: &mut dyn Observer) {
        let mut cx = self.shared.lend_context(out);
        let owner = match service {
            IdentifierService::Unclassified | IdentifierService::Named(_) => None,
            IdentifierService::J1939(_) => cx.bus.protocols.is_j1939().then_some("J1939"),
            _ => cx.bus.protocols.is_canopen().then_some("CANopen"),
        };
        cx.bus.protocols.omissions.fd += u64::from(owner.is_some());
        if let Some(owner) = owner.filter(|_| !std::mem::replace(&mut cx.notices.fd, true)) {
            cx.emit_note(frame, format!("CAN FD frames on {owner} identifiers are not decoded"));
        }
        cx.emit_undecoded(frame, None);
    }

    /// Creates the slot of an identifier at its first frame.
    #[cold]
    fn add_slot(&mut self, frame: &Frame, out: &mut dyn Observer) -> Option<usize> {
        let mut cx = self.shared.lend_context(out);
        let service = match cx.bus.routes.route_origin(frame.id) {
            RouteOrigin::Learnt(service) => service,
            RouteOrigin::Default(owner) => cx.bus.service_of(owner),
            RouteOrigin::J1939(id) => IdentifierService::J1939(id),
        };
        let slot = cx.bus.routes.add_slot(frame.id, service);
        if slot.is_none() && !std::mem::replace(&mut cx.notices.extended_full, true) {
            let kind = EventKind::Evicted { what: EvictedState::ExtendedIdentifier, count: 1 };
            cx.emit_can(frame, kind);
        }
        cx.emit_table_full(frame);
        slot
    }

    /// Advances the time to `stamp` without a frame, for a live bus without traffic.
    pub fn advance_time(&mut self, stamp: Timestamp, out: &mut dyn Observer) {
        if self.shared.bus.clock.has_timestamps() {
            let bus = &mut self.shared.bus;
            // A silence of the whole bus postpones all deadlines, and only the next frame shows whether it is one.
            let last = if bus.silence_limit().is_some() { bus.clock.last_frame_time() } else { i64::MAX };
            let now = bus.clock.advance_without_frame(stamp, last);
            if self.shared.timers.is_due(now) {
                self.expire_deadlines(now, out);
            }
        }
    }

    /// Continues after the clock of the timestamps was set forward by `step` ns, to `time`.
    pub(crate) fn set_clock(&mut self, time: Timestamp, step: i64, out: &mut dyn Observer) {
        self.shared.bus.clock.set_forward(step);
        let last = self.shared.bus.last_frame;
        let event = Event {
            time: Some(time),
            bus: self.shared.bus.index,
            frames: FrameRange::one(last),
            protocol: EventProtocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind: EventKind::ClockStep { step },
        };
        self.shared.lend_context(out).send_event(&event);
    }

    /// Sets the bit rate stated in the capture, in bit/s.
    pub(crate) fn set_recorded_bit_rate(&mut self, rate: u32) {
        self.shared.bus.recorded_bit_rate = Some(rate);
    }

    #[inline]
    fn advance_clock(&mut self, stamp: Timestamp, number: u64, out: &mut dyn Observer) {
        let clock = &mut self.shared.bus.clock;
        let now = if let Some(now) = clock.regular_time(stamp) {
            clock.advance_regularly(stamp, now);
            now
        } else {
            let advance = clock.advance_to(stamp);
            if advance.step.is_some() || advance.gap.is_some() {
                self.on_irregular_time(stamp, number, (advance.step, advance.gap), out);
            }
            advance.now
        };
        if self.shared.timers.is_due(now) {
            self.expire_deadlines(now, out);
        }
    }

    #[cold]
    fn on_irregular_time(
        &mut self,
        stamp: Timestamp,
        number: u64,
        (step, gap): (Option<i64>, Option<i64>),
        out: &mut dyn Observer,
    ) {
        let (bus, first) = (self.shared.bus.index, self.shared.bus.last_frame);
        let event = |kind| Event {
            time: Some(stamp),
            bus,
            frames: FrameRange { first, last: number },
            protocol: EventProtocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        };
        if let Some(step) = step {
            self.shared.lend_context(out).send_event(&event(EventKind::ClockStep { step }));
        }
        let Some(gap) = gap else { return };
        let now = self.shared.bus.clock.now();
        let received = now.saturating_sub(gap);
        if self.shared.bus.routes.shared_gap(received).is_none_or(|limit| gap <= limit) {
            let bus = &mut self.shared.bus;
            let frames = FrameRange { first, last: number };
            let limit = bus.clock.usual_gap();
            bus.ambiguous_gap = Some(AmbiguousGap { frames, times: (received, now), limit });
            bus.clock.accept_gap(gap);
        } else {
            // Deadlines before the silence apply; deadlines within it are postponed by its length.
            self.expire_deadlines(received, out);
            self.shared.lend_context(out).send_event(&event(EventKind::BusSilent { gap }));
            self.shared.bus.restarts.silent_until = Some(now);
            self.shared.bus.routes.postpone_frames(gap);
            self.on_silence(gap);
        }
    }

    /// Postpones every pending deadline by `delay`.
    fn on_silence(&mut self, delay: i64) {
        let bus = &mut self.shared.bus;
        self.sdo.on_silence(delay, bus);
        self.transports.on_silence(delay, bus);
        self.fast_packets.on_silence(delay, bus);
        self.messages.on_silence(delay, bus);
        self.isotp.on_silence(delay, bus);
        self.uds.on_silence(delay, bus);
        self.devices.on_silence(delay, bus);
        self.trouble_codes.on_silence(delay, bus);
        self.error_control.on_silence(delay, bus);
    }

    /// Handles every deadline before `now`.
    #[cold]
    fn expire_deadlines(&mut self, now: i64, out: &mut dyn Observer) {
        if self.shared.bus.clock.is_made_up() {
            let mut cx = self.shared.lend_context(out);
            if !std::mem::replace(&mut cx.notices.made_up_times, true) {
                let frame = cx.last_frame();
                let text =
                    "all timestamps have equal intervals, presumably synthetic: time limits are not checked";
                cx.emit_note(&frame, text.into());
            }
            return;
        }
        while let Some((_, subject)) = self.shared.timers.take_due(now) {
            self.on_deadline(subject, now, out);
        }
    }

    fn on_deadline(&mut self, subject: DeadlineSubject, now: i64, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend_context(out);
        match subject {
            DeadlineSubject::SdoChannel(channel) => {
                // No value: the transfer timed out.
                self.sdo.on_deadline(channel, now, cx);
            }
            DeadlineSubject::Heartbeat(node) => self.error_control.on_deadline(node, now, cx),
            DeadlineSubject::SetPoint(node) => self.devices.on_deadline(node, now, cx),
            DeadlineSubject::Dm1(node) => self.trouble_codes.on_deadline(node, now, cx),
            DeadlineSubject::FastPackets => self.fast_packets.on_deadline((), now, cx),
            DeadlineSubject::Message(slot) => self.messages.on_deadline(slot, now, cx),
            DeadlineSubject::IsoTp(link) => {
                // No request: the message timed out.
                self.isotp.on_deadline(link, now, cx);
            }
            DeadlineSubject::UdsRequest(link) => {
                let is_answering = self.isotp.is_answering(link);
                self.uds.on_deadline((link, is_answering), now, cx);
            }
            DeadlineSubject::Transport(place) => {
                if let Some(transfer) = self.transports.on_deadline(place, now, cx) {
                    self.on_payload(transfer.as_payload(), &transfer.frame, out);
                }
            }
        }
    }

    /// Closes open transfers at the end of the capture and reports the number of undecoded frames.
    pub fn finish_bus(&mut self, out: &mut dyn Observer) {
        self.release_withheld(None, out);
        let cx = &mut self.shared.lend_context(out);
        self.sdo.on_end(cx);
        self.transports.on_end(cx);
        self.fast_packets.on_end(cx);
        self.messages.on_end(cx);
        self.isotp.on_end(cx);
        self.uds.on_end(cx);
        let (count, extended) = cx.bus.protocols.undecoded;
        if count > 0 {
            let frame = cx.last_frame();
            let frames = count_noun(count, "frame");
            let text = format!(
                "{frames} of unknown service ({extended} with 29-bit identifier); decode --frames prints them"
            );
            cx.emit_note(&frame, text);
            for hint in cx.bus.hints.unnamed.pair_hints() {
                cx.emit_note(&frame, hint.to_string());
            }
        }
    }

    /// Context of a machine, for unit tests.
    #[cfg(test)]
    pub(in crate::session) fn lend_context<'a>(
        &'a mut self,
        out: &'a mut dyn Observer,
    ) -> super::context::MachineContext<'a> {
        self.shared.lend_context(out)
    }

    /// Bytes held by this decoder; object stores are shared with checkpoints until they change.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.shared.bus.footprint()
            + self.shared.timers.footprint()
            + self.sdo.memory_size()
            + self.claims.memory_size()
            + self.transports.memory_size()
            + self.fast_packets.memory_size()
            + self.isotp.memory_size()
            + self.pairs.memory_size()
            + self.uds.memory_size()
    }
}
