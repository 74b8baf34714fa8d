//! Product data that a J1939 device sends about itself.

use crate::event::{Event, EventKind};
use crate::profile::DecodedValue;
use crate::wire::j1939::Pgn;

/// Longest text that is stored, in bytes; a message of NMEA 2000 has 32.
const LONGEST: usize = 128;

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
        for signal in event.decode_signals() {
            let (Some(name), DecodedValue::Text(text)) = (signal.name(), &signal.value) else { continue };
            let place = match name {
                "Make" => &mut self.make,
                "Model" | "Model ID" => &mut self.model,
                "Software Version Code" | "Software Identification" => &mut self.software,
                "Serial Number" | "Model Serial Code" => &mut self.serial_number,
                "Vehicle Identification Number" => &mut self.vehicle,
                _ => continue,
            };
            let text = text.trim();
            if !text.is_empty() && text.len() <= LONGEST {
                *place = Some(text.to_owned());
            }
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
