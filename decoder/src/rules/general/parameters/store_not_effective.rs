//! Saved parameters that are not there after a restart.

use super::stored::{COMMUNICATION_END, OBJECT_LIMIT, Resets, boot, covers, read, written};
use crate::event::{BootCause, Event, EventKind, SdoTransfer};
use crate::finding::Severity;
use crate::profile::little_endian;
use crate::rules::general::facts::{about, sure};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A setting was written, saved (1010) and confirmed, and reads as something else after a restart. Or one that was
    /// written and not saved is still there, though the device says that it stores on command only (1010): a note.
    /// Settings are communication objects, and those of which the device's profile says that a store command keeps
    /// them. What was written again since, and what a restart did not concern, is not judged.
    ///
    /// # Why it matters
    /// The device runs with other settings than were commissioned, from the next power-on.
    ///
    /// # Source
    /// CiA 301 §7.5.2.13 (1010), §7.3.2.2.2 (what a reset brings)
    ///
    /// # What to look at first
    /// Whether the node was reset or switched off before its memory was written; which objects the sub-index of 1010
    /// covers by the manual.
    ///
    /// # Mutation
    /// change a value read behind save and restart
    "store-not-effective", Warning, "a saved setting is not there after a restart",
    kinds: ["sdo-transfer", "boot-up", "emcy", "nmt-command"],
    cases: &["2.29", "2.30", "6.8", "6.10", "8.2", "8.4", "8.6", "8.8", "8.9", "9.1"],
    word: "STORE",
}

/// Longest value that is compared.
const LONGEST: usize = 8;

/// A setting that was written.
#[derive(Clone)]
struct Setting {
    object: ObjectAddress,
    value: u64,
    /// Frame that confirmed it, or the save that covers it.
    frame: u64,
    /// Value surely known before, where it was another one.
    before: Option<u64>,
    is_saved: bool,
}

#[derive(Default)]
struct Stored {
    /// Written since the last restart, or saved.
    settings: Vec<Setting>,
    /// What the last restart brings, until it was read or written.
    expected: Vec<Setting>,
    /// It says that it stores on command only.
    on_command: bool,
}

#[derive(Default)]
struct StoreNotEffective {
    nodes: NodeMap<Stored>,
    resets: Resets,
}

fn new(_policy: &Policy) -> StoreNotEffective {
    StoreNotEffective::default()
}

/// Whether what is written there is a setting, and no command, count or state.
fn is_setting(object: ObjectAddress, transfer: &SdoTransfer) -> bool {
    match object.index {
        0x1001..=0x1003 | 0x1010 | 0x1011 | 0x1013 | 0x1023..=0x1026 | 0x1F50..=0x1FFF => false,
        0x1000..COMMUNICATION_END => transfer.persists != Some("no"),
        _ => transfer.persists == Some("needs-save"),
    }
}

/// Bits of a COB-ID a device may set by itself.
const fn own_bits(index: u16) -> u64 {
    match index {
        0x1005 | 0x1012 | 0x1014 | 0x1200..=0x15FF | 0x1800..=0x19FF => 0xC000_0000,
        _ => 0,
    }
}

impl Stored {
    fn wrote(&mut self, object: ObjectAddress, transfer: &SdoTransfer, frame: u64) {
        self.expected.retain(|setting| setting.object != object);
        match (object.index, object.sub) {
            (0x1010, sub @ 1..) if transfer.data == b"save" => {
                for setting in self.settings.iter_mut().filter(|it| covers(sub, it.object.index)) {
                    setting.is_saved = true;
                    setting.frame = frame;
                }
                return;
            }
            // Which of them a restore leaves, or what another signature does, the maker knows.
            (0x1010 | 0x1011, 1..) => {
                self.settings.clear();
                self.expected.clear();
                return;
            }
            _ => {}
        }
        self.settings.retain(|setting| setting.object != object);
        let fits = self.settings.len() < OBJECT_LIMIT && (1..=LONGEST).contains(&transfer.data.len());
        if !fits || !is_setting(object, transfer) {
            return;
        }
        let value = little_endian(&transfer.data);
        let before = transfer.previous.as_deref().filter(|_| !transfer.previous_assumed);
        let before = before.filter(|bytes| bytes.len() <= LONGEST).map(little_endian);
        let before = before.filter(|before| *before != value);
        self.settings.push(Setting { object, value, frame, before, is_saved: false });
    }

    fn booted(&mut self, is_partial: bool, on_command: bool) {
        self.on_command = on_command;
        let concerns = |setting: &Setting| !is_partial || setting.object.index < COMMUNICATION_END;
        self.expected = self.settings.iter().filter(|it| concerns(it)).cloned().collect();
        self.settings.retain(|setting| setting.is_saved || !concerns(setting));
    }
}

impl StoreNotEffective {
    fn transfer(&mut self, event: &Event, id: NodeId, transfer: &SdoTransfer, context: &mut Context<'_>) {
        let Some(stored) = self.nodes.entry(id) else { return };
        if let Some(object) = written(transfer) {
            return stored.wrote(object, transfer, event.frames.last);
        }
        let Some(object) = read(transfer).filter(|_| transfer.data.len() <= LONGEST) else { return };
        let Some(place) = stored.expected.iter().position(|it| it.object == object) else { return };
        let Setting { value, frame, before, is_saved, .. } = stored.expected.swap_remove(place);
        let found = little_endian(&transfer.data);
        let is_there = (found ^ value) & !own_bits(object.index) == 0;
        // Another write may have made it void: a new mode its own mapping. Which do the device's profile says.
        let is_void = context.node(event).is_none_or(|node| {
            node.store().seen(object).is_none_or(|entry| entry.stale && node.assigned().is_some())
        });
        match (is_saved, is_there) {
            (true, true) | (false, false) => context.pass(),
            (true, false) if is_void => {}
            (true, false) => {
                let alarm = context.fail(event).about(about(transfer));
                alarm.say(|| {
                    format!("reads as {found:X}h after the restart, but {value:X}h was saved {{{frame}}}")
                });
            }
            (false, true) if stored.on_command && before.is_some() => {
                let alarm = context.fail(event).about(about(transfer)).severity(Severity::Note);
                alarm.say(|| {
                    format!("{value:X}h, written {{{frame}}} and not saved, is there after the restart")
                });
            }
            (false, true) => {}
        }
    }

    fn booted(&mut self, event: &Event, id: NodeId, cause: BootCause, context: &Context<'_>) {
        let is_partial = self.resets.is_partial(id, cause);
        let Some(stored) = self.nodes.get_mut(id) else { return };
        // Bit 0 of 1010:01: on command; bit 1: by itself. The restart itself makes nothing of it stale.
        let says = context.node(event).and_then(|node| {
            let entry = node.store().seen(ObjectAddress::new(0x1010, 1))?;
            (entry.value.len() <= LONGEST && entry.value != b"save").then(|| little_endian(&entry.value))
        });
        let says = says.or_else(|| context.node(event).and_then(|node| sure(node, 0x1010, 1)));
        stored.booted(is_partial, says.is_some_and(|says| says & 3 == 1));
    }
}

impl Rule for StoreNotEffective {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::NmtCommand { service, target, .. } = event.kind {
            return self.resets.command(service, target);
        }
        let Some(node) = event.node else { return };
        if let Some(cause) = boot(event) {
            self.booted(event, node, cause, context);
        } else if let EventKind::SdoTransfer(transfer) = &event.kind {
            self.transfer(event, node, transfer, context);
        }
    }
}
