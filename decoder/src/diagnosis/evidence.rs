//! What the capture disproves, and what it cannot show.

use super::plot::StoryPlot;
use crate::finding::phrase::format_interval;
use crate::finding::{CaptureFindings, FindingScene};
use crate::wire::canopen::NmtState;

/// Rules whose findings state themselves that the node or the controller is silent.
const SILENT_NODE: [&str; 4] = ["node-lost", "unexpected-boot", "guard-no-answer", "config-lost"];
const SILENT_CONTROLLER: [&str; 2] = ["guard-late", "command-gap"];

/// Causes that the capture disproves at the beginning of the story.
pub(super) fn disproved_causes(plot: &StoryPlot<'_>) -> Vec<String> {
    let mut all = Vec::new();
    let Some(root) = plot.findings.first().map(|it| it.group) else { return all };
    let Some(scene) = root.scene.as_deref() else { return all };
    let has = |rules: &[&str]| plot.findings.iter().any(|it| rules.contains(&&*it.group.rule));
    if let (Some(alive), false) = (&scene.alive, has(&SILENT_NODE)) {
        let (expected, age) = (format_interval(alive.expected), format_interval(alive.age));
        all.push(format!(
            "node off the bus ({} {age} before, expected every {expected})",
            alive.by.message()
        ));
    }
    if let (Some(commands), false) = (&scene.commands, has(&SILENT_CONTROLLER)) {
        all.push(format!("controller silent ({} every {})", commands.pdo, format_interval(commands.period)));
    }
    if scene.nmt == Some(NmtState::Operational) && !has(&["operational-lost"]) && !has(&SILENT_NODE) {
        all.push("NMT state (operational)".to_owned());
    }
    if scene.error_frames > 0 && scene.recent_error_frames == 0 {
        all.push("bus errors (error frames are recorded, none in the second before)".to_owned());
    }
    all
}

/// Limit of a capture without error frames.
pub(crate) const WIRING: &str =
    "wiring: no error frames, and the capture does not show whether they were recorded";

/// What the capture cannot show.
pub(super) fn unknown_points(plot: &StoryPlot<'_>, findings: &CaptureFindings) -> Vec<String> {
    let mut all = Vec::new();
    let scene: Option<&FindingScene> = plot.findings.first().and_then(|it| it.group.scene.as_deref());
    if findings.error_frames == 0 {
        all.push(WIRING.to_owned());
    }
    if let Some(scene) = scene {
        for gate in &scene.invisible {
            let text = format!("{gate}: not visible on the bus");
            if !all.contains(&text) {
                all.push(text);
            }
        }
        if !scene.has_profile && plot.findings.first().is_some_and(|it| it.group.key.node.is_some()) {
            all.push("device states and manual: no profile assigned (--node ID=PROFILE)".to_owned());
        }
    }
    all
}
