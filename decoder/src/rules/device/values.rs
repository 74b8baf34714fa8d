//! Values the manual permits, and those that must rise from one object to the next.

use super::attached::Course;
use super::happening::{Came, Happening, Way};
use super::judge::Case;
use crate::event::FrameRange;
use crate::finding::About;
use crate::profile::device::RuleKind;
use crate::rules::Context;
use crate::wire::canopen::ObjectAddress;

/// Who writes several objects in a row is done when so long passed, in nanoseconds.
const WRITTEN: i64 = 1_000_000_000;

/// Limits are printed rounded: so much of their span lies on either side.
const ROUNDED: f64 = 0.001;

/// The value that value, where it is one of an object the rule is about.
fn subject<'a>(case: &Case<'_>, happening: &Happening<'a>) -> Option<Came<'a>> {
    match happening {
        Happening::Came(value) if case.rule.subjects().any(|of| of.object == value.object) => Some(*value),
        _ => None,
    }
}

/// The value lies inside the limits, however it value.
pub(super) fn limit(case: &Case<'_>, happening: &Happening<'_>, context: &mut Context<'_>) {
    let Some(value) = subject(case, happening) else { return };
    let Some(raw) = value.raw.filter(|_| case.is_due()) else { return };
    let special = value.meaning.and_then(|meaning| meaning.special.as_deref());
    if special.is_some_and(|names| names.get(raw).is_some()) {
        return;
    }
    #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
    let plain = raw as f64;
    #[expect(clippy::cast_precision_loss, reason = "limits of few digits")]
    let (number, [least, most], slack, unit) = match (case.rule.range, case.rule.limits, value.meaning) {
        (Some([least, most]), _, _) => (plain, [least as f64, most as f64], 0.0, ""),
        (None, Some(limits), Some(meaning)) if !meaning.assumed => {
            let scaled = meaning.scaled(&meaning.number(raw)).unwrap_or(plain);
            (scaled, limits, (limits[1] - limits[0]).abs() * ROUNDED, meaning.unit.as_str())
        }
        _ => return,
    };
    let beyond = (least - number).max(number - most);
    if beyond <= slack {
        return context.pass();
    }
    let (text, space) = (&case.rule.text, if unit.is_empty() { "" } else { " " });
    let alarm = case.fail(happening, context).measure(beyond);
    alarm.say(|| {
        format!("{} {}, permitted {least} to {most}{space}{unit}: {text}", value.shown(), value.way.words())
    });
}

/// The value that comes to the device is permitted, or not forbidden.
pub(super) fn chosen(case: &Case<'_>, happening: &Happening<'_>, context: &mut Context<'_>) {
    let Some(value) = subject(case, happening).filter(|value| value.way.is_command()) else { return };
    let Some(raw) = value.raw.filter(|_| case.is_due()) else { return };
    let is_listed = case.rule.values.as_ref().is_some_and(|values| values.contains(raw));
    let is_step = case.rule.step.is_some_and(|step| raw.checked_rem(i64::from(step)) == Some(0));
    let is_wrong = if case.rule.kind == RuleKind::Forbidden { is_listed } else { !is_listed && !is_step };
    if !is_wrong {
        return context.pass();
    }
    let text = &case.rule.text;
    case.fail(happening, context).say(|| format!("{} {}: {text}", value.shown(), value.way.words()));
}

/// The values rise, judged at an occasion or some time after the last write.
pub(super) fn ascending(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    if case.rule.on.0.is_empty() {
        if subject(case, happening).is_some_and(|value| value.way == Way::Written) && context.has_time {
            let deadline = context.now.saturating_add(WRITTEN);
            case.wait(course, deadline, context);
        }
    } else if case.on(happening).is_some() && case.is_due() {
        match falling(case) {
            Rising::Not(object, text) => {
                let alarm = case.fail(happening, context).about(About::Object(object));
                alarm.say(|| text);
            }
            Rising::Yes => context.pass(),
            Rising::Unknown => {}
        }
    }
}

/// The last write is some time ago.
pub(super) fn settled(case: &Case<'_>, context: &mut Context<'_>) {
    if !case.is_due() {
        return;
    }
    match falling(case) {
        Rising::Not(object, text) => {
            let frames = FrameRange::one(case.frames.last);
            let alarm = context.fail_at(context.now, Some(case.scene.id), frames);
            alarm.about(About::Object(object)).say(|| text);
        }
        Rising::Yes => context.pass(),
        Rising::Unknown => {}
    }
}

/// Whether values rise.
enum Rising {
    Yes,
    /// One does not, and what is said of it.
    Not(ObjectAddress, String),
    /// No two neighbours were seen.
    Unknown,
}

fn falling(case: &Case<'_>) -> Rising {
    let mut found = Rising::Unknown;
    for pair in case.rule.objects.windows(2) {
        let [lower, upper] = pair else { continue };
        let (lower, upper) = (lower.object, upper.object);
        let (Some(low), Some(high)) = (case.scaled(lower), case.scaled(upper)) else { continue };
        let rises = if case.rule.or_equal { low <= high } else { low < high };
        if !rises {
            let scene = &case.scene;
            let text = format!("{}, {}: {}", scene.shown(lower), scene.shown(upper), case.rule.text);
            return Rising::Not(upper, text);
        }
        found = Rising::Yes;
    }
    found
}
