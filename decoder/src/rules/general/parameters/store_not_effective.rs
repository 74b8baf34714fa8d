//! Saved parameters after a restart.

use super::stored::{
    COMMUNICATION_END, CommunicationResets, OBJECT_LIMIT, boot_cause, covers_object, read_object,
    written_object,
};
use crate::event::{BootCause, Event, EventKind, Kind, SdoTransfer};
use crate::finding::Severity;
use crate::profile::{ObjectRole, Persistence, little_endian};
use crate::rules::general::facts::{confirmed_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A setting that was written and saved (1010) has another value after a restart, or one that the device
    /// stores at each write according to its profile. An unsaved setting that is still present, although the
    /// device stores on command only, is a note. Settings are communication objects and objects that the profile
    /// marks as saved, unless rewritten since or not affected by the restart.
    ///
    /// # Why it matters
    /// From the next power-on, the device works with other settings than commissioned.
    ///
    /// # Source
    /// CiA 301 §7.5.2.13 (1010), §7.3.2.2.2 (effect of a reset)
    ///
    /// # What to look at first
    /// Wait for the end of saving before power-off or reset. Check in the manual which objects the sub-index
    /// of 1010 covers.
    ///
    /// # Mutation
    /// change a value read after save and restart
    "store-not-effective", Warning, "saved setting not effective after restart",
    kinds: [Kind::SdoTransfer, Kind::BootUp, Kind::Emcy, Kind::NmtCommand],
    needs: "a stored setting, a restart, then a read",
    cases: &["2.29", "2.30", "6.8", "6.10", "8.2", "8.4", "8.6", "8.8", "8.9", "9.1"],
    word: "STORE",
}

/// Maximum size of compared values, in bytes.
const LONGEST: usize = 8;

/// Setting that was written.
#[derive(Clone)]
struct WrittenSetting {
    object: ObjectAddress,
    value: u64,
    /// Frame that confirmed the write, or the save that covers it.
    frame: u64,
    /// Confirmed earlier value, if it differs.
    before: Option<u64>,
    is_saved: bool,
}

#[derive(Default)]
struct StoredSettings {
    /// Settings written since the last restart, and saved settings.
    settings: Vec<WrittenSetting>,
    /// Settings expected after the last restart, until they are read or written.
    expected: Vec<WrittenSetting>,
    /// The device stores on command only (1010).
    on_command: bool,
}

#[derive(Default)]
struct StoreNotEffective {
    nodes: NodeMap<StoredSettings>,
    resets: CommunicationResets,
}

fn new(_policy: &RulePolicy) -> StoreNotEffective {
    StoreNotEffective::default()
}

/// Whether an object is a setting rather than a command, count or state.
fn is_setting(object: ObjectAddress, transfer: &SdoTransfer) -> bool {
    match object.index {
        0x1001..=0x1003 | 0x1010 | 0x1011 | 0x1013 | 0x1023..=0x1026 | 0x1F50..=0x1FFF => false,
        0x1000..COMMUNICATION_END => transfer.persists != Some(Persistence::No),
        _ => transfer.persists == Some(Persistence::NeedsSave) || is_stored(transfer),
    }
}

/// Whether the device stores the value at each write, as the profile states. Commands and set points have a role.
fn is_stored(transfer: &SdoTransfer) -> bool {
    let role = transfer.meaning.as_ref().and_then(|meaning| meaning.role);
    transfer.persists == Some(Persistence::Yes)
        && !matches!(
            role,
            Some(ObjectRole::Control | ObjectRole::SetPoint | ObjectRole::Status | ObjectRole::Actual)
        )
}

/// Flags of a COB-ID that the device may set.
const fn own_bits(index: u16) -> u64 {
    match index {
        0x1005 | 0x1012 | 0x1014 | 0x1200..=0x15FF | 0x1800..=0x19FF => 0xC000_0000,
        _ => 0,
    }
}

impl StoredSettings {
    fn on_written(&mut self, object: ObjectAddress, transfer: &SdoTransfer, frame: u64) {
        self.expected.retain(|setting| setting.object != object);
        match (object.index, object.sub) {
            (0x1010, sub @ 1..) if transfer.data == b"save" => {
                for setting in self.settings.iter_mut().filter(|it| covers_object(sub, it.object.index)) {
                    setting.is_saved = true;
                    setting.frame = frame;
                }
                return;
            }
            // The effect of a restore or of another signature on single objects is unknown.
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
        self.settings.push(WrittenSetting { object, value, frame, before, is_saved: is_stored(transfer) });
    }

    fn on_boot(&mut self, is_partial: bool, on_command: bool) {
        self.on_command = on_command;
        let concerns = |setting: &WrittenSetting| !is_partial || setting.object.index < COMMUNICATION_END;
        self.expected = self.settings.iter().filter(|it| concerns(it)).cloned().collect();
        self.settings.retain(|setting| setting.is_saved || !concerns(setting));
    }
}

impl StoreNotEffective {
    fn on_transfer(
        &mut self,
        event: &Event,
        id: NodeId,
        transfer: &SdoTransfer,
        context: &mut RuleContext<'_>,
    ) {
        let Some(stored) = self.nodes.entry(id) else { return };
        if let Some(object) = written_object(transfer) {
            return stored.on_written(object, transfer, event.frames.last);
        }
        let Some(object) = read_object(transfer).filter(|_| transfer.data.len() <= LONGEST) else { return };
        let Some(place) = stored.expected.iter().position(|it| it.object == object) else { return };
        let WrittenSetting { value, frame, before, is_saved, .. } = stored.expected.swap_remove(place);
        let found = little_endian(&transfer.data);
        let is_there = (found ^ value) & !own_bits(object.index) == 0;
        // Another write may have reset the object, such as a new mode and its mapping; the profile defines
        // this.
        let is_void = context.event_node(event).is_none_or(|node| {
            node.store().seen_value(object).is_none_or(|entry| entry.stale && node.assigned_by().is_some())
        });
        match (is_saved, is_there) {
            (true, true) | (false, false) => context.count_pass(),
            (true, false) if is_void => {}
            (true, false) => {
                let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
                alarm.report_finding(|| {
                    format!("{found:X}h after the restart, but {value:X}h stored {{{frame}}}")
                });
            }
            (false, true) if stored.on_command && before.is_some() => {
                let alarm = context
                    .start_finding(event)
                    .with_subject(transfer_subject(transfer))
                    .with_severity(Severity::Note);
                alarm.report_finding(|| {
                    format!("unsaved value {value:X}h {{{frame}}} still present after the restart")
                });
            }
            (false, true) => {}
        }
    }

    fn on_boot(&mut self, event: &Event, id: NodeId, cause: BootCause, context: &RuleContext<'_>) {
        let is_partial = self.resets.is_partial(id, cause);
        let Some(stored) = self.nodes.get_mut(id) else { return };
        // 1010:01 bit 0: on command; bit 1: autonomously. The value remains valid after the restart.
        let says = context.event_node(event).and_then(|node| {
            let entry = node.store().seen_value(ObjectAddress::new(0x1010, 1))?;
            (entry.value.len() <= LONGEST && entry.value != b"save").then(|| little_endian(&entry.value))
        });
        let says =
            says.or_else(|| context.event_node(event).and_then(|node| confirmed_number(node, 0x1010, 1)));
        stored.on_boot(is_partial, says.is_some_and(|says| says & 3 == 1));
    }
}

impl Rule for StoreNotEffective {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::NmtCommand { service, target, .. } = event.kind {
            return self.resets.on_command(service, target);
        }
        let Some(node) = event.node else { return };
        if let Some(cause) = boot_cause(event) {
            self.on_boot(event, node, cause, context);
        } else if let EventKind::SdoTransfer(transfer) = &event.kind {
            self.on_transfer(event, node, transfer, context);
        }
    }
}
