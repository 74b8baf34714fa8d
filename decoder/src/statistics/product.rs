//! Product data that a J1939 device sends about itself.

use crate::event::{Event, EventKind};
use crate::profile::{DecodedValue, SignalId};
use crate::wire::j1939::Pgn;

/// Longest text that is stored, in bytes; a message of NMEA 2000 has 32.
const LONGEST: usize = 128;

/// Suspect parameters of component, software and vehicle identification (J1939-71).
const MAKE: u32 = 586;
const MODEL: u32 = 587;
const SERIAL_NUMBER: u32 = 588;
const SOFTWARE: u32 = 234;
const VEHICLE: u32 = 237;

/// Product data of a device; the last message of each kind.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DeviceProduct {
    /// Make of the component.
    pub make: Option<String>,
    /// Model.
    pub model: Option<String>,
    /// Software identification or version.
    pub software: Option<String>,
    /// Serial number.
    pub serial_number: Option<String>,
    /// Vehicle identification number.
    pub vehicle: Option<String>,
}

impl DeviceProduct {
    /// Stores the texts of an identification message.
    pub(super) fn take_event(&mut self, event: &Event) {
        let pgn = match &event.kind {
            EventKind::J1939Message(message) => message.id.pgn,
            EventKind::J1939Transfer(transfer) => match transfer.pgn {
                Some(pgn) => pgn,
                None => return,
            },
            _ => return,
        };
        if !is_identification(pgn) {
            return;
        }
        let texts = event.decode_signals().filter_map(|signal| match signal.value {
            DecodedValue::Text(text) => Some((signal.field.id, text)),
            _ => None,
        });
        for (number, (id, text)) in texts.enumerate() {
            let Some(place) = self.place_of(id, number) else { continue };
            let text = text.trim();
            if !text.is_empty() && text.len() <= LONGEST {
                *place = Some(text.to_owned());
            }
        }
    }

    /// Place of a text: by its SPN, or by its number in the product information of NMEA 2000.
    fn place_of(&mut self, id: SignalId, number: usize) -> Option<&mut Option<String>> {
        match (id, number) {
            (SignalId::Spn(MAKE), _) => Some(&mut self.make),
            (SignalId::Spn(MODEL), _) | (SignalId::Name, 0) => Some(&mut self.model),
            (SignalId::Spn(SOFTWARE), _) | (SignalId::Name, 1) => Some(&mut self.software),
            (SignalId::Spn(SERIAL_NUMBER), _) | (SignalId::Name, 3) => Some(&mut self.serial_number),
            (SignalId::Spn(VEHICLE), _) => Some(&mut self.vehicle),
            _ => None,
        }
    }

    /// Make, model and software: `RS80, software 01000_E`; empty if nothing is known.
    pub fn describe(&self) -> String {
        let software = self.software.as_ref().map(|software| format!("software {software}"));
        let parts = [self.make.clone(), self.model.clone(), software];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

/// Whether a group identifies the sender: product information of NMEA 2000; component, vehicle and software
/// identification of J1939-71.
const fn is_identification(pgn: Pgn) -> bool {
    matches!(pgn.number(), 126_996 | 65_259 | 65_260 | 65_242)
}
