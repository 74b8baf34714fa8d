//! Values after a restart against the defaults in the dictionary.

use super::stored::{
    COMMUNICATION_END, CommunicationResets, OBJECT_LIMIT, boot_cause, covers_object, read_object,
    written_object,
};
use crate::event::{BootCause, Event, EventKind, Kind, SdoTransfer};
use crate::profile::object::{DefaultValue, SdoAccess};
use crate::profile::{DataType, DecodedValue, SubEntry, as_integer, as_word};
use crate::rules::general::facts::transfer_subject;
use crate::rules::general::sdo::sdo_situation::is_described;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// After a restore (1011, "load") and a restart, a communication object differs from the default in its
    /// EDS or profile. Without a restore, there is no finding. Objects that were written or saved since, that
    /// the device itself changes, and most read-only objects are exempt.
    ///
    /// # Why it matters
    /// A replacement device starts with other settings than its device file states. Identifiers, times and
    /// mappings do not match the controller.
    ///
    /// # Source
    /// CiA 301 §7.5.2.14 (1011), CiA 306-1 §4.6.3 (DefaultValue)
    ///
    /// # What to look at first
    /// Compare firmware version and EDS version. Check whether the default depends on the node-ID ($NODEID).
    ///
    /// # Mutation
    /// change a value read after a restore and a restart
    "object-default", Warning, "restored value differs from the default",
    kinds: [Kind::SdoTransfer, Kind::BootUp, Kind::Emcy, Kind::NmtCommand],
    needs: "a restore (1011), a restart, then a read",
    cases: &["4.2", "4.8", "8.4", "8.8"],
    word: "DEFLT",
}

/// Last sub-index of 1010 and 1011 with an area defined in CiA 301.
const LAST_AREA: u8 = 3;

#[derive(Default)]
struct DefaultState {
    /// The node has restarted in this capture.
    has_restarted: bool,
    /// Sub-index of 1011 of a restore that takes effect at the next restart.
    loading: Option<u8>,
    /// Sub-index of 1011 of the restore that is in effect.
    restored: Option<u8>,
    /// Highest sub-index of 1010 that saved parameters, so that the next restart restores the saved values.
    saved: Option<u8>,
    /// Objects with non-default values written since the restore, and whether also since the restart. A
    /// device that stores values by itself keeps them.
    written: Vec<(ObjectAddress, bool)>,
    /// More objects were written than `written` can contain.
    is_full: bool,
}

#[derive(Default)]
struct ObjectDefault {
    nodes: NodeMap<DefaultState>,
    resets: CommunicationResets,
}

fn new(_policy: &RulePolicy) -> ObjectDefault {
    ObjectDefault::default()
}

/// Objects that depend on the individual device or firmware: status register, names, versions, node-ID,
/// storage capabilities, time stamp, revision and serial number, domains and programs.
const fn is_own(object: ObjectAddress) -> bool {
    match object.index {
        0x1002 | 0x1008..=0x100B | 0x1010 | 0x1011 | 0x1013 | 0x1020..=0x1026 | 0x1F50..=0x1FFF => true,
        0x1018 => object.sub > 2,
        _ => false,
    }
}

/// Whether the dictionary default applies to an object after a restore.
fn is_judged(node: &Node, object: ObjectAddress) -> bool {
    let found = node.device().dictionary.find_object(object);
    let Some((found, entry)) = found.and_then(|found| Some((found, found.entry?))) else { return false };
    let is_count = object.sub == 0 && found.object.is_record;
    let is_set = matches!(entry.access, Some(SdoAccess::Rw | SdoAccess::Const));
    let is_compared = is_count || is_set || matches!(object.index, 0x1000..=0x101F);
    is_compared && !matches!(object.index, 0x1001 | 0x1003) && is_described(node.device(), object)
}

/// Whether data equals the default; `None` without a default or if they cannot be compared.
fn is_default(node: &Node, object: ObjectAddress, data: &[u8]) -> Option<bool> {
    let entry = node.device().dictionary.find_object(object)?.entry?;
    equals_default(entry, node.id().number(), &node.meaning(object)?.decode(data))
}

/// Whether a value equals the default of an entry for this node-ID.
fn equals_default(entry: &SubEntry, node: u8, value: &DecodedValue) -> Option<bool> {
    let DecodedValue::Real(read) = *value else {
        let wanted = entry.default_number(Some(node))?;
        return match as_integer(value) {
            Some(read) => Some(read == wanted),
            None => as_word(value).map(|read| read == wanted.cast_unsigned()),
        };
    };
    #[expect(clippy::cast_precision_loss, reason = "a default written as a whole number")]
    let wanted = match entry.default.as_ref()? {
        DefaultValue::Real(wanted) => *wanted,
        DefaultValue::Number(wanted) => *wanted as f64,
        DefaultValue::Text(_) => return None,
    };
    #[expect(clippy::cast_possible_truncation, reason = "a REAL32 has no more digits than that")]
    let [short_read, short_wanted] = [read as f32, wanted as f32];
    let is_short = entry.data_type == Some(DataType::Real32);
    Some(read.to_bits() == wanted.to_bits() || is_short && short_read.to_bits() == short_wanted.to_bits())
}

/// Value and default for display.
fn default_texts(node: &Node, object: ObjectAddress, data: &[u8]) -> (String, String) {
    let Some(meaning) = node.meaning(object) else { return (String::new(), String::new()) };
    let entry = node.device().dictionary.find_object(object).and_then(|found| found.entry);
    let number = entry.and_then(|entry| entry.default_number(Some(node.id().number())));
    let real = match entry.and_then(|entry| entry.default.as_ref()) {
        Some(DefaultValue::Real(real)) => real.to_string(),
        _ => String::new(),
    };
    let wanted = number.map_or(real, |number| meaning.format_value(&meaning.convert_raw(number)));
    (meaning.format_value(&meaning.decode(data)), wanted)
}

impl ObjectDefault {
    fn on_boot(&mut self, node: NodeId, cause: BootCause) {
        let is_partial = self.resets.is_partial(node, cause);
        let Some(started) = self.nodes.entry(node) else { return };
        let loaded = started.loading.take();
        *started = DefaultState {
            has_restarted: true,
            restored: loaded.or(started.restored).filter(|_| started.saved.is_none()),
            saved: started.saved.filter(|_| loaded.is_none()),
            written: std::mem::take(&mut started.written),
            is_full: started.is_full,
            loading: None,
        };
        started.written.retain(|(object, _)| !loaded.is_some_and(|sub| covers_object(sub, object.index)));
        for (object, is_since) in &mut started.written {
            *is_since &= is_partial && object.index >= COMMUNICATION_END;
        }
    }

    fn on_transfer(
        &mut self,
        event: &Event,
        id: NodeId,
        transfer: &SdoTransfer,
        context: &mut RuleContext<'_>,
    ) {
        let Some(node) = context.event_node(event) else { return };
        let Some(started) = self.nodes.entry(id) else { return };
        if let Some(object) = written_object(transfer) {
            started.on_written(node, object, &transfer.data);
        } else if let Some(object) = read_object(transfer)
            && let Some(is_right) = started.judge_value(node, object, &transfer.data)
        {
            if is_right {
                return context.count_pass();
            }
            let by = node.device().default_origin(object).title();
            let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
            alarm.report_finding(|| {
                let (read, wanted) = default_texts(node, object, &transfer.data);
                format!("{read} after restore and restart (default {wanted}, {by})")
            });
        }
    }
}

impl DefaultState {
    fn on_written(&mut self, node: &Node, object: ObjectAddress, data: &[u8]) {
        match (object.index, object.sub) {
            (0x1010, sub @ 1..) => {
                self.saved = self.saved.max(Some(sub));
                self.loading = None;
                self.restored = None;
            }
            (0x1011, sub @ 1..) if data == b"load" => {
                self.loading = Some(sub);
                // The communication objects are in sub-index 1 and 2; the area of a manufacturer sub-index is unknown.
                let is_undone = sub == 1 || sub == 2 && self.saved.is_none_or(|saved| saved <= LAST_AREA);
                self.saved = self.saved.filter(|_| !is_undone);
            }
            _ => {}
        }
        self.written.retain(|(known, _)| *known != object);
        if is_default(node, object, data) == Some(true) {
            return;
        }
        if self.written.len() < OBJECT_LIMIT {
            self.written.push((object, true));
        } else {
            self.is_full = true;
        }
    }

    /// Whether a read value equals the default; `None` if there is no verdict.
    fn judge_value(&self, node: &Node, object: ObjectAddress, data: &[u8]) -> Option<bool> {
        let written = self.written.iter().find(|(known, _)| *known == object).map(|(_, is_since)| *is_since);
        if !self.has_restarted || self.is_full || written == Some(true) || !is_judged(node, object) {
            return None;
        }
        let is_right = is_default(node, object, data)?;
        // In other areas, the device or a PDO may change values at any time.
        let is_restored = self.restored.is_some_and(|sub| covers_object(sub, object.index));
        let is_promised =
            is_restored && object.index < COMMUNICATION_END && !is_own(object) && written.is_none();
        (is_right || is_promised).then_some(is_right)
    }
}

impl Rule for ObjectDefault {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::NmtCommand { service, target, .. } = event.kind {
            return self.resets.on_command(service, target);
        }
        let Some(node) = event.node else { return };
        if let Some(cause) = boot_cause(event) {
            self.on_boot(node, cause);
        } else if let EventKind::SdoTransfer(transfer) = &event.kind {
            self.on_transfer(event, node, transfer, context);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::profile::{device_file, imported};

    #[test]
    fn defaults_are_compared_by_type() {
        let text = "[1400]\nParameterName=a\nObjectType=9\n\
            [1400sub1]\nParameterName=b\nDataType=7\nAccessType=rw\nDefaultValue=$NODEID+0x80000200\n\
            [2000]\nParameterName=c\nDataType=8\nAccessType=rw\nDefaultValue=0.1\n\
            [2001]\nParameterName=d\nDataType=3\nAccessType=rw\nDefaultValue=0xFFFF\n\
            [2002]\nParameterName=e\nDataType=5\nAccessType=rw\n";
        let device = imported::describe_device(
            &Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap()),
            "a.eds",
        );
        let of = |index, sub, data: &[u8]| {
            let entry = device.dictionary.find_object(ObjectAddress::new(index, sub)).unwrap().entry.unwrap();
            equals_default(entry, 5, &entry.data_type.unwrap().decode(data))
        };
        assert_eq!(of(0x1400, 1, &[0x05, 0x02, 0, 0x80]), Some(true));
        assert_eq!(of(0x1400, 1, &[0x06, 0x02, 0, 0x80]), Some(false));
        assert_eq!(of(0x2000, 0, &0.1_f32.to_le_bytes()), Some(true));
        assert_eq!(of(0x2000, 0, &0.2_f32.to_le_bytes()), Some(false));
        assert_eq!(of(0x2001, 0, &[0xFF, 0xFF]), Some(true));
        assert_eq!(of(0x2002, 0, &[0]), None);
    }
}
