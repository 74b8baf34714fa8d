//! Frequent writes to objects in non-volatile memory.

use std::collections::{HashMap, VecDeque};

use foldhash::fast::FixedState;

use crate::event::{Event, EventKind, Kind, SdoDirection, SdoOutcome, SdoTransfer};
use crate::finding::{FindingSubject, Severity};
use crate::profile::{ObjectRole, ValueStorage};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// An object that the device stores at each write, or the store command 1010, is written too often
    /// (`minute-writes`, `hour-writes`). Control words and set points (6040, 6300, 6380 of each channel) are exempt.
    ///
    /// # Why it matters
    /// Non-volatile memory endures a limited number of writes. Cyclic writes wear it out within days.
    ///
    /// # Source
    /// Objects that are stored at each write: manual of the device. CiA 301 §7.5.2.13 (store parameters)
    ///
    /// # What to look at first
    /// Write the object once, or only on change.
    ///
    /// # Mutation
    /// repeat the download of a stored object ten times
    "eeprom-wear", Error, "frequent writes to non-volatile memory",
    kinds: [Kind::SdoTransfer],
    needs: "repeated writes to 1010 or to an object that the device stores at each write",
    is_timing: true,
    word: "EEPROM",
    tolerances: &[
        define_tolerance("minute-writes", 5.0, "", "maximum writes within 60 s, else an error"),
        define_tolerance("hour-writes", 20.0, "", "maximum writes within 1 h, else a warning"),
    ],
}

const MINUTE: i64 = 60_000_000_000;
const HOUR: i64 = 60 * MINUTE;

/// Maximum number of writes per object; upper limit of the tolerances.
const WRITE_LIMIT: usize = 256;

/// Maximum number of objects per bus; further ones are not checked.
const OBJECT_LIMIT: usize = 4096;

struct EepromWear {
    in_a_minute: f64,
    in_an_hour: f64,
    writes: HashMap<(NodeId, ObjectAddress), VecDeque<i64>, FixedState>,
}

fn new(policy: &RulePolicy) -> EepromWear {
    EepromWear {
        in_a_minute: policy.tolerance_value(&DECLARATION, "minute-writes"),
        in_an_hour: policy.tolerance_value(&DECLARATION, "hour-writes"),
        writes: HashMap::default(),
    }
}

impl EepromWear {
    fn on_written(
        &mut self,
        event: &Event,
        node: NodeId,
        object: ObjectAddress,
        context: &mut RuleContext<'_>,
    ) {
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
            return context.count_pass();
        }
        let severity = if is_error { Severity::Error } else { Severity::Warning };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let measure = if is_error { minute as f64 * 60.0 } else { hour as f64 };
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Object(object))
            .with_severity(severity)
            .with_measure(measure);
        alarm.report_finding(|| {
            if is_error {
                format!("{minute} writes to non-volatile memory in 60 s (limit {})", self.in_a_minute)
            } else {
                format!("{hour} writes to non-volatile memory in 1 h (limit {})", self.in_an_hour)
            }
        });
    }
}

/// Whether the object is the store command, or a setting that the device stores at each write.
fn is_stored(event: &Event, object: ObjectAddress, context: &RuleContext<'_>) -> bool {
    if object.index == 0x1010 {
        return true;
    }
    let Some(node) = context.event_node(event) else { return false };
    let entry = node.device().dictionary.find_object(object).and_then(|found| found.entry);
    if entry.is_none_or(|entry| entry.storage != ValueStorage::EachWrite) {
        return false;
    }
    // Channels of CiA 408 devices are 0x800 apart.
    let is_command =
        matches!(object.index, 0x6000..=0x9FFF) && matches!(object.index & 0x7FF, 0x040 | 0x300 | 0x380);
    let role = node.meaning(object).and_then(|meaning| meaning.role);
    !is_command && !matches!(role, Some(ObjectRole::Control | ObjectRole::SetPoint))
}

impl Rule for EepromWear {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let SdoTransfer { direction: Some(SdoDirection::Download), outcome: SdoOutcome::Complete, .. } =
            **transfer
        else {
            return;
        };
        let (Some(node), Some(object)) = (event.node, transfer.object) else { return };
        if context.has_time && is_stored(event, object, context) {
            self.on_written(event, node, object, context);
        }
    }
}
