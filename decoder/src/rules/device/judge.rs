//! Judges what happened by one rule: to each kind of statement its file.

use super::attached::Course;
use super::conditions::Scene;
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
        self.scene.holds_while(self.rule, self.number)
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

    /// Looks at it again at a deadline.
    pub(super) fn wait(&self, course: &mut Course, deadline: i64, context: &mut Context<'_>) {
        course.deadline = Some(deadline);
        if course.wake.is_none_or(|wake| deadline < wake) {
            course.wake = Some(deadline);
            let token = (self.scene.id.place() as u64) << 16 | self.number as u64;
            context.wake_at(deadline, token);
        }
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
    let held = std::mem::replace(&mut course.holds, case.is_due());
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
    course.wake.take_if(|wake| *wake <= context.now);
    let Some(deadline) = course.deadline else { return };
    if deadline > context.now {
        return case.wait(course, deadline, context);
    }
    course.deadline = None;
    match case.rule.kind {
        RuleKind::Follow => times::missing(case, course, deadline, context),
        RuleKind::Ascending => values::settled(case, context),
        _ => {}
    }
}
