//! Time on a bus: what a stamp brings, and what comes due.

use super::timers::Subject;
use super::{Bus, Observer};
use crate::event::{Event, EventKind, FrameRange, Protocol};
use crate::frame::{Frame, Timestamp};

impl Bus {
    #[inline]
    pub(super) fn tick(&mut self, stamp: Timestamp, number: u64, out: &mut dyn Observer) {
        let advance = self.clock.advance(stamp);
        if advance.step.is_some() || advance.silence.is_some() {
            self.irregular(stamp, number, advance.step, advance.silence, out);
        }
        if self.timers.is_due(advance.now) {
            self.expire(advance.now, out);
        }
    }

    /// Takes a time at which no frame came.
    pub(super) fn pass(&mut self, stamp: Timestamp, out: &mut dyn Observer) {
        let now = self.clock.pass(stamp);
        if self.timers.is_due(now) {
            self.expire(now, out);
        }
    }

    #[cold]
    fn irregular(
        &mut self,
        stamp: Timestamp,
        number: u64,
        step: Option<i64>,
        silence: Option<(i64, i64)>,
        out: &mut dyn Observer,
    ) {
        let event = |kind| Event {
            time: Some(stamp),
            bus: self.index,
            frames: FrameRange { first: self.last_frame, last: number },
            protocol: Protocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        };
        if let Some(step) = step {
            out.event(&event(EventKind::ClockStep { step }), self);
        }
        if let Some((gap, limit)) = silence {
            // Deadlines before the bus fell silent stand; those within the silence are put off by it.
            let event = event(EventKind::BusSilent { gap });
            let fell_silent = self.clock.now().saturating_sub(gap).saturating_add(limit);
            self.expire(fell_silent, out);
            out.event(&event, self);
            self.silent_until = Some(self.clock.now());
            self.postpone(gap);
        }
    }

    /// Moves every deadline that is not over yet by `delay`.
    fn postpone(&mut self, delay: i64) {
        self.channels.postpone(delay);
        self.transports.postpone(delay);
        for cadence in self.routes.cadences_mut() {
            cadence.postpone(delay);
        }
        self.uds.postpone(delay);
        for node in &mut self.nodes {
            node.behaviour.postpone(delay);
            if let Some(state) = &mut node.j1939 {
                state.faults.postpone(delay);
            }
            if let Some(deadline) = &mut node.heartbeat.deadline {
                *deadline = deadline.saturating_add(delay);
            }
        }
    }

    /// Handles every deadline before `now`.
    #[cold]
    fn expire(&mut self, now: i64, out: &mut dyn Observer) {
        if self.clock.is_made_up() {
            if !std::mem::replace(&mut self.said.made_up, true) {
                let frame = Frame { number: self.last_frame, time: self.last_time, ..Frame::EMPTY };
                let text = "all stamps lie equally far apart, as if made up: no time limit is judged by them";
                self.note(&frame, text.into(), out);
            }
            return;
        }
        while let Some((_, subject)) = self.timers.take_due(now) {
            match subject {
                Subject::SdoChannel(channel) => self.sdo_deadline(channel, now, out),
                Subject::Heartbeat(node) => self.heartbeat_deadline(node, now, out),
                Subject::SetPoint(node) => self.sync_deadline(node, now, out),
                Subject::Dm1(node) => self.dm1_deadline(node, now, out),
                Subject::Message(slot) => self.message_deadline(slot, now, out),
                Subject::IsoTp(link) => self.isotp_deadline(link, now, out),
                Subject::UdsRequest(link) => self.uds_deadline(link, now, out),
                Subject::Transport(place) => self.transport_deadline(place, now, out),
            }
        }
    }
}
