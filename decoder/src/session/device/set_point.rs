//! Set points: when they change, when they act, and whether they do.

use std::sync::Arc;

use super::behaviour::Moment;
use super::gates::Subject;
use super::plan::Plan;
use super::standing::StandingPoint;
use crate::event::{Effective, EventKind, FrameRange, Quantity, SetPoint};
use crate::frame::Frame;
use crate::profile::device::{PdoEffect, SYNC_AGE};
use crate::profile::{Carrier, Layout, Meaning, Role, Value};
use crate::session::node::Node;
use crate::session::timers::Subject as Timer;
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Transmission types up to this one wait for SYNC (CiA 301 §7.5.2.35).
const LAST_SYNCHRONOUS: u64 = 240;

/// One set point of a node.
#[derive(Debug, Clone)]
pub(in crate::session) struct SetPointState {
    carrier: Carrier,
    meaning: Arc<Meaning>,
    /// Value that was told last, and the quantity it was.
    told: Option<(Value, Quantity)>,
    effective: Option<Effective>,
    gates: Vec<String>,
    /// Value that waits for SYNC, and when it came.
    waiting: Option<(Value, Moment<()>)>,
    /// It was told before its SYNC, which did not come in time.
    late: bool,
    /// The layout of its PDO is a default, or may have changed unseen.
    assumed: bool,
}

impl SetPointState {
    pub(super) fn subject(&self) -> Subject<'_> {
        Subject { object: self.meaning.object, channel: self.meaning.channel, carrier: &self.carrier }
    }

    /// All traffic stopped for so long: the time does not count.
    pub(super) fn postpone(&mut self, delay: i64) {
        if let Some((_, came)) = &mut self.waiting {
            came.time = came.time.saturating_add(delay);
        }
    }

    pub(super) fn title(&self) -> &str {
        &self.meaning.name
    }

    /// As it was told last.
    pub(super) fn standing(&self) -> Option<StandingPoint<'_>> {
        let (_, quantity) = self.told.as_ref()?;
        Some(StandingPoint {
            meaning: &self.meaning,
            carrier: &self.carrier,
            quantity,
            is_assumed: self.assumed || self.meaning.assumed,
            effective: self.effective.unwrap_or(Effective::Unknown),
            gates: &self.gates,
        })
    }
}

impl Bus {
    /// Set points in an RPDO changed.
    pub(super) fn set_points_changed(
        &mut self,
        id: NodeId,
        carrier: &Carrier,
        layout: &Layout,
        plan: &Plan,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let moment = Moment { what: (), frame: frame.number, time: self.clock.now() };
        let Some(waits) = self.node(id).map(|node| node.waits_for_sync(carrier)) else { return };
        for watched in &plan.fields {
            let Some(field) = layout.fields.get(watched.place) else { continue };
            let Some(meaning) = field.meaning.as_ref().filter(|it| it.role == Some(Role::SetPoint)) else {
                continue;
            };
            let Some(raw) = field.extract(frame.data()) else { continue };
            let value = field.data_type.number(raw);
            let Some(place) = self.set_point(id, carrier, meaning) else { continue };
            let Some(point) = self.set_point_mut(id, place) else { continue };
            point.assumed = layout.assumed;
            if point.is_told(&value) {
                point.waiting = None;
            } else if waits {
                point.waiting = Some((value, moment));
            } else {
                self.tell_set_point(id, place, value, moment, frame, out);
            }
        }
        if waits {
            self.await_sync(id, moment.time.saturating_add(SYNC_AGE));
        }
    }

    /// Queues a deadline unless one is queued: when it comes due it is asked again what waits.
    fn await_sync(&mut self, id: NodeId, deadline: i64) {
        let Some(node) = self.node_mut(id) else { return };
        if !std::mem::replace(&mut node.behaviour.sync_queued, true) {
            self.timers.add(deadline, Timer::SetPoint(id));
        }
    }

    fn set_point_mut(&mut self, id: NodeId, place: usize) -> Option<&mut SetPointState> {
        self.node_mut(id)?.behaviour.set_points.get_mut(place)
    }

    /// Place of a set point; its meaning is the present one.
    fn set_point(&mut self, id: NodeId, carrier: &Carrier, meaning: &Arc<Meaning>) -> Option<usize> {
        let points = &mut self.node_mut(id)?.behaviour.set_points;
        let known =
            points.iter().position(|it| it.meaning.object == meaning.object && it.carrier == *carrier);
        if let Some(place) = known {
            points.get_mut(place)?.meaning = Arc::clone(meaning);
            return Some(place);
        }
        points.push(SetPointState {
            carrier: carrier.clone(),
            meaning: Arc::clone(meaning),
            told: None,
            effective: None,
            gates: Vec::new(),
            waiting: None,
            late: false,
            assumed: false,
        });
        Some(points.len() - 1)
    }

    /// A SYNC came: what waited for it acts.
    pub(in crate::session) fn device_saw_sync(&mut self, frame: &Frame, out: &mut dyn Observer) {
        let moment = Moment { what: (), frame: frame.number, time: self.clock.now() };
        for place in 0..self.nodes.len() {
            let Some(node) = self.nodes.get_mut(place) else { return };
            if node.assigned.is_none() || node.sync != frame.id {
                continue;
            }
            node.behaviour.sync = Some(moment);
            let id = node.id;
            for place in 0..node.behaviour.set_points.len() {
                let waiting = self.set_point_mut(id, place).and_then(|point| point.waiting.take());
                if let Some((value, came)) = waiting {
                    self.tell_set_point(id, place, value, came, frame, out);
                }
            }
            let Some(node) = self.node_mut(id) else { return };
            let late = node.behaviour.set_points.iter_mut().map(|point| std::mem::take(&mut point.late));
            if late.fold(false, |any, late| any | late) {
                self.reassess(id, frame, out);
            }
        }
    }

    /// A deadline of set points that wait for SYNC: those that waited long enough do not act.
    pub(in crate::session) fn sync_deadline(&mut self, id: NodeId, now: i64, out: &mut dyn Observer) {
        let Some(node) = self.node_mut(id) else { return };
        node.behaviour.sync_queued = false;
        for place in 0..node.behaviour.set_points.len() {
            let Some(point) = self.set_point_mut(id, place) else { return };
            let Some(came) = point.waiting.as_ref().map(|(_, came)| *came) else { continue };
            let deadline = came.time.saturating_add(SYNC_AGE);
            if deadline >= now {
                self.await_sync(id, deadline);
                continue;
            }
            if let Some((value, came)) = point.waiting.take() {
                point.late = true;
                // The deadline's own time, and the frame that waits as the evidence.
                let time = self.clock.stamp_of(deadline);
                let frame = Frame { number: came.frame, time, ..Frame::EMPTY };
                self.tell_set_point(id, place, value, came, &frame, out);
            }
        }
    }

    /// Tells a new value: it acts, or does not, from `frame` on.
    fn tell_set_point(
        &mut self,
        id: NodeId,
        place: usize,
        value: Value,
        came: Moment<()>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let now = self.clock.now();
        let runs = self.clock.runs();
        let Some(node) = self.node(id) else { return };
        let Some(point) = node.behaviour.set_points.get(place) else { return };
        let verdict = node.verdict(point.subject(), now);
        let waited = came.frame != frame.number
            && runs
            && node.behaviour.sync.is_some_and(|it| it.frame == frame.number);
        let mut told = point.event(&value, verdict.effective, &verdict.gates);
        told.sync_after = waited.then(|| now.saturating_sub(came.time));
        let quantity = told.to.clone();
        let mut event = self.event_of(frame, Some(id), EventKind::SetPoint(Box::new(told)));
        event.frames = FrameRange { first: came.frame, last: frame.number };
        if let Some(point) = self.set_point_mut(id, place) {
            point.told = Some((value, quantity));
            point.effective = Some(verdict.effective);
            point.gates = verdict.gates;
        }
        out.event(&event, self);
    }

    /// Something changed that gates look at: tells set points that began or ceased to act.
    pub(in crate::session) fn reassess(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        let now = self.clock.now();
        let Some(node) = self.node(id) else { return };
        let mut changes = Vec::new();
        for (place, point) in node.behaviour.set_points.iter().enumerate() {
            let Some((value, _)) = &point.told else { continue };
            let verdict = node.verdict(point.subject(), now);
            if point.effective != Some(verdict.effective) {
                changes.push((place, point.event(value, verdict.effective, &verdict.gates), verdict));
            }
        }
        for (place, event, verdict) in changes {
            if let Some(point) = self.set_point_mut(id, place) {
                point.effective = Some(verdict.effective);
                point.gates = verdict.gates;
            }
            self.emit(frame, id, false, EventKind::SetPoint(Box::new(event)), out);
        }
    }
}

impl SetPointState {
    /// Whether a value says nothing new: the same number may be another quantity under another mode.
    fn is_told(&self, value: &Value) -> bool {
        self.told.as_ref().is_some_and(|(told, quantity)| {
            told == value && (quantity.number == self.quantity(value).number || !self.by_message())
        })
    }

    /// A message may decide itself how its set points are read.
    const fn by_message(&self) -> bool {
        matches!(self.carrier, Carrier::Message(_))
    }

    fn quantity(&self, value: &Value) -> Quantity {
        Quantity {
            number: self.meaning.scaled(value).or_else(|| plain(&self.meaning, value)),
            text: self.meaning.signed(value),
        }
    }

    fn event(&self, value: &Value, effective: Effective, gates: &[String]) -> SetPoint {
        SetPoint {
            object: self.meaning.object,
            signal: self.meaning.name.clone(),
            short: self.meaning.short.clone(),
            channel: self.meaning.channel,
            carrier: self.carrier.clone(),
            from: self.told.as_ref().map(|(_, quantity)| quantity.clone()),
            to: self.quantity(value),
            unit: self.meaning.unit.clone(),
            assumed: self.assumed || self.meaning.assumed,
            effective,
            gates: gates.to_vec(),
            sync_after: None,
        }
    }
}

/// A number without scale is its own quantity, unless it has a name.
fn plain(meaning: &Meaning, value: &Value) -> Option<f64> {
    if meaning.scale.is_some() || meaning.label(value).is_some() {
        return None;
    }
    #[expect(clippy::cast_precision_loss, reason = "values are for reading; data is the truth")]
    crate::profile::integer(value).map(|number| number as f64)
}

impl Node {
    /// Whether an RPDO acts at the next SYNC: as the device says, else by its transmission type.
    fn waits_for_sync(&self, carrier: &Carrier) -> bool {
        let Carrier::Pdo(name) = *carrier else { return false };
        let spec = self.device.pdos.iter().find(|spec| spec.pdo == name);
        match spec.map(|spec| spec.effect).unwrap_or_default() {
            PdoEffect::AtSync => true,
            PdoEffect::AtOnce => false,
            PdoEffect::ByType => {
                let kind = self.store.number(ObjectAddress::new(name.communication_index(), 2));
                kind.is_some_and(|kind| kind <= LAST_SYNCHRONOUS)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frame::{BusIndex, CanId, Timestamp};
    use crate::profile::Catalogue;
    use crate::session::{AssignedBy, Assignment, SessionOptions};

    const PROFILE: &str = r#"
        id = "acme-pump"
        extends = ["cia301"]
        [[object]]
        index = 0x2000
        name = "set point"
        type = "INTEGER16"
        role = "set-point"
        [[pdo]]
        pdo = "RPDO1"
        mapping = "fixed"
        effect = "at-sync"
        fields = [{ object = "2000:00", bits = 16 }]
        [[gate]]
        name = "SYNC"
        open = { sync = true }
    "#;

    /// Set points told of frames: milliseconds, identifier, data.
    fn told(frames: &[(i64, u16, &[u8])]) -> Vec<(Option<i64>, String, &'static str, FrameRange)> {
        let mut catalogue = Catalogue::default();
        catalogue.add_text("pump.toml", PROFILE).unwrap();
        let device = catalogue.device("acme-pump").unwrap();
        let assignment = Assignment { bus: None, node: NodeId::Canopen(2), device, by: AssignedBy::Option };
        let options = SessionOptions { assignments: vec![assignment], ..SessionOptions::default() };
        let mut bus = Bus::new(BusIndex(0), "can0", Arc::new(options));
        let mut told = Vec::new();
        for (number, (time, id, data)) in (1..).zip(frames) {
            let mut frame = Frame::data_frame(CanId::standard(*id), data);
            frame.number = number;
            frame.time = Some(Timestamp(time * 1_000_000));
            bus.push(&frame, &mut |event: &Event, _: &Bus| {
                if let EventKind::SetPoint(point) = &event.kind {
                    let time = event.time.map(|time| time.0 / 1_000_000);
                    told.push((time, point.to.text.clone(), point.effective.name(), event.frames));
                }
            });
        }
        told
    }

    #[test]
    fn a_set_point_acts_at_sync_or_is_told_not_to_a_second_after_it_came() {
        let heartbeat: (u16, &[u8]) = (0x705, &[5]);
        let mut frames: Vec<(i64, u16, &[u8])> = vec![
            (0, 0x702, &[0]),
            (10, 0x202, &[1, 0]),
            (20, 0x080, &[]),
            (500, 0x202, &[2, 0]),
            (900, 0x202, &[3, 0]),
        ];
        // The bus goes on, without SYNC.
        frames.extend((1..40).map(|step| (900 + step * 100, heartbeat.0, heartbeat.1)));
        frames.push((5000, 0x080, &[]));
        let told = told(&frames);
        assert_eq!(told[0], (Some(20), "1".into(), "yes", FrameRange { first: 2, last: 3 }));
        // 900 + 1000 ms: the value replaced before a SYNC never acted and is not told.
        assert_eq!(told[1], (Some(1900), "3".into(), "no", FrameRange::one(5)));
        // The SYNC comes after all.
        assert_eq!(told[2], (Some(5000), "3".into(), "yes", FrameRange::one(45)));
        assert_eq!(told.len(), 3);
    }
}
