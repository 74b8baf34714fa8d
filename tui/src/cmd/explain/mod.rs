//! `cobscope explain`: what a code, an identifier, an object or one pasted frame means.

mod asked;
mod code;
mod frame;
mod identifier;
mod j1939;
mod object;
mod uds;

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use cobscope_decoder::profile::{self, Device, ProfileError};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::output::print;
use super::rules;
use crate::exit_code::Exit;
use asked::Asked;

/// Largest identifier of 29 bits.
const LAST_IDENTIFIER: u32 = 0x1FFF_FFFF;

/// The forms that are understood, for who gave another one.
const FORMS: &str = "expected a rule (node-lost; cobscope rules lists them), an SDO abort code (06020000), an EMCY code (8130), an object (1018:01, 1018sub1, \
                     1018h:01h), a COB-ID (185), a 29-bit identifier (18FECA80), a group (pgn:65226), a J1939 fault \
                     (298985/19: SPN/FMI), a UDS response code (nrc:31) or identifier (did:F190), or a frame (701#05)";

/// Runs the command: every reading that fits, the likeliest first.
pub fn run(thing: &str, device: Option<&str>, profiles: &[PathBuf]) -> Exit {
    let catalogue = super::input::catalogue(profiles);
    let device: Option<Arc<Device>> = match device.map(|device| catalogue.device(device)).transpose() {
        Ok(device) => device,
        Err(error) => return refuse(&error),
    };
    let thing = thing.trim();
    if let Some(rule) = rules::find(&catalogue, thing) {
        return print(rules::page(&rule).as_bytes());
    }
    let asked = Asked { catalogue, device };
    let readings = if thing.contains('#') {
        frame::frame(thing, &asked).into_iter().collect()
    } else {
        code(thing, &asked)
    };
    if readings.is_empty() {
        let shown = thing.escape_debug();
        let text = match rules::meant(&asked.catalogue, thing) {
            Some(rule) => format!("there is no rule '{shown}'; did you mean '{rule}'?"),
            None => format!("cannot read \"{shown}\": {FORMS}"),
        };
        let _ = writeln!(std::io::stderr(), "cobscope: explain: {text}");
        return Exit::Usage;
    }
    print(readings.join("\n").as_bytes())
}

/// A device that is not there is a mistake of the user, a broken profile one of the file.
fn refuse(error: &ProfileError) -> Exit {
    let is_broken = matches!(error, ProfileError::Broken { .. });
    let list = if is_broken { "" } else { " (cobscope profiles list)" };
    let text = error.to_string();
    let lines: Vec<_> = text.lines().map(escape).collect();
    let _ = writeln!(std::io::stderr(), "cobscope: {}{list}", lines.join("\n"));
    if is_broken { Exit::Profile } else { Exit::Usage }
}

/// The readings of something without `#`.
fn code(thing: &str, asked: &Asked) -> Vec<String> {
    if let Some(reading) = uds::named(thing, asked) {
        return vec![reading];
    }
    if let Ok(address) = thing.parse::<ObjectAddress>()
        && (thing.contains(':') || thing.contains("sub"))
    {
        return vec![object::entry(asked, address)];
    }
    if let Some(reading) = j1939::fault(asked, thing).or_else(|| j1939::parameter_group(asked, thing)) {
        return vec![reading];
    }
    let digits = thing.strip_prefix("0x").or_else(|| thing.strip_prefix("0X")).unwrap_or(thing);
    let digits = digits.strip_suffix(['h', 'H']).unwrap_or(digits);
    let Ok(number) = u32::from_str_radix(digits, 16) else { return Vec::new() };
    match (u16::try_from(number), digits.len()) {
        (Ok(id), ..=3) if id <= 0x7FF => vec![identifier::identifier(id)],
        (Ok(number), 4) => four_digits(number, asked),
        // A number that is no abort code of the standard is likelier a pasted identifier.
        (_, 8) if profile::abort_codes().find(number).is_none() && number <= LAST_IDENTIFIER => {
            let is_abort = code::may_be_abort(asked, number);
            let abort = is_abort.then(|| code::abort(asked, number));
            j1939::identifier(number).into_iter().chain(abort).collect()
        }
        _ => vec![code::abort(asked, number)],
    }
}

/// Four digits can be an object, an EMCY code, or an identifier with a zero in front.
fn four_digits(number: u16, asked: &Asked) -> Vec<String> {
    let is_object = asked.knows_index(number);
    let of_standard = (0x1000..0x2000).contains(&number);
    let object = object::index(asked, number);
    let identifier = (number <= 0x7FF).then(|| identifier::identifier(number));
    // The class of a code says little beside an object that the device has.
    let Some(code) = code::emcy(asked, number, is_object) else {
        return [Some(object), identifier].into_iter().flatten().collect();
    };
    let readings = match (is_object || of_standard, asked.device.is_some()) {
        (true, _) => [Some(object), Some(code), identifier],
        // That the device has no such object is known once its code is.
        (false, true) => [Some(code), identifier, None],
        (false, false) => [Some(code), Some(object), identifier],
    };
    readings.into_iter().flatten().collect()
}
