//! `cobscope explain`: explains a code, an identifier, an object, a frame or a rule.

mod asked;
mod code;
mod frame;
mod identifier;
mod j1939;
mod object;
mod uds;

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use cobscope_decoder::conclusion::find_hypothesis;
use cobscope_decoder::profile::{self, Catalogue, DeviceProfile, ProfileError};
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::rules;
use crate::exit_code::ExitStatus;
use crate::run::arguments::examples;
use crate::run::input::load_catalogue;
use crate::run::messages::{print_note, print_warning};
use crate::run::output::print_text;
use asked::LookupScope;

/// Largest 29-bit identifier.
const LAST_IDENTIFIER: u32 = 0x1FFF_FFFF;

/// Error text with all accepted forms.
const FORMS: &str = "expected a rule (node-lost; see cobscope rules), a conclusion (nodes-restarted), an SDO abort code (06020000), an EMCY code (8130), an object (1018:01, 1018sub1, \
                     1018h:01h), a COB-ID (185), a 29-bit identifier (18FECA80), a PGN (pgn:65226), a J1939 fault \
                     (298985/19: SPN/FMI, or 938FE9: its three bytes in either order), a UDS response code (nrc:31) or identifier (did:F190), or a frame (701#05, \
                     or a line of any capture)";

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope explain 06090030",
    "cobscope explain 601#2B171000E8030000",
    "cobscope explain 8102 --device rexroth-sydfec",
];

/// Explain a code, an identifier, an object, a frame or a rule
///
/// THING is a rule (node-lost, rexroth-sydfec:NAME; see cobscope rules), a conclusion (nodes-restarted; see
/// docs/diagnosis.md), an SDO abort code (06020000), an EMCY error code (8130), an object (1018:01, 0x1018:01, 1018h:01h, 1018sub1), a COB-ID (185), a 29-bit
/// identifier (18FECA80), a J1939 PGN (pgn:65226, pgn:0xFECA), a J1939 fault (298985/19: SPN/FMI; 938FE9: as a
/// number or as sent), a UDS
/// response code (nrc:31) or identifier (did:F190), or a frame: in candump's log form (701#05), or a line of any capture
/// ("601 40 41 60 00 00 00 00 00").
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ExplainArgs {
    /// Code, identifier, object, frame or rule to explain
    pub thing: String,
    /// Add the text of the manual of a device: rexroth-sydfec, wandfluh-md2:controller
    #[arg(long, value_name = "PROFILE")]
    pub device: Option<String>,
    /// Add a folder with profiles (repeatable)
    #[arg(long, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
}

/// Runs the command. Prints all possible meanings, most likely first.
pub fn run(arguments: &ExplainArgs) -> ExitStatus {
    let catalogue = load_catalogue(&arguments.profiles);
    let device = arguments.device.as_deref().map(|device| catalogue.device(device)).transpose();
    let device: Option<Arc<DeviceProfile>> = match device {
        Ok(device) => device,
        Err(error) => return report_refusal(&error),
    };
    match find_meanings(&arguments.thing, catalogue, device) {
        Ok(text) => print_text(text.as_bytes()),
        Err(text) => {
            print_note(&format!("explain: {text}"));
            ExitStatus::Usage
        }
    }
}

/// All possible meanings, most likely first.
///
/// # Errors
/// The text has none.
pub(super) fn find_meanings(
    thing: &str,
    catalogue: Catalogue,
    device: Option<Arc<DeviceProfile>>,
) -> Result<String, String> {
    let asked = LookupScope { catalogue, device };
    let thing = thing.trim();
    if let Some(rule) = rules::find_rule(&asked.catalogue, thing) {
        return Ok(rules::rule_page(&rule));
    }
    if let Some(row) = find_hypothesis(thing) {
        return Ok(format!("{}  {}\n\n{}\n", row.id, row.title, row.manual_text()));
    }
    let mut readings = if thing.contains('#') {
        frame::explain_frame(thing, &asked).into_iter().collect()
    } else {
        explain_code(thing, &asked)
    };
    if readings.is_empty() && thing.contains(char::is_whitespace) {
        readings.extend(frame::explain_pasted(thing, &asked));
    }
    if !readings.is_empty() {
        return Ok(readings.join("\n"));
    }
    let shown = thing.escape_debug();
    Err(match rules::nearest_name(&asked.catalogue, thing) {
        Some(rule) => format!("unknown rule '{shown}'; did you mean '{rule}'?"),
        None => match frame::frame_defect(thing) {
            Some(defect) => format!("found \"{shown}\": {defect}"),
            None => format!("found \"{shown}\"; {FORMS}"),
        },
    })
}

/// Reports a profile error: an unknown profile is a usage error, an invalid one a profile error.
fn report_refusal(error: &ProfileError) -> ExitStatus {
    let is_broken = matches!(error, ProfileError::Broken { .. });
    let list = if is_broken { "" } else { " (cobscope profiles list)" };
    print_warning(&format!("{error}{list}"));
    if is_broken { ExitStatus::Profile } else { ExitStatus::Usage }
}

/// Explanations of a text without `#`.
fn explain_code(thing: &str, asked: &LookupScope) -> Vec<String> {
    if let Some(reading) = uds::explain_named(thing, asked) {
        return vec![reading];
    }
    if let Ok(address) = thing.parse::<ObjectAddress>()
        && (thing.contains(':') || thing.contains("sub"))
    {
        return vec![object::explain_entry(asked, address)];
    }
    if let Some(reading) = j1939::explain_fault(asked, thing).or_else(|| j1939::parameter_group(asked, thing))
    {
        return vec![reading];
    }
    let digits = thing.strip_prefix("0x").or_else(|| thing.strip_prefix("0X")).unwrap_or(thing);
    let digits = digits.strip_suffix(['h', 'H']).unwrap_or(digits);
    let Ok(number) = u32::from_str_radix(digits, 16) else { return Vec::new() };
    match (u16::try_from(number), digits.len()) {
        (Ok(id), ..=3) if id <= 0x7FF => vec![identifier::explain_identifier(id)],
        (Ok(number), 4) => four_digits(number, asked),
        // Six digits are too short for an abort code or a 29-bit identifier.
        (_, 6) => j1939::trouble_code(asked, digits),
        // A number outside the abort codes of the standard is more likely an identifier.
        (_, 8) if profile::abort_codes().find_code(number).is_none() && number <= LAST_IDENTIFIER => {
            let is_abort = code::may_be_abort(asked, number);
            let abort = is_abort.then(|| code::explain_abort(asked, number));
            let faults = j1939::trouble_code(asked, digits);
            faults.into_iter().chain(j1939::explain_identifier(number)).chain(abort).collect()
        }
        _ => {
            let faults = j1939::trouble_code(asked, digits);
            if faults.is_empty() { vec![code::explain_abort(asked, number)] } else { faults }
        }
    }
}

/// Explanations of four digits: an object, an EMCY error code, or an identifier with a leading zero.
fn four_digits(number: u16, asked: &LookupScope) -> Vec<String> {
    let is_object = asked.knows_index(number);
    let of_standard = (0x1000..0x2000).contains(&number);
    let object = object::explain_index(asked, number);
    let identifier = (number <= 0x7FF).then(|| identifier::explain_identifier(number));
    // The class of an EMCY error code is irrelevant if the device has an object with this index.
    let Some(code) = code::explain_emcy(asked, number, is_object) else {
        return [Some(object), identifier].into_iter().flatten().collect();
    };
    let readings = match (is_object || of_standard, asked.device.is_some()) {
        (true, _) => [Some(object), Some(code), identifier],
        // If the code is known, the missing object is irrelevant.
        (false, true) => [Some(code), identifier, None],
        (false, false) => [Some(code), Some(object), identifier],
    };
    readings.into_iter().flatten().collect()
}
