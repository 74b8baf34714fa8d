//! Times between what happens: the least, the most, and that of an answer.

use super::attached::{Course, Moment};
use super::counts::about;
use super::happening::Happening;
use super::judge::Case;
use crate::event::FrameRange;
use crate::finding::About;
use crate::profile::device::Trigger;
use crate::rules::Context;

/// Whether the absence of what these wait for tells of a PDO.
pub(super) fn waits_for_pdo(triggers: &[Trigger]) -> bool {
    triggers.iter().any(|trigger| matches!(trigger, Trigger::Pdo(_)))
}

fn milliseconds(nanoseconds: i64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "shown with a digit or two")]
    let milliseconds = nanoseconds as f64 / 1e6;
    milliseconds
}

/// A time for people: whole milliseconds from ten on.
fn shown(nanoseconds: i64) -> String {
    let milliseconds = milliseconds(nanoseconds);
    let digits = if milliseconds < 10.0 && nanoseconds % 1_000_000 != 0 { 2 } else { 0 };
    format!("{milliseconds:.digits$} ms")
}

/// `on` comes not too soon after the one before, or after something else.
pub(super) fn min_interval(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    let after = &case.rule.after.0;
    let moment = Moment { time: context.now, frame: case.frames.last };
    if let Some(trigger) = case.on(happening) {
        let before = if after.is_empty() {
            let Some(recent) = course.recent(happening.counted(trigger)) else { return };
            recent.push_back(moment);
            if recent.len() > 1 { recent.pop_front() } else { None }
        } else {
            course.last
        };
        if let (Some(before), true) = (before, context.has_time && case.is_due()) {
            too_soon(case, before, happening, context);
        }
    }
    if after.iter().any(|trigger| happening.fulfils(trigger)) {
        course.last = Some(moment);
    }
}

fn too_soon(case: &Case<'_>, before: Moment, happening: &Happening<'_>, context: &mut Context<'_>) {
    let Some(limit) = case.limit() else { return };
    let interval = context.now.saturating_sub(before.time);
    if interval.saturating_add(context.granularity) >= limit {
        return context.pass();
    }
    let frames = FrameRange { first: before.frame, last: case.frames.last };
    let alarm = case.fail(happening, context).frames(frames).measure(-milliseconds(interval));
    let (text, frame) = (&case.rule.text, before.frame);
    alarm.say(|| format!("{} after {{{frame}}}, at least {}: {text}", shown(interval), shown(limit)));
}

/// `on` comes not too late after the one before.
pub(super) fn max_interval(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    if case.on(happening).is_none() {
        return;
    }
    course.is_counting = true;
    if !context.has_time || !case.is_due() || !may_be_missed(case, course, &case.rule.on.0) {
        course.last = None;
        return;
    }
    let moment = Moment { time: context.now, frame: case.frames.last };
    let (Some(last), Some(limit)) = (course.last.replace(moment), case.limit()) else { return };
    let interval = context.now.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return context.pass();
    }
    let frames = FrameRange { first: last.frame, last: moment.frame };
    let alarm = case.fail(happening, context).frames(frames).measure(milliseconds(interval));
    let text = &case.rule.text;
    alarm.say(|| format!("{} after {{{}}}, at most {}: {text}", shown(interval), last.frame, shown(limit)));
}

/// Whether the absence of what these wait for would tell something.
fn may_be_missed(case: &Case<'_>, course: &Course, triggers: &[Trigger]) -> bool {
    let scene = &case.scene;
    let is_sure = |trigger: &Trigger| match trigger {
        Trigger::Pdo(name) => {
            let id = scene.bus.pdo_identifier(scene.id, *name);
            scene.is_operational() && id.is_some_and(|(_, is_told)| is_told || course.is_counting)
        }
        _ => true,
    };
    triggers.iter().all(is_sure)
}

/// `while` begins or ends, or the node ceases to take part: so does the wait.
pub(super) fn stretch(case: &Case<'_>, course: &mut Course, held: bool, context: &mut Context<'_>) {
    let is_open = course.holds && (!waits_for_pdo(&case.rule.on.0) || case.scene.is_operational());
    if is_open {
        let begins = !held && !case.rule.during.0.is_empty() && course.last.is_none();
        if begins && may_be_missed(case, course, &case.rule.on.0) {
            course.last = Some(Moment { time: context.now, frame: case.frames.last });
        }
        return;
    }
    let Some(last) = course.last.take() else { return };
    // A gap is one for as long as the node showed itself that nothing else had changed.
    if held && course.is_counting {
        overdue(case, last, context);
    }
}

/// The capture ends: what is still missing, for as long as the node was there.
pub(super) fn still_missing(case: &Case<'_>, course: &mut Course, context: &mut Context<'_>) {
    let Some(last) = course.last.take() else { return };
    if case.is_due() && may_be_missed(case, course, &case.rule.on.0) {
        overdue(case, last, context);
    }
}

fn overdue(case: &Case<'_>, last: Moment, context: &mut Context<'_>) {
    let (Some(heard), Some(limit)) = (case.scene.own.heard, case.limit()) else { return };
    let interval = heard.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return;
    }
    let frames = FrameRange { first: last.frame, last: case.frames.last.max(last.frame) };
    let on = case.rule.on.0.first();
    let alarm = context.fail_at(heard, Some(case.scene.id), frames).about(on.map_or(About::Whole, about));
    let text = &case.rule.text;
    let alarm = alarm.measure(milliseconds(interval));
    alarm.say(|| {
        format!("missing for {} since {{{}}}, at most {}: {text}", shown(interval), last.frame, shown(limit))
    });
}

/// `then` comes in time after `on`.
pub(super) fn follow(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    if case.rule.then.0.iter().any(|trigger| happening.fulfils(trigger)) {
        course.is_counting = true;
        course.deadline = None;
        if course.last.take().is_some() {
            context.pass();
        }
    } else if matches!(happening, Happening::Boot) {
        (course.last, course.deadline) = (None, None);
    }
    if case.on(happening).is_none() || !context.has_time || !case.is_due() {
        return;
    }
    let Some(limit) = case.limit() else { return };
    let deadline = context.now.saturating_add(limit).saturating_add(context.granularity);
    course.holds = true;
    course.last = Some(Moment { time: context.now, frame: case.frames.last });
    case.wait(course, deadline, context);
}

/// The time of an answer has passed.
pub(super) fn missing(case: &Case<'_>, course: &mut Course, deadline: i64, context: &mut Context<'_>) {
    let Some(on) = course.last.take() else { return };
    if !case.is_due() || !may_be_missed(case, course, &case.rule.then.0) {
        return;
    }
    let Some(limit) = case.limit() else { return };
    let trigger = case.rule.on.0.first();
    let frames = FrameRange { first: on.frame, last: case.frames.last.max(on.frame) };
    let alarm = context.fail_at(deadline, Some(case.scene.id), frames);
    let text = &case.rule.text;
    alarm
        .about(trigger.map_or(About::Whole, about))
        .say(|| format!("not within {} of {{{}}}: {text}", shown(limit), on.frame));
}
