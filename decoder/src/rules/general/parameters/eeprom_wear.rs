//! A stored object is written over and over.

use std::collections::{HashMap, VecDeque};

use foldhash::fast::FixedState;

use crate::event::{Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::finding::{About, Severity};
use crate::profile::{Role, Storage};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// An object that the device puts into non-volatile memory with each write is written again and again. Control
    /// words and set points (6040, 6300, 6380 of each channel) are no settings and do not count.
    ///
    /// # Why it matters
    /// Such memory bears a limited number of writes: a cyclic write wears it out within days.
    ///
    /// # Source
    /// Which objects are stored by each write: the device's manual.
    ///
    /// # What to look at first
    /// The part of the controller's program that writes it: it should write once, or only what has changed.
    ///
    /// # Mutation
    /// repeat the download of a stored object ten times
    "eeprom-wear", Error, "an object in non-volatile memory is written over and over",
    kinds: ["sdo-transfer"],
    is_timing: true,
    word: "EEPROM",
    tolerances: &[
        tolerance("minute-writes", 5.0, "", "writes within 60 s, more are an error"),
        tolerance("hour-writes", 20.0, "", "writes within an hour, more are a warning"),
    ],
}

const MINUTE: i64 = 60_000_000_000;
const HOUR: i64 = 60 * MINUTE;

/// Writes remembered of an object: no tolerance counts more.
const WRITE_LIMIT: usize = 256;

/// Objects remembered on a bus; further ones are not judged.
const OBJECT_LIMIT: usize = 4096;

struct EepromWear {
    in_a_minute: f64,
    in_an_hour: f64,
    writes: HashMap<(NodeId, ObjectAddress), VecDeque<i64>, FixedState>,
}

fn new(policy: &Policy) -> EepromWear {
    EepromWear {
        in_a_minute: policy.tolerance(&DECLARATION, "minute-writes"),
        in_an_hour: policy.tolerance(&DECLARATION, "hour-writes"),
        writes: HashMap::default(),
    }
}

impl EepromWear {
    fn written(&mut self, event: &Event, node: NodeId, object: ObjectAddress, context: &mut Context<'_>) {
        if self.writes.len() >= OBJECT_LIMIT && !self.writes.contains_key(&(node, object)) {
            return;
        }
        let now = context.now;
        let writes = self.writes.entry((node, object)).or_default();
        writes.push_back(now);
        while writes.len() > WRITE_LIMIT
            || writes.front().is_some_and(|time| now.saturating_sub(*time) > HOUR)
        {
            writes.pop_front();
        }
        let hour = writes.len();
        let minute = writes.iter().rev().take_while(|time| now.saturating_sub(**time) <= MINUTE).count();
        #[expect(clippy::cast_precision_loss, reason = "counts to compare")]
        let (is_error, is_warning) = (minute as f64 > self.in_a_minute, hour as f64 > self.in_an_hour);
        if !is_error && !is_warning {
            return context.pass();
        }
        let severity = if is_error { Severity::Error } else { Severity::Warning };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let measure = if is_error { minute as f64 * 60.0 } else { hour as f64 };
        let alarm = context.fail(event).about(About::Object(object)).severity(severity).measure(measure);
        alarm.say(|| {
            if is_error {
                format!("written {minute} times within 60 s; each write goes to non-volatile memory")
            } else {
                format!("written {hour} times within an hour; each write goes to non-volatile memory")
            }
        });
    }
}

/// Whether the device stores an object with each write, and it is a setting.
fn is_stored(event: &Event, object: ObjectAddress, context: &Context<'_>) -> bool {
    let Some(node) = context.node(event) else { return false };
    let entry = node.device().dictionary.find(object).and_then(|found| found.entry);
    if entry.is_none_or(|entry| entry.storage != Storage::EachWrite) {
        return false;
    }
    // Channels of CiA 408 devices are 0x800 apart.
    let is_command =
        matches!(object.index, 0x6000..=0x9FFF) && matches!(object.index & 0x7FF, 0x040 | 0x300 | 0x380);
    let role = node.meaning(object).and_then(|meaning| meaning.role);
    !is_command && !matches!(role, Some(Role::Control | Role::SetPoint))
}

impl Rule for EepromWear {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let SdoTransfer { direction: Some(Direction::Download), outcome: Outcome::Complete, .. } = **transfer
        else {
            return;
        };
        let (Some(node), Some(object)) = (event.node, transfer.object) else { return };
        if context.has_time && is_stored(event, object, context) {
            self.written(event, node, object, context);
        }
    }
}
