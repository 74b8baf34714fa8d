//! Text of EMCY messages.

use std::io::Write as _;

use super::LineTone;
use super::node::evidence_text;
use super::parts::push_bytes;
use crate::ascii::{push_code, push_decimal};
use crate::event::{BootCause, EmcyAction, Emergency};
use crate::profile::{self, DeviceProfile};

/// Appends the text; returns the KIND column and the tone.
pub(super) fn push_words(
    emergency: &Emergency,
    device: &DeviceProfile,
    out: &mut Vec<u8>,
) -> (&'static str, LineTone) {
    let Some(code) = emergency.code else {
        out.extend_from_slice(b"empty EMCY message: started without error");
        match emergency.boot {
            Some(BootCause::Commanded { frame }) => {
                // Writing to a vector cannot fail.
                let _ = write!(out, ", after NMT reset{}", evidence_text(frame));
            }
            Some(BootCause::PresumedPowerOn { .. }) => {
                out.extend_from_slice(", no NMT reset before → power cycle or self-reset".as_bytes());
            }
            None => {}
        }
        return ("READY", LineTone::Good);
    };
    let tone = match emergency.action {
        EmcyAction::NoErrorAtBoot => {
            out.extend_from_slice(b"0000 no error, sent at boot-up (not a recovery)");
            LineTone::Plain
        }
        EmcyAction::AllCleared => {
            out.extend_from_slice(b"0000 all errors cleared");
            LineTone::Good
        }
        EmcyAction::Cleared => {
            out.extend_from_slice(b"0000 error cleared, register still ");
            push_register(emergency.register.unwrap_or(0), out);
            LineTone::Caution
        }
        EmcyAction::Raised | EmcyAction::Ready => {
            push_error(code, emergency, device, out);
            LineTone::Bad
        }
    };
    ("EMCY", tone)
}

fn push_error(code: u16, emergency: &Emergency, device: &DeviceProfile, out: &mut Vec<u8>) {
    push_code(out, u32::from(code), 4);
    out.push(b' ');
    out.extend_from_slice(device.error_text(code).as_bytes());
    if let Some(reaction) = device.error_entry(code).and_then(|error| error.reaction.as_ref()) {
        // Writing to a vector cannot fail.
        let _ = write!(out, " → {reaction}");
    }
    if let Some(register) = emergency.register {
        out.extend_from_slice(b", register ");
        push_register(register, out);
    }
    let vendor = emergency.vendor.get(..usize::from(emergency.vendor_length)).unwrap_or_default();
    if vendor.iter().any(|byte| *byte != 0) {
        push_vendor(vendor, device, out);
    }
    if let Some(other) = emergency.alternative {
        out.extend_from_slice(b", byte-swapped ");
        push_code(out, u32::from(other), 4);
        let text = device.error_entry(other).map_or("", |error| error.text.as_str());
        // Writing to a vector cannot fail.
        let _ = write!(out, " {text}");
    }
    if emergency.active > 1 {
        out.extend_from_slice(b", ");
        push_decimal(out, u64::from(emergency.active));
        out.extend_from_slice(b" active");
    }
}

/// Appends the manufacturer-specific bytes, by name if the profile defines names, else as hex.
fn push_vendor(vendor: &[u8], device: &DeviceProfile, out: &mut Vec<u8>) {
    let mut named = false;
    for field in &device.emcy.vendor {
        if let Some(value) = field.vendor_number(vendor) {
            named = true;
            // Writing to a vector cannot fail.
            let _ = write!(out, ", {} {value}", field.name);
        }
    }
    if !named {
        out.extend_from_slice(b", vendor ");
        push_bytes(out, vendor);
    }
}

/// Appends `05 (generic, voltage)`.
fn push_register(register: u8, out: &mut Vec<u8>) {
    push_code(out, u32::from(register), 2);
    let mut separator: &[u8] = b" (";
    for name in profile::error_register().set_names(u32::from(register)) {
        out.extend_from_slice(separator);
        out.extend_from_slice(name.as_bytes());
        separator = b", ";
    }
    if separator == b", " {
        out.push(b')');
    }
}
