//! Judges what happened by one rule: to each kind of statement its file.

use super::attached::Course;
use super::conditions::{Proof, Scene};
use super::happening::Happening;
use super::{counts, order, times, values};
use crate::event::{Event, FrameRange};
use crate::profile::device::{DeviceRule, RuleKind, Trigger};
use crate::rules::Context;
use crate::rules::context::Alarm;
use crate::wire::canopen::ObjectAddress;

/// One rule at one node, and the event that is judged.
#[derive(Clone, Copy)]
pub(super) struct Case<'a> {
    pub(super) scene: Scene<'a>,
    pub(super) rule: &'a DeviceRule,
    /// Its place among the rules of the device.
    pub(super) number: usize,
    /// The event that is judged; none where time has passed.
    pub(super) event: Option<&'a Event>,
    pub(super) frames: FrameRange,
}

impl Case<'_> {
    /// Whether it is judged now: `while` is proven.
    pub(super) fn is_due(&self) -> bool {
        self.during() == Proof::Holds
    }

    pub(super) fn during(&self) -> Proof {
        self.scene.all(&self.rule.during.0, self.rule.channel)
    }

    /// What of `on` it is, if any.
    pub(super) fn on(&self, happening: &Happening<'_>) -> Option<&Trigger> {
        self.rule.on.0.iter().find(|trigger| happening.starts(trigger))
    }

    /// The time the rule gives, in nanoseconds; `None` where it is not known, or 0.
    pub(super) fn limit(&self) -> Option<i64> {
        let milliseconds = match self.rule.ms_of {
            None => self.rule.ms?,
            Some(of) => self.scaled(of.object)? * self.rule.times,
        };
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let nanoseconds = (milliseconds * 1e6) as i64;
        (nanoseconds > 0).then_some(nanoseconds)
    }

    /// The value of an object in its unit, where it is sure.
    pub(super) fn scaled(&self, object: ObjectAddress) -> Option<f64> {
        let raw = self.scene.value(object)?;
        let meaning = self.scene.node.meaning(object);
        if meaning.as_ref().is_some_and(|meaning| meaning.assumed) {
            return None;
        }
        let scaled = meaning.and_then(|meaning| meaning.scaled(&meaning.number(raw)));
        #[expect(clippy::cast_precision_loss, reason = "numbers of few digits")]
        let plain = raw as f64;
        Some(scaled.unwrap_or(plain))
    }

    /// The event shows something wrong at this node.
    pub(super) fn fail<'b, 'c>(
        &self,
        happening: &Happening<'_>,
        context: &'b mut Context<'c>,
    ) -> Alarm<'b, 'c> {
        let node = Some(self.scene.id);
        let alarm = match self.event {
            Some(event) => context.fail(event).node(node),
            None => context.fail_at(context.now, node, self.frames),
        };
        alarm.about(happening.about())
    }

    /// What a deadline of the rule is known by.
    pub(super) fn token(&self) -> u64 {
        (self.scene.id.place() as u64) << 16 | self.number as u64
    }
}

/// Something happened at a node.
pub(super) fn happened(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    if let (Happening::State(Some(channel), _), Some(own)) = (happening, case.rule.channel)
        && *channel != own
    {
        return;
    }
    match case.rule.kind {
        RuleKind::Limit => values::limit(case, happening, context),
        RuleKind::Forbidden | RuleKind::Permitted => values::chosen(case, happening, context),
        RuleKind::Ascending => values::ascending(case, course, happening, context),
        RuleKind::Never => order::never(case, happening, context),
        RuleKind::Precondition => order::precondition(case, happening, context),
        RuleKind::Order => order::order(case, course, happening, context),
        RuleKind::MinInterval => times::min_interval(case, course, happening, context),
        RuleKind::MaxInterval => times::max_interval(case, course, happening, context),
        RuleKind::Follow => times::follow(case, course, happening, context),
        RuleKind::MaxCount => counts::max_count(case, course, happening, context),
        RuleKind::ReservedId | RuleKind::Expedited | RuleKind::RemoteLength => {}
    }
}

/// Something happened that may begin or end a stretch in which the rule is judged.
pub(super) fn look_again(case: &Case<'_>, course: &mut Course, context: &mut Context<'_>) {
    let proof = case.during();
    let held = std::mem::replace(&mut course.holds, proof == Proof::Holds);
    match case.rule.kind {
        RuleKind::MaxInterval => times::stretch(case, course, held, context),
        RuleKind::Follow if !course.holds => (course.last, course.deadline) = (None, None),
        // What never happens is judged in each stretch.
        RuleKind::Never if course.holds && !held => context.pass(),
        RuleKind::MaxCount if held && !course.holds => counts::stretch_ended(case, course, context),
        _ => {}
    }
}

/// A time has come that the rule asked for.
pub(super) fn due(case: &Case<'_>, course: &mut Course, context: &mut Context<'_>) {
    let Some(deadline) = course.deadline.filter(|deadline| *deadline <= context.now) else { return };
    course.deadline = None;
    match case.rule.kind {
        RuleKind::Follow => times::missing(case, course, deadline, context),
        RuleKind::Ascending => values::settled(case, context),
        _ => {}
    }
}
