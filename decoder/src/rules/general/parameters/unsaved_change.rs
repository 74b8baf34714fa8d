//! Changed settings without a store command.

use crate::event::{Event, EventKind, Kind, SdoDirection, SdoOutcome};
use crate::profile::Persistence;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeMap;
use crate::wire::canopen::ObjectAddress;
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// Objects that the device stores on command only were written, and no store command (1010) that covers
    /// them follows. The rule is off by default, because a controller that writes its configuration at each
    /// start need not store it.
    ///
    /// # Why it matters
    /// The commissioned settings are lost at the next power-off.
    ///
    /// # Source
    /// Objects of a store command: manual of the device; CiA 301 §7.5.2.13 (1010)
    ///
    /// # What to look at first
    /// Write "save" to 1010 if the settings must persist. Use the sub-index of 1010 that covers the objects.
    ///
    /// # Mutation
    /// drop the download of 1010
    "unsaved-change", Warning, "changed settings not stored",
    kinds: [Kind::SdoTransfer],
    needs: "a write to an object that is stored on command only",
    is_on: false,
    word: "SAVE",
}

/// Maximum number of objects per node.
const OBJECT_LIMIT: usize = 1024;

/// Maximum number of objects listed in the finding.
const NAMED: usize = 6;

#[derive(Default)]
struct UnsavedChange {
    /// Written objects, each with its frame.
    written: NodeMap<Vec<(ObjectAddress, u64)>>,
}

fn new(_policy: &RulePolicy) -> UnsavedChange {
    UnsavedChange::default()
}

impl Rule for UnsavedChange {
    fn on_event(&mut self, event: &Event, _context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let is_write =
            transfer.direction == Some(SdoDirection::Download) && transfer.outcome == SdoOutcome::Complete;
        let (Some(node), Some(object), true) = (event.node, transfer.object, is_write) else { return };
        if transfer.persists != Some(Persistence::NeedsSave) {
            return;
        }
        let Some(written) = self.written.entry(node) else { return };
        written.retain(|(known, _)| *known != object);
        if written.len() < OBJECT_LIMIT {
            written.push((object, event.frames.last));
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        for (id, written) in self.written.iter() {
            let Some(node) = context.bus.node(id) else { continue };
            let mut unsaved = written.clone();
            unsaved.retain(|(object, _)| node.persistence_text(*object) == Some(Persistence::NotStored));
            let frames = unsaved.iter().map(|(_, frame)| *frame);
            let Some((first, last)) = frames.clone().min().zip(frames.max()) else {
                context.count_pass();
                continue;
            };
            unsaved.sort_unstable();
            let alarm = context.fail_at(context.now, Some(id), crate::event::FrameRange { first, last });
            alarm.report_finding(|| {
                let named: Vec<_> =
                    unsaved.iter().take(NAMED).map(|(object, _)| object.to_string()).collect();
                let more = if unsaved.len() > NAMED { ", …" } else { "" };
                let objects = count_noun(unsaved.len() as u64, "object");
                format!("{objects} written but not stored with 1010 ({}{more})", named.join(", "))
            });
        }
    }
}
