//! What must not happen, not now, or not before something else.

use super::attached::Course;
use super::conditions::Proof;
use super::happening::Happening;
use super::judge::Case;
use crate::rules::Context;

/// `on` does not happen.
pub(super) fn never(case: &Case<'_>, happening: &Happening<'_>, context: &mut Context<'_>) {
    if case.on(happening).is_some() && case.is_due() {
        let text = &case.rule.text;
        case.fail(happening, context).say(|| format!("{}: {text}", happening.words()));
    }
}

/// When `on` happens, nothing of `needs` is proven to be missing.
pub(super) fn precondition(case: &Case<'_>, happening: &Happening<'_>, context: &mut Context<'_>) {
    if case.on(happening).is_none() || !case.is_due() {
        return;
    }
    let (needs, channel) = (&case.rule.needs.0, case.rule.channel);
    match case.scene.needs(case.rule, case.number) {
        Proof::Holds => context.pass(),
        Proof::Unknown => {}
        Proof::Fails => {
            let (scene, text) = (case.scene, &case.rule.text);
            case.fail(happening, context).say(|| {
                let instead = scene.unmet(needs, channel).filter(|(object, _)| !happening.is_of(*object));
                let instead = instead.map_or_else(String::new, |(_, instead)| format!(", {instead}"));
                format!("{}{instead}: {text}", happening.words())
            });
        }
    }
}

/// `on` comes only after `before`, and `since` makes that void.
pub(super) fn order(
    case: &Case<'_>,
    course: &mut Course,
    happening: &Happening<'_>,
    context: &mut Context<'_>,
) {
    if case.on(happening).is_some() && case.is_due() {
        let text = &case.rule.text;
        match course.is_prepared {
            Some(true) => context.pass(),
            Some(false) => case.fail(happening, context).say(|| format!("{}: {text}", happening.words())),
            None => {}
        }
    }
    let is_start = matches!(happening, Happening::Boot);
    let since = &case.rule.since.0;
    let is_void = if since.is_empty() { is_start } else { since.iter().any(|it| happening.fulfils(it)) };
    if case.rule.before.0.iter().any(|it| happening.fulfils(it)) {
        course.is_prepared = Some(true);
    } else if is_void {
        course.is_prepared = Some(false);
    } else if is_start {
        // What was so before a start is so no longer.
        course.is_prepared = None;
    }
}
