//! How many of something may come.

use super::attached::{Course, Moment};
use super::happening::Happening;
use super::judge::Case;
use super::times::waits_for_pdo;
use crate::event::FrameRange;
use crate::finding::About;
use crate::profile::device::{Per, Stretch, Trigger};
use crate::rules::Context;

/// Longest row of times remembered; a rule that counts more is judged by the last ones.
const ROW_LIMIT: usize = 1024;

/// SYNCs further apart have stopped, in nanoseconds.
const ALIVE: i64 = 1_000_000_000;

/// At most `count` of `on` come.
pub(super) fn max_count(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    match case.rule.per {
        Some(Per::Stretch(Stretch::Sync)) => per_sync(case, course, happening, context),
        Some(Per::Stretch(Stretch::While)) => per_while(case, course, happening, context),
        Some(Per::Seconds(seconds)) => per_seconds(case, course, happening, seconds, context),
        None => {}
    }
}

fn most(case: &Case<'_>) -> u32 {
    case.rule.count.unwrap_or(u32::MAX)
}

fn per_sync(case: &Case<'_>, course: &mut Course, happening: &Happening<'_>, context: &mut Context<'_>) {
    let is_heard = || !waits_for_pdo(&case.rule.on.0) || case.scene.is_operational();
    if course.is_counting && case.on(happening).is_some() && is_heard() && case.is_due() {
        course.count = course.count.saturating_add(1);
        let frame = case.frames.last;
        if course.count == 1 {
            course.first = frame;
        }
        course.last = Some(Moment { time: context.now, frame });
    }
    if !matches!(happening, Happening::Sync) {
        return;
    }
    let count = std::mem::take(&mut course.count);
    let before = course.since.replace(context.now);
    // SYNCs far apart have stopped: that is another matter.
    let is_alive = before.is_some_and(|before| context.now.saturating_sub(before) <= ALIVE);
    let was_counting = std::mem::replace(&mut course.is_counting, true) && is_alive;
    let most = most(case);
    if count == 0 || !was_counting {
        return;
    }
    if count <= most {
        return context.pass();
    }
    let last = course.last.map_or(course.first, |last| last.frame);
    let (text, on) = (&case.rule.text, case.rule.on.0.first());
    let alarm = case.fail(happening, context).about(on.map_or(About::Whole, about));
    let frames = FrameRange { first: course.first, last };
    let alarm = alarm.frames(frames).measure(f64::from(count));
    alarm.say(|| format!("{count} between two SYNC, at most {most}: {text}"));
}

fn per_while(case: &Case<'_>, course: &mut Course, happening: &Happening<'_>, context: &mut Context<'_>) {
    if case.on(happening).is_none() || !case.is_due() {
        return;
    }
    if !std::mem::replace(&mut course.holds, true) {
        course.count = 0;
    }
    course.count = course.count.saturating_add(1);
    let (count, most, text) = (course.count, most(case), &case.rule.text);
    if count > most {
        let alarm = case.fail(happening, context).measure(f64::from(count));
        alarm.say(|| format!("{count} × {}, at most {most}: {text}", happening.words()));
    }
}

/// A stretch ended in which there were few enough.
pub(super) fn stretch_ended(case: &Case<'_>, course: &mut Course, context: &mut Context<'_>) {
    let count = std::mem::take(&mut course.count);
    if (1..=most(case)).contains(&count) {
        context.pass();
    }
}

fn per_seconds(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    seconds: f64,
    context: &mut Context<'_>,
) {
    let Some(trigger) = case.on(happening) else { return };
    if !context.has_time || !case.is_due() {
        return;
    }
    let most = usize::try_from(most(case)).unwrap_or(ROW_LIMIT).min(ROW_LIMIT);
    let moment = Moment { time: context.now, frame: case.frames.last };
    let Some(recent) = course.recent(happening.counted(trigger)) else { return };
    recent.push_back(moment);
    if recent.len() > most + 1 {
        recent.pop_front();
    }
    let oldest = recent.front().copied().unwrap_or(moment);
    let span = moment.time.saturating_sub(oldest.time).saturating_add(context.granularity);
    #[expect(clippy::cast_precision_loss, reason = "a span of seconds")]
    let is_within = span as f64 / 1e9 <= seconds;
    if recent.len() <= most || !is_within {
        return context.pass();
    }
    let (count, text) = (recent.len(), &case.rule.text);
    let frames = FrameRange { first: oldest.frame, last: moment.frame };
    let alarm = case.fail(happening, context).frames(frames);
    alarm.say(|| format!("{count} × within {seconds} s, at most {most}: {text}"));
}

/// What a finding is about that no happening shows by itself.
pub(super) fn about(trigger: &Trigger) -> About {
    match trigger {
        Trigger::Pdo(name) => About::Name(name.to_string().into()),
        Trigger::Write(of, _) | Trigger::Read(of, _) => About::Object(of.object),
        Trigger::Bit(bit, _) => About::Object(bit.object.object),
        Trigger::Set(set) => About::Object(set.object.object),
        Trigger::Message(message) => About::Name(message.name.as_str().into()),
        _ => About::Whole,
    }
}
