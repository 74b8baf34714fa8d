//! Which PDOs of a known device are worth a line: set points, states and bits have lines of their own, and
//! measured values always move a little.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{Event, Pdo};
use crate::frame::{BusIndex, CanId};
use crate::profile::{Field, Meaning, Role};

/// A measured value is news when it moved by this part of its full scale.
const SHARE: u64 = 100;

/// Identifiers remembered; those beyond are printed whenever they change.
const MOST: usize = 4096;

/// What was printed last, by bus and identifier.
#[derive(Debug, Default)]
pub(super) struct News {
    printed: HashMap<(BusIndex, CanId), Box<[u8]>, FixedState>,
}

impl News {
    /// Whether a PDO that changed says something no other line says. What it is compared with is the
    /// last one that did.
    pub(super) fn is_news(&mut self, event: &Event, pdo: &Pdo) -> bool {
        let Some(layout) = pdo.layout.as_deref().filter(|_| !pdo.is_request) else { return true };
        let role = |field: &Field| field.meaning.as_deref().and_then(|meaning| meaning.role);
        if !layout.fields.iter().any(|field| role(field).is_some()) {
            return true;
        }
        let key = (event.bus, pdo.cob_id);
        let payload = pdo.payload();
        let news = match self.printed.get(&key) {
            None => true,
            Some(before) if before.len() != payload.len() => true,
            Some(before) => layout.fields.iter().any(|field| moved(field, before, payload)),
        };
        if news && (self.printed.len() < MOST || self.printed.contains_key(&key)) {
            self.printed.insert(key, payload.into());
        }
        news
    }
}

/// Whether a field changed in a way that no other line tells.
fn moved(field: &Field, before: &[u8], now: &[u8]) -> bool {
    let (before, now) = (field.extract(before), field.extract(now));
    let (Some(before), Some(now)) = (before, now) else { return before != now };
    if before == now {
        return false;
    }
    match field.meaning.as_deref() {
        Some(meaning) if meaning.role == Some(Role::SetPoint) => false,
        Some(meaning) if meaning.role == Some(Role::Status) => false,
        Some(meaning) if meaning.role == Some(Role::Actual) => {
            let value = |raw| crate::profile::integer(&field.data_type.number(raw)).unwrap_or(0);
            value(before).abs_diff(value(now)) >= full_scale(meaning, field.bits) / SHARE
                || meaning.label(&field.data_type.number(now)).is_some()
        }
        _ => true,
    }
}

/// Largest raw number of a value.
fn full_scale(meaning: &Meaning, bits: u16) -> u64 {
    match (meaning.range, meaning.limits, meaning.scale) {
        (Some([least, most]), ..) => least.unsigned_abs().max(most.unsigned_abs()),
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        (None, Some([least, most]), Some(scale)) if scale.factor != 0.0 => {
            (least.abs().max(most.abs()) / scale.factor.abs()) as u64
        }
        _ => 1 << bits.saturating_sub(1).min(15),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::event::{EventKind, FrameRange, Protocol};
    use crate::frame::MAX_DATA;
    use crate::profile::{DataType, Layout, PdoDirection, PdoName};
    use crate::wire::canopen::ObjectAddress;

    fn event(payload: [u8; 4]) -> Event {
        let field = |bit, role| Field {
            meaning: Some(Arc::new(Meaning {
                role: Some(role),
                range: Some([-16384, 16384]),
                ..Meaning::default()
            })),
            ..Field::of_object(ObjectAddress::new(0x6041, 0), bit, 16, DataType::Integer16)
        };
        let layout = Layout {
            fields: vec![field(0, Role::Status), field(16, Role::Actual)],
            bits: 32,
            ..Layout::default()
        };
        let mut bytes = [0; MAX_DATA];
        bytes[..4].copy_from_slice(&payload);
        Event {
            time: None,
            bus: BusIndex(0),
            frames: FrameRange::one(1),
            protocol: Protocol::Canopen,
            node: Some(1.into()),
            presumed: false,
            routine: false,
            kind: EventKind::Pdo(Pdo {
                name: PdoName { direction: PdoDirection::Transmit, number: 1 },
                cob_id: CanId::standard(0x181),
                is_request: false,
                length: 4,
                bytes,
                layout: Some(Arc::new(layout)),
            }),
        }
    }

    #[test]
    fn a_measured_value_is_news_when_it_moved_by_a_hundredth_since_the_last_line() {
        let mut news = News::default();
        let mut tell = |payload| {
            let event = event(payload);
            let EventKind::Pdo(pdo) = &event.kind else { unreachable!() };
            news.is_news(&event, pdo)
        };
        assert!(tell([0, 0, 0, 0]));
        assert!(!tell([1, 0, 100, 0]), "the status has a line of its own, 100 of 16384 is little");
        assert!(!tell([1, 0, 160, 0]));
        assert!(tell([1, 0, 164, 0]), "163 is a hundredth of 16384");
        assert!(!tell([1, 0, 100, 0]));
    }
}
