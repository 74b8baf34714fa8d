//! Texts for raw numbers of a service: commands, states, objects, codes.

use cobscope_decoder::profile::{
    DeviceProfile, abort_codes, emcy_codes, error_register, failure_modes, lss_names, pgn_name, uds_names,
};
use cobscope_decoder::wire::canopen::{NmtState, ObjectAddress, nmt};
use cobscope_decoder::wire::j1939::Pgn;

use super::{PayloadPlace, RESPONSE, plain_field};
use crate::panes::detail::services::FieldPresentation;

impl PayloadPlace<'_> {
    /// Text of a raw number.
    pub(super) fn number_text(&self, read: FieldPresentation, bits: u16, raw: u64, bytes: &[u8]) -> String {
        let digits = usize::from(bits.div_ceil(4));
        let small = u32::try_from(raw).unwrap_or(u32::MAX);
        let byte = u8::try_from(raw).unwrap_or(u8::MAX);
        let device = self.node.map(|node| &**node.device());
        match read {
            FieldPresentation::Number | FieldPresentation::Bytes => raw.to_string(),
            FieldPresentation::Hex => format!("{raw:0digits$X}h"),
            FieldPresentation::Names(names) => {
                let name = names.iter().find(|(value, _)| *value == raw);
                name.map_or_else(|| format!("{raw}, reserved"), |(_, name)| format!("{raw} {name}"))
            }
            FieldPresentation::NmtCommand => {
                let service = nmt::parse(&[byte, 0]).map(|command| command.service.name());
                format!("{raw:02X}h {}", service.unwrap_or("unknown"))
            }
            FieldPresentation::NmtState => {
                let state = NmtState::from_code(byte).map_or("undefined", NmtState::name);
                format!("{raw:02X}h {state}")
            }
            FieldPresentation::EmcyCode => {
                let code = u16::try_from(raw).unwrap_or(0);
                let text = device.map_or_else(|| plain_error(code), |device| device.error_text(code));
                format!("{raw:04X}h {text}")
            }
            FieldPresentation::Register => {
                let names: Vec<_> = error_register().set_texts(small).collect();
                format!("{raw:02X}h {}", names.join(", "))
            }
            FieldPresentation::Object => self.object_text(raw),
            FieldPresentation::Abort => {
                let object = plain_field(8, 24).extract_bits(bytes).map(object_address);
                format!("{raw:08X}h {}", abort_text(device, small, object))
            }
            FieldPresentation::Lss => format!("{raw:02X}h {}", lss_names().service_title(byte)),
            FieldPresentation::Group => {
                let name = pgn_name(Pgn::new(small)).map_or(String::new(), |name| format!(" {name}"));
                format!("{raw}{name}")
            }
            FieldPresentation::UdsService => uds_service(byte),
            FieldPresentation::UdsCode => {
                format!(
                    "{raw:02X}h {}",
                    uds_names().code_entry(byte).map_or("unknown code", |code| code.text.as_str())
                )
            }
            FieldPresentation::UdsIdentifier => {
                let name = uds_names().identifier_name(u16::try_from(raw).unwrap_or(0)).unwrap_or_default();
                format!("{raw:0digits$X}h {name}").trim_end().to_owned()
            }
            FieldPresentation::FailureMode => format!("{raw} {}", failure_modes().code_text(small)),
        }
    }

    /// `6040:00 Controlword`.
    fn object_text(&self, raw: u64) -> String {
        let object = object_address(raw);
        let name = self.node.and_then(|node| node.meaning(object)).map(|meaning| meaning.name);
        name.map_or_else(|| object.to_string(), |name| format!("{object} {name}"))
    }
}

/// Object of a 24-bit number: index in the two low bytes, sub-index in the third.
fn object_address(raw: u64) -> ObjectAddress {
    let [low, high, sub, ..] = raw.to_le_bytes();
    ObjectAddress::new(u16::from_le_bytes([low, high]), sub)
}

pub(super) fn uds_service(code: u8) -> String {
    let table = uds_names().service_by_id(code & !RESPONSE);
    let kind = if code & RESPONSE == 0 { "" } else { ", positive response" };
    format!("{code:02X}h {}{kind}", table.map_or("unknown service", |service| service.title.as_str()))
}

fn plain_error(code: u16) -> &'static str {
    emcy_codes().code_text(u32::from(code))
}

/// Text of an abort code: of the standard, and of the manual if it differs.
pub(in crate::panes::detail) fn abort_text(
    device: Option<&DeviceProfile>,
    code: u32,
    object: Option<ObjectAddress>,
) -> String {
    let standard = abort_codes().code_text(code);
    match device.and_then(|device| device.abort_entry(code, object)) {
        Some(own) if own.text != standard => format!("{standard}; manual: {}", own.text),
        _ => standard.to_owned(),
    }
}
