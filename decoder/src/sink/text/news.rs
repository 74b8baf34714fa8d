//! Filter for PDOs and J1939 messages with new information. Set points, states and bits have their own
//! events, and measured values change a little in almost every message.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{Event, EventKind, J1939Message};
use crate::frame::{BusIndex, CanId};
use crate::profile::{ObjectMeaning, ObjectRole, PayloadLayout, SignalField};

/// A measured value is new if it changed by this fraction of its full scale.
const SHARE: u64 = 100;

/// Maximum number of identifiers; beyond it, every changed message is new.
const MOST: usize = 4096;

/// Last printed payload per bus and identifier.
#[derive(Debug, Clone, Default)]
pub struct PrintedPayloads {
    printed: HashMap<(BusIndex, CanId), Box<[u8]>, FixedState>,
    /// Payload in `printed` that the last event replaced.
    replaced: Option<Box<[u8]>>,
}

impl PrintedPayloads {
    /// Whether an event contains new information. Call it once per event, in order: a PDO is compared with
    /// the last one for which the result was `true`.
    #[inline]
    pub fn has_news(&mut self, event: &Event) -> bool {
        self.replaced = None;
        !event.routine && self.has_changed(event)
    }

    fn has_changed(&mut self, event: &Event) -> bool {
        match &event.kind {
            EventKind::Pdo(pdo) => {
                let layout = pdo.layout.as_deref().filter(|_| !pdo.is_request);
                self.is_news(event.bus, pdo.cob_id, layout, pdo.payload())
            }
            EventKind::J1939Message(message) => self.is_message_news(event.bus, message),
            _ => true,
        }
    }

    /// Payload that the event of the last call of [`Self::has_news`] is compared with, if it is new.
    pub fn replaced_payload(&self) -> Option<&[u8]> {
        self.replaced.as_deref()
    }

    /// Memory in use, in bytes.
    pub fn footprint(&self) -> usize {
        self.printed.len() * 2 * size_of::<((BusIndex, CanId), Box<[u8]>)>()
            + self.printed.values().map(|payload| payload.len()).sum::<usize>()
    }

    /// Whether a changed PDO contains information that no other event shows, compared with the last such PDO.
    fn is_news(&mut self, bus: BusIndex, id: CanId, layout: Option<&PayloadLayout>, payload: &[u8]) -> bool {
        let Some(layout) = layout else { return true };
        let role = |field: &SignalField| field.meaning.as_deref().and_then(|meaning| meaning.role);
        if !layout.fields.iter().any(|field| role(field).is_some()) {
            return true;
        }
        self.payload_differs((bus, id), payload, |before| {
            layout.fields.iter().any(|field| {
                has_moved(field, field.meaning.as_deref().and_then(|meaning| meaning.role), before, payload)
            })
        })
    }

    /// As `is_news`, for a J1939 message. Of an unknown message only the first one is new: most contain
    /// measured values.
    fn is_message_news(&mut self, bus: BusIndex, message: &J1939Message) -> bool {
        let payload = message.payload();
        self.payload_differs((bus, message.can_id), payload, |before| {
            let layout = message.layout.iter().filter(|layout| !layout.origin.is_standard_table());
            let fields = layout.flat_map(|layout| &layout.fields);
            fields.into_iter().any(|field| {
                let meaning = field.meaning.as_deref();
                let is_measured =
                    meaning.is_some_and(|meaning| meaning.values.is_none() && meaning.bits.is_none());
                let role =
                    meaning.and_then(|meaning| meaning.role).or(is_measured.then_some(ObjectRole::Actual));
                has_moved(field, role, before, payload)
            })
        })
    }

    fn payload_differs(
        &mut self,
        key: (BusIndex, CanId),
        payload: &[u8],
        moved: impl Fn(&[u8]) -> bool,
    ) -> bool {
        let news = match self.printed.get(&key) {
            None => true,
            Some(before) if before.len() != payload.len() => true,
            Some(before) => moved(before),
        };
        if news && (self.printed.len() < MOST || self.printed.contains_key(&key)) {
            self.replaced = self.printed.insert(key, payload.into());
        }
        news
    }
}

/// Whether a field changed in a way that no other event shows.
fn has_moved(field: &SignalField, role: Option<ObjectRole>, before: &[u8], now: &[u8]) -> bool {
    let (before, now) = (field.extract_bits(before), field.extract_bits(now));
    let (Some(before), Some(now)) = (before, now) else { return before != now };
    if before == now {
        return false;
    }
    match (field.meaning.as_deref(), role) {
        (_, Some(ObjectRole::SetPoint | ObjectRole::Status)) => false,
        (Some(meaning), Some(ObjectRole::Actual)) => {
            let value = |raw| crate::profile::as_integer(&field.data_type.decode_raw(raw)).unwrap_or(0);
            value(before).abs_diff(value(now)) >= full_scale(meaning, field.bits) / SHARE
                || meaning.value_label(&field.data_type.decode_raw(now)).is_some()
        }
        _ => true,
    }
}

/// Largest raw value of a field.
fn full_scale(meaning: &ObjectMeaning, bits: u16) -> u64 {
    match (meaning.range, meaning.limits, meaning.scale) {
        (Some([least, most]), ..) => least.unsigned_abs().max(most.unsigned_abs()),
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        (None, Some([least, most]), Some(scale)) if scale.factor != 0.0 && !scale.is_reciprocal => {
            (least.abs().max(most.abs()) / scale.factor.abs()) as u64
        }
        _ => 1 << bits.saturating_sub(1).min(15),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::frame::MAX_DATA;
    use crate::profile::DataType;
    use crate::wire::canopen::ObjectAddress;
    use crate::wire::j1939::J1939Id;

    fn layout(roles: [Option<ObjectRole>; 2]) -> PayloadLayout {
        let field = |bit, role| SignalField {
            meaning: Some(Arc::new(ObjectMeaning {
                role,
                range: Some([-16384, 16384]),
                ..ObjectMeaning::default()
            })),
            ..SignalField::of_object(ObjectAddress::new(0x6041, 0), bit, 16, DataType::Integer16)
        };
        let [first, second] = roles;
        PayloadLayout {
            fields: vec![field(0, first), field(16, second)],
            bits: 32,
            ..PayloadLayout::default()
        }
    }

    #[test]
    fn a_measured_value_is_new_after_a_change_of_one_hundredth() {
        let mut news = PrintedPayloads::default();
        let layout = layout([Some(ObjectRole::Status), Some(ObjectRole::Actual)]);
        let mut is_new = |payload: [u8; 4]| {
            news.is_news(BusIndex(0), CanId::from_standard(0x181), Some(&layout), &payload)
        };
        assert!(is_new([0, 0, 0, 0]));
        assert!(!is_new([1, 0, 100, 0]), "the status has a line of its own, 100 of 16384 is little");
        assert!(!is_new([1, 0, 160, 0]));
        assert!(is_new([1, 0, 164, 0]), "163 is a hundredth of 16384");
        assert!(!is_new([1, 0, 100, 0]));
    }

    #[test]
    fn only_the_first_unknown_message_is_new() {
        let mut news = PrintedPayloads::default();
        let mut is_new = |layout: Option<PayloadLayout>, first| {
            let mut bytes = [0; MAX_DATA];
            bytes[0] = first;
            news.is_message_news(
                BusIndex(0),
                &J1939Message {
                    id: J1939Id::from_identifier(0x18FE_F100).unwrap(),
                    can_id: CanId::from_extended(0x18FE_F100 + u32::from(layout.is_some())),
                    name: None,
                    length: 8,
                    bytes,
                    layout: layout.map(Arc::new),
                },
            )
        };
        assert!(is_new(None, 1) && !is_new(None, 2));
        let measured = || Some(layout([None, None]));
        assert!(is_new(measured(), 0) && !is_new(measured(), 163 - 1) && is_new(measured(), 163));
    }
}
