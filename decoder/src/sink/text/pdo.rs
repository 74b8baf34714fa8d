//! The words of a PDO: most lines are one, so they are written without the formatting machinery.

use std::io::Write as _;

use super::line::push_bytes;
use crate::event::Pdo;
use crate::profile::{PdoDirection, Signal, Value};
use crate::sink::ascii::{push_code, push_decimal, push_integer};

/// Appends `TPDO1 37 06: 6041:00=1591`.
pub(super) fn push_words(pdo: &Pdo, out: &mut Vec<u8>) {
    out.extend_from_slice(match pdo.name.direction {
        PdoDirection::Transmit => b"TPDO",
        PdoDirection::Receive => b"RPDO",
    });
    push_decimal(out, u64::from(pdo.name.number));
    if pdo.is_request {
        return out.extend_from_slice(b" requested by remote frame");
    }
    out.push(b' ');
    let payload = pdo.payload();
    push_bytes(out, payload);
    let Some(layout) = &pdo.layout else { return };
    let mut separator = b": ";
    for signal in layout.signals(payload) {
        out.extend_from_slice(separator);
        push_signal(&signal, layout.assumed, out);
        separator = b", ";
    }
    let needed = usize::from(layout.bits.div_ceil(8));
    if needed > payload.len() {
        // Writing to a vector cannot fail.
        let _ = write!(out, " (mapping needs {needed} bytes)");
    }
}

fn push_signal(signal: &Signal<'_>, assumed: bool, out: &mut Vec<u8>) {
    push_code(out, u32::from(signal.field.object.index), 4);
    out.push(b':');
    push_code(out, u32::from(signal.field.object.sub), 2);
    out.push(b'=');
    match signal.value {
        Value::Unsigned(value) => push_decimal(out, value),
        Value::Integer(value) => push_integer(out, value),
        _ => {
            // Writing to a vector cannot fail.
            let _ = write!(out, "{}", signal.value);
        }
    }
    if assumed {
        out.push(b'?');
    }
}
