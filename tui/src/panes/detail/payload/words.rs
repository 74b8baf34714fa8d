//! Texts for raw numbers of a service: commands, states, objects, codes.

use cobscope_decoder::profile::{
    Device, abort_codes, emcy_codes, error_register, failure_modes, lss, pgn_name, uds,
};
use cobscope_decoder::wire::canopen::{NmtState, ObjectAddress, nmt};
use cobscope_decoder::wire::j1939::Pgn;

use super::{PayloadPlace, RESPONSE, number};
use crate::panes::detail::services::Read;

impl PayloadPlace<'_> {
    /// Text of a raw number.
    pub(super) fn words(&self, read: Read, bits: u16, raw: u64, bytes: &[u8]) -> String {
        let digits = usize::from(bits.div_ceil(4));
        let small = u32::try_from(raw).unwrap_or(u32::MAX);
        let byte = u8::try_from(raw).unwrap_or(u8::MAX);
        let device = self.node.map(|node| &**node.device());
        match read {
            Read::Number | Read::Bytes => raw.to_string(),
            Read::Hex => format!("{raw:0digits$X}h"),
            Read::Names(names) => {
                let name = names.iter().find(|(value, _)| *value == raw);
                name.map_or_else(|| format!("{raw}, reserved"), |(_, name)| format!("{raw} {name}"))
            }
            Read::NmtCommand => {
                let service = nmt::parse(&[byte, 0]).map(|command| command.service.name());
                format!("{raw:02X}h {}", service.unwrap_or("unknown"))
            }
            Read::NmtState => {
                let state = NmtState::from_code(byte).map_or("undefined", NmtState::name);
                format!("{raw:02X}h {state}")
            }
            Read::EmcyCode => {
                let code = u16::try_from(raw).unwrap_or(0);
                let text = device.map_or_else(|| plain_error(code), |device| device.error_text(code));
                format!("{raw:04X}h {text}")
            }
            Read::Register => {
                let names: Vec<_> = error_register().texts(small).collect();
                format!("{raw:02X}h {}", names.join(", "))
            }
            Read::Object => self.object(raw),
            Read::Abort => {
                let object = number(8, 24).extract(bytes).map(address);
                format!("{raw:08X}h {}", abort_text(device, small, object))
            }
            Read::Lss => format!("{raw:02X}h {}", lss().title(byte)),
            Read::Group => {
                let name = pgn_name(Pgn::new(small)).map_or(String::new(), |name| format!(" {name}"));
                format!("{raw}{name}")
            }
            Read::UdsService => uds_service(byte),
            Read::UdsCode => {
                format!("{raw:02X}h {}", uds().code(byte).map_or("unknown code", |code| code.text.as_str()))
            }
            Read::UdsIdentifier => {
                let name = uds().identifier(u16::try_from(raw).unwrap_or(0)).unwrap_or_default();
                format!("{raw:0digits$X}h {name}").trim_end().to_owned()
            }
            Read::FailureMode => format!("{raw} {}", failure_modes().text(small)),
        }
    }

    /// `6040:00 Controlword`.
    fn object(&self, raw: u64) -> String {
        let object = address(raw);
        let name = self.node.and_then(|node| node.meaning(object)).map(|meaning| meaning.name);
        name.map_or_else(|| object.to_string(), |name| format!("{object} {name}"))
    }
}

/// Object of a 24-bit number: index in the two low bytes, sub-index in the third.
fn address(raw: u64) -> ObjectAddress {
    let [low, high, sub, ..] = raw.to_le_bytes();
    ObjectAddress::new(u16::from_le_bytes([low, high]), sub)
}

pub(super) fn uds_service(code: u8) -> String {
    let table = uds().service(code & !RESPONSE);
    let kind = if code & RESPONSE == 0 { "" } else { ", positive response" };
    format!("{code:02X}h {}{kind}", table.map_or("unknown service", |service| service.title.as_str()))
}

fn plain_error(code: u16) -> &'static str {
    emcy_codes().text(u32::from(code))
}

/// Text of an abort code: of the standard, and of the manual if it differs.
pub(in crate::panes::detail) fn abort_text(
    device: Option<&Device>,
    code: u32,
    object: Option<ObjectAddress>,
) -> String {
    let standard = abort_codes().text(code);
    match device.and_then(|device| device.abort(code, object)) {
        Some(own) if own.text != standard => format!("{standard}; manual: {}", own.text),
        _ => standard.to_owned(),
    }
}
