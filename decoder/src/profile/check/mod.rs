//! Semantic checks of a profile: types, ranges, references, cycles, duplicates.
//!
//! `samples/` runs the samples, because they need the decoder.

mod behaviour;
mod ids;
mod objects;
mod rules;
mod uds;

use std::ops::Range;

use strum::VariantArray as _;

pub use ids::check_ids;

use super::authored::TextProblem;
use super::data_type::DataType;
use super::device::{DeviceProfile, MessageSpec, PdoField, PdoTrigger, ProfileFile};
use super::entry::ObjectEntry;
use super::formula::evaluate_formula;
use super::layout::PdoName;
use super::object::VariantFilter;
use super::position::TextError;
use super::reference::ObjectReference;
use crate::wire::canopen::ObjectAddress;

/// Max payload of a classic CAN frame, in bits.
const FRAME_BITS: u16 = 64;

/// Max payload of a J1939 multi-packet message, in bits (J1939-21 §5.10).
const MESSAGE_BITS: u16 = 1_785 * 8;

/// Largest parameter group number, 18 bits.
const LAST_PGN: u32 = 0x3_FFFF;

/// Triggers of a TPDO; `rpdo` is the reception of the RPDO with the same number.
/// Max entries of a profile, including repeats: more than four times the entries defined in CiA 301.
const MOST_ENTRIES: usize = 1 << 20;

/// All problems of one device variant; `text` is the text of its profile.
pub fn check_device(text: &str, file: &ProfileFile, device: &DeviceProfile) -> Vec<TextError> {
    let mut check = ProfileCheck { device, variants: file, wrong: Vec::new() };
    let entries = device.object_count();
    if let Some(largest) = device.dictionary.own_objects().iter().max_by_key(|object| object.entry_count())
        && entries > MOST_ENTRIES
    {
        let message = format!("{entries} dictionary entries; expected max {MOST_ENTRIES}");
        return vec![TextError::at_place(text, largest.span.clone(), message)];
    }
    check.check_objects(device.dictionary.own_objects());
    check.check_duplicates(device.dictionary.own_objects());
    check.check_cycles(device.dictionary.own_objects());
    check.check_pdos();
    check.check_behaviour();
    check.check_rules();
    check.check_uds();
    check.wrong.sort_by_key(|(span, _)| span.start);
    check.wrong.dedup();
    check.wrong.into_iter().map(|(span, message)| TextError::at_place(text, span, message)).collect()
}

/// Whether a name contains only lower-case letters, digits and hyphens, as in options and JSON.
fn is_kebab(name: &str) -> bool {
    let is_part = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    !name.is_empty() && name.bytes().all(is_part)
}

struct ProfileCheck<'a> {
    device: &'a DeviceProfile,
    variants: &'a ProfileFile,
    wrong: Vec<TextProblem>,
}

impl ProfileCheck<'_> {
    fn report_problem(&mut self, span: &Range<usize>, message: impl Into<String>) {
        self.wrong.push((span.clone(), message.into()));
    }

    fn check_variants(&mut self, only: &VariantFilter, span: &Range<usize>) {
        for id in &only.0 {
            if !self.variants.variants().iter().any(|variant| variant.id == *id) {
                self.report_problem(span, format!("unknown variant '{id}'"));
            }
        }
    }

    /// Checks that a reference in a repeated object leads to a described object in each repeat.
    fn check_reference(
        &mut self,
        reference: ObjectReference,
        object: &ObjectEntry,
        span: &Range<usize>,
        key: &str,
    ) {
        for nth in 0..object.repeat.count {
            let address = reference.shift_object(nth, object.repeat.stride);
            if !self.is_known(address) {
                return self.report_problem(span, format!("{key}: unknown object {address}"));
            }
        }
    }

    fn is_known(&self, address: ObjectAddress) -> bool {
        self.device.dictionary.find_object(address).is_some_and(|found| found.entry.is_some())
    }

    fn check_known(&mut self, reference: ObjectReference, span: &Range<usize>, key: &str) {
        if !self.is_known(reference.object) {
            self.report_problem(span, format!("{key}: unknown object {}", reference.object));
        }
    }

    fn check_pdos(&mut self) {
        let device = self.device;
        let mut ended: Vec<PdoName> = Vec::new();
        for (pdo, span) in device.pdos.iter().zip(&device.places.pdos) {
            if ended.contains(&pdo.pdo) {
                self.report_problem(
                    span,
                    format!("{} is never used; the entry above has no `when`", pdo.pdo),
                );
            }
            if pdo.when.is_none() {
                ended.push(pdo.pdo);
            }
            if let Some(trigger) = pdo.trigger.as_deref().filter(|_| pdo.trigger().is_none()) {
                let known = PdoTrigger::VARIANTS.iter().map(|known| known.name());
                let known = known.collect::<Vec<_>>().join(", ");
                self.report_problem(
                    span,
                    format!("{}: unknown trigger '{trigger}'; expected one of {known}", pdo.pdo),
                );
            }
            let bits = self.check_fields(&pdo.fields, span);
            if bits > FRAME_BITS {
                self.report_problem(span, format!("{} has {bits} bits; expected max {FRAME_BITS}", pdo.pdo));
            }
        }
        for (message, span) in device.messages.iter().zip(&device.places.messages) {
            self.check_message(message, span);
        }
        for (pdo, span) in device.pdos.iter().zip(&device.places.pdos) {
            if !ended.contains(&pdo.pdo) {
                self.report_problem(
                    span,
                    format!("{}: every entry has a `when`; expected a last one without", pdo.pdo),
                );
                ended.push(pdo.pdo);
            }
        }
    }

    /// Checks consecutive fields; returns their total length in bits.
    fn check_fields(&mut self, fields: &[PdoField], span: &Range<usize>) -> u16 {
        for field in fields {
            let Some(object) = field.object else { continue };
            self.check_known(object, span, "field");
            let known = self.device.dictionary.data_type(object.object).and_then(DataType::bits);
            if field.bits == 0 || known.is_some_and(|known| known < field.bits) {
                self.report_problem(
                    span,
                    format!("{}: field of {} bits does not fit the object", object.object, field.bits),
                );
            }
        }
        fields.iter().fold(0_u16, |bits, field| bits.saturating_add(field.bits))
    }

    fn check_message(&mut self, message: &MessageSpec, span: &Range<usize>) {
        let name = &message.name;
        let bits = self.check_fields(&message.fields, span);
        if bits > MESSAGE_BITS {
            self.report_problem(span, format!("{name} has {bits} bits; expected max {MESSAGE_BITS}"));
        }
        let last = message.pgn.saturating_add(u32::from(message.count).saturating_sub(1));
        if message.count == 0 || last > LAST_PGN {
            self.report_problem(
                span,
                format!("{name}: pgn or count out of range; expected PGNs 0 to 0x{LAST_PGN:X}"),
            );
        }
        let address = self.device.j1939.addresses.map_or(0, |[first, _]| first);
        if let Some(number) = &message.number
            && evaluate_formula(number, Some(address)).is_none_or(|number| number >= u64::from(message.count))
        {
            self.report_problem(
                span,
                format!(
                    "{name}: number '{number}' at address {address}; expected a number < {}",
                    message.count
                ),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of a profile that extends CiA 301, without file name and excerpt.
    pub(super) fn errors(body: &str) -> Vec<String> {
        let text = format!("id = \"x\"\n{body}");
        let file = ProfileFile::parse(&text).unwrap();
        let device = file.build_device(None, &[super::super::plain_device().clone()]);
        check_device(&text, &file, &device).iter().map(|it| format!("{}: {}", it.line, it.message)).collect()
    }

    fn object(keys: &str) -> String {
        format!("[[object]]\nindex = 0x2000\nname = \"a\"\n{keys}\n")
    }

    #[test]
    fn ranges_defaults_and_names_fit_their_type() {
        assert_eq!(errors(&object("type = \"UNSIGNED8\"\nrange = [0, 255]\ndefault = 7")), [""; 0]);
        let wrong = errors(&object("type = \"UNSIGNED8\"\nrange = [-1, 256]"));
        assert_eq!(wrong, ["2: range -1 does not fit UNSIGNED8", "2: range 256 does not fit UNSIGNED8"]);
        let wrong = errors(&object("type = \"INTEGER16\"\nrange = [0, 5]\ndefault = 6"));
        assert_eq!(wrong, ["2: default 6 is outside range 0 to 5"]);
        let wrong = errors(&object("type = \"UNSIGNED8\"\nvalues = { 0x100 = \"x\" }"));
        assert_eq!(wrong, ["2: values 256 does not fit UNSIGNED8"]);
        let default = |text: &str| errors(&object(&format!("type = \"UNSIGNED16\"\ndefault = \"{text}\"")));
        assert_eq!(default("$NODEID+0x200"), [""; 0]);
        assert_eq!(default("$NODEID+0xFFFF"), ["2: default $NODEID+0xFFFF does not fit UNSIGNED16"]);
        assert_eq!(
            default("0x80+$NODE"),
            ["2: default '0x80+$NODE' is not a number; expected e.g. 5 or \"$NODEID+0x200\""]
        );
        assert_eq!(errors(&object("unit = \"bar\"")), ["2: type is missing; expected a data type"]);
    }

    #[test]
    fn a_mode_says_in_which_values_the_loop_is_open() {
        let mode = |keys: &str| errors(&object(&format!("type = \"INTEGER8\"\n{keys}")));
        let names = "values = { 1 = \"open\", 2 = \"closed\" }";
        assert_eq!(mode(&format!("role = \"mode\"\nopen_loop = [1]\n{names}")), [""; 0]);
        let wrong = mode(&format!("role = \"mode\"\nopen_loop = [3]\n{names}"));
        assert_eq!(wrong, ["2: open_loop 3 is not in values"]);
        let wrong = mode("open_loop = [128]");
        assert_eq!(
            wrong,
            [
                "2: open_loop requires role = \"mode\", \"control\" or \"status\"",
                "2: open_loop 128 does not fit INTEGER8"
            ]
        );
    }

    #[test]
    fn uds_identifiers_fit_their_type() {
        let identifier = |keys: &str| format!("[[uds.identifier]]\nid = 0x1001\nname = \"a\"\n{keys}\n");
        let whole = identifier("type = \"UNSIGNED8\"\nrange = [1, 127]\ndefault = 32");
        assert_eq!(errors(&whole), [""; 0]);
        assert_eq!(errors(&format!("{whole}{whole}")), ["8: duplicate UDS identifier 1001"]);
        let wrong = errors(&identifier("type = \"UNSIGNED8\"\nrange = [1, 127]\ndefault = 0"));
        assert_eq!(wrong, ["2: default 0 is outside range 1 to 127"]);
        let wrong = errors(&identifier("type = \"UNSIGNED8\"\nrange = [1, 256]"));
        assert_eq!(wrong, ["2: range or default 256 does not fit UNSIGNED8"]);
        assert_eq!(errors(&identifier("default = 1")), ["2: type is missing; expected a data type"]);
        assert_eq!(errors(&identifier("type = \"UNSIGNED8\"\nunit = \"x\"")), ["2: unknown unit 'x'"]);
    }

    #[test]
    fn bits_do_not_overlap() {
        let wrong = errors(&object(
            "type = \"UNSIGNED8\"\nbits = [{ bit = 0, width = 4, name = \"a\" }, { bit = 3, name = \"b\" }, { bit = 8, name = \"c\" }]",
        ));
        assert_eq!(wrong, ["2: duplicate entry for bit 3", "2: bits 8 to 8 do not fit UNSIGNED8"]);
    }

    #[test]
    fn bits_have_names_as_json_prints_them() {
        let bits = |list: &str| errors(&object(&format!("type = \"UNSIGNED8\"\nbits = [{list}]")));
        assert_eq!(bits("{ bit = 0, name = \"phase-2\" }, { bit = 1, reserved = true }"), [""; 0]);
        assert_eq!(
            bits("{ bit = 0, name = \"Over load\" }"),
            ["2: invalid bit name 'Over load'; expected a-z, 0-9 and hyphens"]
        );
    }

    #[test]
    fn pdos_are_triggered_by_what_there_is() {
        let pdo = |trigger: &str| {
            errors(&format!("[[pdo]]\npdo = \"TPDO1\"\nmapping = \"fixed\"\ntrigger = \"{trigger}\"\n"))
        };
        assert_eq!(pdo("timer"), [""; 0]);
        assert_eq!(
            pdo("timr"),
            ["2: TPDO1: unknown trigger 'timr'; expected one of sync, event, rpdo, timer, request"]
        );
    }

    #[test]
    fn objects_are_described_once() {
        let twice = "[[object]]\nindex = 0x2000\nname = \"a\"\ntype = \"UNSIGNED8\"\n\
                     [[object]]\nindex = 0x1FFE\nrepeat = { count = 3, stride = 1 }\nname = \"b\"\ntype = \"UNSIGNED8\"\n";
        assert_eq!(errors(twice), ["6: duplicate entry for 2000:00"]);
    }

    #[test]
    fn scales_do_not_depend_on_themselves() {
        let cycle = "[[object]]\nindex = 0x2000\nname = \"a\"\nsub = [\n\
            { sub = 1, name = \"b\", type = \"UNSIGNED8\", scale = { raw = 2, object = \"2000:02\" } },\n\
            { sub = 2, name = \"c\", type = \"UNSIGNED8\", scale = { raw = 2, object = \"2000:01\" } },\n\
            { sub = 3, name = \"d\", type = \"UNSIGNED8\", scale = { raw = 2, object = \"2000:09\" } },\n]\n";
        let wrong = errors(cycle);
        assert_eq!(wrong.len(), 3);
        assert_eq!(wrong[0], "6: the scale of 2000:01 depends on itself");
        assert_eq!(wrong[2], "8: scale: unknown object 2000:09");
    }

    #[test]
    fn pdos_hold_known_objects_and_end_with_a_default() {
        let pdo = "[[pdo]]\npdo = \"TPDO1\"\nmapping = \"fixed\"\n\
            fields = [{ object = \"1001:00\", bits = 16 }, { object = \"2000:00\", bits = 64 }]\n\
            when = { object = \"1000:00\", equals = 1 }\n";
        let wrong = errors(pdo);
        assert_eq!(wrong[0], "2: 1001:00: field of 16 bits does not fit the object");
        assert_eq!(wrong[1], "2: field: unknown object 2000:00");
        assert_eq!(wrong[2], "2: TPDO1 has 80 bits; expected max 64");
        assert_eq!(wrong[3], "2: TPDO1: every entry has a `when`; expected a last one without");
    }

    #[test]
    fn machines_and_procedures_name_what_there_is() {
        let machine = "[[machine]]\nname = \"m\"\nstatus = { object = \"1001:00\", mask = 1 }\n\
            control = { object = \"1001:00\", mask = 1 }\nstates = [{ name = \"A\", value = 0 }]\n\
            transitions = [{ from = \"A\", to = \"B\", mask = 1, value = 1 }]\n";
        assert_eq!(errors(machine), ["2: machine m has no state 'B'"]);
        let procedure = "[[procedure]]\nname = \"p\"\nstart = { write = \"1001:00\" }\n\
            status = { object = \"1001:00\", codes = \"none\" }\n";
        assert_eq!(errors(procedure), ["2: unknown table [codes.none]"]);
    }
}
