//! Path of a frame: time and deadlines first, then by its identifier to the machine of its service.

use std::sync::Arc;

use super::bus::{AmbiguousGap, Bus, RouteOrigin, Service};
use super::canopen::{ConformanceMarks, Emcy, ErrorControl, Lss, Nmt, Pdo, Sdo, Sync, TimeStamps};
use super::context::Shared;
use super::device::Devices;
use super::given::{apply_given, emit_given_states};
use super::j1939::{
    Claims, FastPackets, Messages, Payload, Requests, Transports, TroubleCodes, is_followed,
    mark_sender_alive,
};
use super::learning::learn_object;
use super::machine::{Machine, Timed};
use super::observer::Observer;
use super::options::SessionOptions;
use super::timers::Subject;
use super::uds::{IsoTp, ObdPairs, Uds};
use crate::event::{Event, EventKind, EvictedState, FrameRange, Protocol};
use crate::frame::{BusIndex, Frame, FrameFlags, Timestamp};
use crate::wire::error_frame;
use crate::wire::j1939::{ALL, J1939Id, NO_ADDRESS, Pgn};
use crate::words::plural;

/// Decodes the frames of one bus to events. A clone is a checkpoint.
#[derive(Debug, Clone)]
pub struct BusDecoder {
    pub(super) shared: Shared,
    nmt: Nmt,
    error_control: ErrorControl,
    emcy: Emcy,
    sync: Sync,
    time_stamps: TimeStamps,
    marks: ConformanceMarks,
    lss: Lss,
    sdo: Sdo,
    pdo: Pdo,
    requests: Requests,
    claims: Claims,
    messages: Messages,
    transports: Transports,
    fast_packets: FastPackets,
    trouble_codes: TroubleCodes,
    isotp: IsoTp,
    obd: ObdPairs,
    uds: Uds,
    devices: Devices,
    /// Consecutive frames that only the observer needed.
    pub(super) needed_in_a_row: u8,
}

impl BusDecoder {
    /// Decoder of a bus before its first frame, with the options for this bus applied.
    pub fn new(index: BusIndex, name: &str, options: Arc<SessionOptions>) -> Self {
        let mut shared = Shared::new(Bus::new(index, name, options));
        apply_given(&mut shared.lend(&mut |_: &Event, _: &Bus| {}));
        Self {
            shared,
            nmt: Nmt,
            error_control: ErrorControl,
            emcy: Emcy,
            sync: Sync::default(),
            time_stamps: TimeStamps::default(),
            marks: ConformanceMarks,
            lss: Lss::default(),
            sdo: Sdo::default(),
            pdo: Pdo,
            requests: Requests,
            claims: Claims::default(),
            messages: Messages,
            transports: Transports::default(),
            fast_packets: FastPackets::default(),
            trouble_codes: TroubleCodes,
            isotp: IsoTp::default(),
            obd: ObdPairs::default(),
            uds: Uds::default(),
            devices: Devices,
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
            let identifier = self.shared.bus.routes.find(frame.id);
            if !identifier.is_some_and(|identifier| self.take_quickly(identifier, frame, out)) {
                self.decode(identifier, frame, out);
            }
        }
    }

    /// Decodes a frame and sends its events to `out`; `identifier` is the index of its identifier, if it is known.
    #[inline(never)]
    fn decode(&mut self, identifier: Option<usize>, frame: &Frame, out: &mut dyn Observer) {
        if let Some(stamp) = frame.time {
            self.advance_clock(stamp, frame.number, out);
        }
        (self.shared.bus.last_frame, self.shared.bus.last_time) = (frame.number, frame.time);
        if self.shared.bus.has_given_states {
            emit_given_states(frame, &mut self.shared.lend(out));
        }
        if frame.flags.contains(FrameFlags::ERROR) {
            let kind = EventKind::CanError(error_frame::parse(frame.id.number(), frame.data()));
            return self.shared.lend(out).emit_can(frame, kind);
        }
        let slot = identifier.or_else(|| self.add_slot(frame, out));
        let Some(slot) = slot else { return self.on_frame_without_slot(frame, out) };
        let bus = &mut self.shared.bus;
        let Some(service) = bus.routes.hear(slot, bus.clock.now()) else { return };
        if frame.flags.contains(FrameFlags::FD) && !matches!(service, Service::IsoTp(_)) {
            return self.on_fd_frame(frame, service, out);
        }
        if frame.flags.contains(FrameFlags::REMOTE) && !service.has_remote_frames() {
            return self.shared.lend(out).emit_undecoded(frame, None);
        }
        let cx = &mut self.shared.lend(out);
        match service {
            Service::Pdo(name, node) => self.pdo.on_frame((slot, name, node), frame, cx),
            Service::J1939(id) => self.on_j1939(Some(slot), id, frame, out),
            Service::Sync => {
                if self.sync.on_frame((), frame, cx) {
                    self.devices.on_frame((), frame, cx);
                }
            }
            Service::ErrorControl(node) => self.error_control.on_frame(node, frame, cx),
            Service::Sdo(side, channel) => {
                if let Some(transfer) = self.sdo.on_frame((side, channel), frame, cx) {
                    learn_object(transfer, frame, cx);
                }
            }
            Service::Emcy(node) => self.emcy.on_frame(node, frame, cx),
            Service::Nmt => self.nmt.on_frame((), frame, cx),
            Service::Time => self.time_stamps.on_frame((), frame, cx),
            Service::Lss(from_master) => {
                if !cx.bus.canopen.is_confirmed() {
                    self.obd.note(frame);
                }
                self.lss.on_frame(from_master, frame, cx);
            }
            Service::IsoTp(link) => {
                if ObdPairs::is_functional(frame.id) {
                    self.obd.note(frame);
                }
                if let Some(message) = self.isotp.on_frame(link, frame, cx) {
                    self.uds.on_frame(message, frame, cx);
                }
            }
            Service::TestMarker => self.marks.on_frame((), frame, cx),
            Service::Unclassified | Service::Named(_) if ObdPairs::concerns(frame.id) => {
                self.on_obd_frame(service, frame, out);
            }
            Service::Unclassified => cx.emit_undecoded(frame, None),
            Service::Named(name) => cx.emit_undecoded(frame, Some(name)),
        }
    }

    /// Handles a frame on an identifier of OBD that is not decoded; the first response to a request is.
    #[cold]
    fn on_obd_frame(&mut self, service: Service, frame: &Frame, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend(out);
        let Some(pair) = self.obd.take(frame, cx) else {
            let name = if let Service::Named(name) = service { Some(name) } else { None };
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
    fn on_j1939(&mut self, slot: Option<usize>, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend(out);
        if !cx.bus.j1939.is_confirmed() && !is_followed(id, frame, cx) {
            return;
        }
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
                    self.on_payload(Payload { id, data: frame.data(), frames }, frame, out);
                }
            }
            Pgn::TP_CM | Pgn::TP_DT | Pgn::ETP_CM | Pgn::ETP_DT => {
                if let Some(transfer) = self.transports.on_frame(id, frame, cx) {
                    self.on_payload(transfer.payload(), &transfer.frame, out);
                }
            }
            pgn if cx.bus.sends_fast_packets(pgn) => self.fast_packets.on_frame(id, frame, cx),
            _ => self.messages.on_frame((slot, id), frame, cx),
        }
    }

    /// Handles a complete payload, from one frame or several, of a group about addresses or faults.
    pub(in crate::session) fn on_payload(
        &mut self,
        payload: Payload<'_>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let cx = &mut self.shared.lend(out);
        match payload.id.pgn {
            Pgn::DM1 | Pgn::DM2 => self.trouble_codes.on_frame(payload, frame, cx),
            Pgn::COMMANDED_ADDRESS => self.claims.on_command(payload, frame, cx),
            _ => {}
        }
    }

    /// Handles a frame without a slot: the table of identifiers is full.
    #[cold]
    fn on_frame_without_slot(&mut self, frame: &Frame, out: &mut dyn Observer) {
        self.shared.bus.omissions.without_slot += 1;
        match self.shared.bus.routes.origin(frame.id) {
            RouteOrigin::J1939(id) if !frame.flags.contains(FrameFlags::FD) => {
                self.on_j1939(None, id, frame, out);
            }
            _ => self.shared.lend(out).emit_undecoded(frame, None),
        }
    }

    /// CAN FD on CANopen and J1939 identifiers is not decoded (CiA 1301 and J1939-22 define it separately).
    #[cold]
    fn on_fd_frame(&mut self, frame: &Frame, service: Service, out: &mut dyn Observer) {
        let mut cx = self.shared.lend(out);
        let owner = match service {
            Service::Unclassified | Service::Named(_) => None,
            Service::J1939(_) => cx.bus.is_j1939().then_some("J1939"),
            _ => cx.bus.is_canopen().then_some("CANopen"),
        };
        cx.bus.omissions.fd += u64::from(owner.is_some());
        if let Some(owner) = owner.filter(|_| !std::mem::replace(&mut cx.notices.fd, true)) {
            cx.emit_note(frame, format!("CAN FD frames on {owner} identifiers are not decoded"));
        }
        cx.emit_undecoded(frame, None);
    }

    /// Creates the slot of an identifier at its first frame.
    #[cold]
    fn add_slot(&mut self, frame: &Frame, out: &mut dyn Observer) -> Option<usize> {
        let mut cx = self.shared.lend(out);
        let service = match cx.bus.routes.origin(frame.id) {
            RouteOrigin::Learnt(service) => service,
            RouteOrigin::Default(owner) => cx.bus.service_of(owner),
            RouteOrigin::J1939(id) => Service::J1939(id),
        };
        let slot = cx.bus.routes.add(frame.id, service);
        if slot.is_none() && !std::mem::replace(&mut cx.notices.extended_full, true) {
            let kind = EventKind::Evicted { what: EvictedState::ExtendedIdentifier, count: 1 };
            cx.emit_can(frame, kind);
        }
        cx.emit_table_full(frame);
        slot
    }

    /// Advances the time to `stamp` without a frame, for a live bus without traffic.
    pub fn advance(&mut self, stamp: Timestamp, out: &mut dyn Observer) {
        if self.shared.bus.clock.runs() {
            let bus = &mut self.shared.bus;
            // A silence of the whole bus postpones all deadlines, and only the next frame shows whether it is one.
            let last = if bus.silence_limit().is_some() { bus.clock.last_frame_time() } else { i64::MAX };
            let now = bus.clock.pass(stamp, last);
            if self.shared.timers.is_due(now) {
                self.expire(now, out);
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
            protocol: Protocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind: EventKind::ClockStep { step },
        };
        self.shared.lend(out).send(&event);
    }

    /// Sets the bit rate stated in the capture, in bit/s.
    pub(crate) fn set_recorded_bit_rate(&mut self, rate: u32) {
        self.shared.bus.recorded_bit_rate = Some(rate);
    }

    #[inline]
    fn advance_clock(&mut self, stamp: Timestamp, number: u64, out: &mut dyn Observer) {
        let advance = self.shared.bus.clock.advance(stamp);
        if advance.step.is_some() || advance.gap.is_some() {
            self.on_irregular_time(stamp, number, (advance.step, advance.gap), out);
        }
        if self.shared.timers.is_due(advance.now) {
            self.expire(advance.now, out);
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
            protocol: Protocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        };
        if let Some(step) = step {
            self.shared.lend(out).send(&event(EventKind::ClockStep { step }));
        }
        let Some(gap) = gap else { return };
        let now = self.shared.bus.clock.now();
        let heard = now.saturating_sub(gap);
        if self.shared.bus.shared_gap(heard).is_none_or(|limit| gap <= limit) {
            let bus = &mut self.shared.bus;
            let frames = FrameRange { first, last: number };
            let limit = bus.clock.usual_gap();
            bus.ambiguous_gap = Some(AmbiguousGap { frames, times: (heard, now), limit });
            bus.clock.accept(gap);
        } else {
            // Deadlines before the silence apply; deadlines within it are postponed by its length.
            self.expire(heard, out);
            self.shared.lend(out).send(&event(EventKind::BusSilent { gap }));
            self.shared.bus.restarts.silent_until = Some(now);
            self.shared.bus.routes.postpone(gap);
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
    fn expire(&mut self, now: i64, out: &mut dyn Observer) {
        if self.shared.bus.clock.is_made_up() {
            let mut cx = self.shared.lend(out);
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

    fn on_deadline(&mut self, subject: Subject, now: i64, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend(out);
        match subject {
            Subject::SdoChannel(channel) => {
                // No value: the transfer timed out.
                self.sdo.on_deadline(channel, now, cx);
            }
            Subject::Heartbeat(node) => self.error_control.on_deadline(node, now, cx),
            Subject::SetPoint(node) => self.devices.on_deadline(node, now, cx),
            Subject::Dm1(node) => self.trouble_codes.on_deadline(node, now, cx),
            Subject::FastPackets => self.fast_packets.on_deadline((), now, cx),
            Subject::Message(slot) => self.messages.on_deadline(slot, now, cx),
            Subject::IsoTp(link) => {
                // No request: the message timed out.
                self.isotp.on_deadline(link, now, cx);
            }
            Subject::UdsRequest(link) => {
                let is_answering = self.isotp.is_answering(link);
                self.uds.on_deadline((link, is_answering), now, cx);
            }
            Subject::Transport(place) => {
                if let Some(transfer) = self.transports.on_deadline(place, now, cx) {
                    self.on_payload(transfer.payload(), &transfer.frame, out);
                }
            }
        }
    }

    /// Closes open transfers at the end of the capture and reports the number of undecoded frames.
    pub fn finish(&mut self, out: &mut dyn Observer) {
        let cx = &mut self.shared.lend(out);
        self.sdo.on_end(cx);
        self.transports.on_end(cx);
        self.fast_packets.on_end(cx);
        self.messages.on_end(cx);
        self.isotp.on_end(cx);
        self.uds.on_end(cx);
        let (count, extended) = cx.bus.undecoded;
        if count > 0 {
            let frame = cx.last_frame();
            let frames = plural(count, "frame");
            let text = format!(
                "{frames} of unknown service ({extended} with 29-bit identifier); decode --frames prints them"
            );
            cx.emit_note(&frame, text);
            for hint in cx.bus.unnamed.hints() {
                cx.emit_note(&frame, hint.to_string());
            }
        }
    }

    /// Context of a machine, for unit tests.
    #[cfg(test)]
    pub(in crate::session) fn lend<'a>(
        &'a mut self,
        out: &'a mut dyn Observer,
    ) -> super::context::Context<'a> {
        self.shared.lend(out)
    }

    /// Bytes held by this decoder; object stores are shared with checkpoints until they change.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.shared.bus.footprint()
            + self.shared.timers.footprint()
            + self.sdo.footprint()
            + self.claims.footprint()
            + self.transports.footprint()
            + self.fast_packets.footprint()
            + self.isotp.footprint()
            + self.uds.footprint()
    }
}
