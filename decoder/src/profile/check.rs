//! What is wrong with a profile beyond its grammar: types, ranges, references, cycles, duplicates.
//!
//! Samples are run by `samples.rs`, which knows the decoder.

mod rules;
mod uds;

use std::collections::BTreeSet;
use std::ops::Range;

use super::authored::Wrong;
use super::data_type::DataType;
use super::device::{Condition, Device, Machine, MessageSpec, PdoField, ProfileFile, Trigger, Wanted};
use super::dictionary::{Dictionary, Entry, Object};
use super::formula::formula;
use super::layout::PdoName;
use super::names::{BitNames, Names};
use super::object::{Given, Look, Only, Role, Scale, When};
use super::position::TextError;
use super::reference::Reference;
use crate::wire::canopen::ObjectAddress;

/// Most bits a classic CAN frame holds.
const FRAME_BITS: u16 = 64;

/// Most bits of a J1939 message that travels in packets (J1939-21 §5.10).
const MESSAGE_BITS: u16 = 1_785 * 8;

/// Last parameter group, 18 bits.
const LAST_PGN: u32 = 0x3_FFFF;

/// Most entries of a profile, repeats counted: more than four times what CiA 301 describes.
const MOST_ENTRIES: usize = 1 << 20;

/// Most machines, gates, procedures or rules of a device, repeats counted.
const MOST_REPEATS: usize = 512;

/// Everything wrong with one variant of a device; `text` is the profile's.
pub fn check(text: &str, file: &ProfileFile, device: &Device) -> Vec<TextError> {
    let mut check = Check { device, variants: file, wrong: Vec::new() };
    let entries = device.object_count();
    if let Some(largest) = device.dictionary.own().iter().max_by_key(|object| object.count())
        && entries > MOST_ENTRIES
    {
        let message = format!("{entries} entries; a dictionary has at most {MOST_ENTRIES}");
        return vec![TextError::at(text, largest.span.clone(), message)];
    }
    check.objects(device.dictionary.own());
    check.duplicates(device.dictionary.own());
    check.cycles(device.dictionary.own());
    check.pdos();
    check.behaviour();
    check.rules();
    check.uds();
    check.wrong.sort_by_key(|(span, _)| span.start);
    check.wrong.dedup();
    check.wrong.into_iter().map(|(span, message)| TextError::at(text, span, message)).collect()
}

struct Check<'a> {
    device: &'a Device,
    variants: &'a ProfileFile,
    wrong: Vec<Wrong>,
}

impl Check<'_> {
    fn say(&mut self, span: &Range<usize>, message: impl Into<String>) {
        self.wrong.push((span.clone(), message.into()));
    }

    fn only(&mut self, only: &Only, span: &Range<usize>) {
        for id in &only.0 {
            if !self.variants.variants().iter().any(|variant| variant.id == *id) {
                self.say(span, format!("there is no variant '{id}'"));
            }
        }
    }

    fn objects(&mut self, objects: &[Object]) {
        for object in objects {
            self.only(&object.only, &object.span);
            for entry in &object.entries {
                self.only(&entry.only, &entry.span);
                self.entry(object, entry);
            }
        }
    }

    fn entry(&mut self, object: &Object, entry: &Entry) {
        let Some(data_type) = entry.data_type else {
            let plain = entry.look == Look { name: entry.look.name.clone(), ..Look::default() };
            if !plain || entry.default.is_some() {
                self.say(&entry.span, "a value that is described needs its type");
            }
            return;
        };
        self.look(object, entry, &entry.look, data_type);
        for (when, look) in &entry.modes {
            self.look(object, entry, look, data_type);
            self.when(object, entry, when);
        }
        if let Some(Given::Number(default)) = entry.default {
            self.number(default, data_type, "default", &entry.span);
            if let Some([least, most]) = entry.look.range
                && !(least..=most).contains(&default)
            {
                self.say(&entry.span, format!("default {default} lies outside range {least} to {most}"));
            }
        }
        if let Some(Given::Text(text)) = &entry.default
            && data_type.is_integer()
        {
            self.formula(text, data_type, &entry.span);
        }
        if let Some(save) = entry.save {
            self.known(save, &entry.span, "save");
        }
        self.open_loop(entry, data_type);
    }

    fn open_loop(&mut self, entry: &Entry, data_type: DataType) {
        if !entry.open_loop.is_empty() && entry.look.role != Some(Role::Mode) {
            self.say(&entry.span, "open_loop stands at a mode: role = \"mode\"");
        }
        for value in &entry.open_loop {
            self.number(*value, data_type, "open_loop", &entry.span);
            if entry.look.values.as_ref().is_some_and(|names| names.get(*value).is_none()) {
                self.say(&entry.span, format!("open_loop {value} is none of its values"));
            }
        }
    }

    /// A default that depends on the node-ID; that of node 127 is the largest.
    fn formula(&mut self, text: &str, data_type: DataType, span: &Range<usize>) {
        let bits = u32::from(data_type.bits().unwrap_or(64));
        match formula(text, Some(127)) {
            None => self.say(span, format!("default '{text}' is no number: write 5 or \"$NODEID+0x200\"")),
            Some(most) if most > u64::MAX >> (64 - bits) => {
                self.say(span, format!("default {text} does not fit {}", data_type.name()));
            }
            Some(_) => {}
        }
    }

    fn look(&mut self, object: &Object, entry: &Entry, look: &Look, data_type: DataType) {
        let span = &entry.span;
        if let Some([least, most]) = look.range {
            self.number(least, data_type, "range", span);
            self.number(most, data_type, "range", span);
            if least > most {
                self.say(span, format!("range {least} to {most} ends before it begins"));
            }
        }
        if let Some([least, most]) = look.limits
            && least > most
        {
            self.say(span, format!("limits {least} to {most} end before they begin"));
        }
        for (key, names) in [("values", &look.values), ("special", &look.special)] {
            self.names(names.as_deref(), data_type, key, span);
        }
        if let Some(bits) = &look.bits {
            self.bits(bits, data_type, span);
        }
        match look.scale {
            Some(Scale::Factor(0.0)) => self.say(span, "scale is 0"),
            Some(Scale::Anchor { raw, value }) if raw == 0.0 || value == 0.0 => {
                self.say(span, "raw and value of a scale are not 0");
            }
            Some(Scale::ByObject { object: by, .. }) => self.reference(by, object, span, "scale"),
            _ => {}
        }
        if let Some(of) = look.of {
            self.reference(of, object, span, "of");
        }
    }

    fn when(&mut self, object: &Object, entry: &Entry, when: &When) {
        self.reference(when.object, object, &entry.span, "when");
    }

    fn number(&mut self, number: i64, data_type: DataType, key: &str, span: &Range<usize>) {
        if !fits(number, data_type) {
            self.say(span, format!("{key} {number} does not fit {}", data_type.name()));
        }
    }

    fn names(&mut self, names: Option<&Names>, data_type: DataType, key: &str, span: &Range<usize>) {
        for value in names.into_iter().flat_map(|names| names.0.keys()) {
            self.number(*value, data_type, key, span);
        }
    }

    fn bits(&mut self, bits: &BitNames, data_type: DataType, span: &Range<usize>) {
        let width = u32::from(data_type.bits().unwrap_or(64));
        let mut taken: u64 = 0;
        for bit in &bits.list {
            let end = u32::from(bit.bit) + u32::from(bit.width);
            if bit.width == 0 || end > width {
                let name = data_type.name();
                self.say(span, format!("bits {} to {} do not fit {name}", bit.bit, end.saturating_sub(1)));
                continue;
            }
            let mask = (u64::MAX >> (64 - u32::from(bit.width))) << bit.bit;
            if taken & mask != 0 {
                self.say(span, format!("bit {} is named twice", (taken & mask).trailing_zeros()));
            }
            if bit.name.is_empty() && !bit.reserved {
                self.say(span, format!("bit {} needs a name, or reserved = true", bit.bit));
            }
            taken |= mask;
        }
    }

    /// A reference in a repeated object must lead to a described object in each repeat.
    fn reference(&mut self, reference: Reference, object: &Object, span: &Range<usize>, key: &str) {
        for nth in 0..object.repeat.count {
            let address = reference.shifted(nth, object.repeat.stride);
            if !self.is_known(address) {
                return self.say(span, format!("{key}: {address} is no object of this profile"));
            }
        }
    }

    fn is_known(&self, address: ObjectAddress) -> bool {
        self.device.dictionary.find(address).is_some_and(|found| found.entry.is_some())
    }

    fn known(&mut self, reference: Reference, span: &Range<usize>, key: &str) {
        if !self.is_known(reference.object) {
            self.say(span, format!("{key}: {} is no object of this profile", reference.object));
        }
    }

    fn duplicates(&mut self, objects: &[Object]) {
        let mut seen = BTreeSet::new();
        for object in objects {
            for nth in 0..object.repeat.count {
                let index = object.index.wrapping_add(nth.wrapping_mul(object.repeat.stride));
                for entry in &object.entries {
                    for sub in entry.sub..=entry.to {
                        if !seen.insert((index, sub)) {
                            let address = ObjectAddress::new(index, sub);
                            self.say(&entry.span, format!("{address} is described twice"));
                        }
                    }
                }
            }
        }
    }

    fn cycles(&mut self, objects: &[Object]) {
        for object in objects {
            for entry in &object.entries {
                let start = ObjectAddress::new(object.index, entry.sub);
                if leads_back(&self.device.dictionary, start) {
                    self.say(&entry.span, format!("the scale of {start} depends on itself"));
                }
            }
        }
    }

    fn pdos(&mut self) {
        let device = self.device;
        let mut ended: Vec<PdoName> = Vec::new();
        for (pdo, span) in device.pdos.iter().zip(&device.places.pdos) {
            if ended.contains(&pdo.pdo) {
                self.say(span, format!("{} is decided by the entry above, which has no `when`", pdo.pdo));
            }
            if pdo.when.is_none() {
                ended.push(pdo.pdo);
            }
            let bits = self.fields(&pdo.fields, span);
            if bits > FRAME_BITS {
                self.say(span, format!("{} has {bits} bits; a frame holds {FRAME_BITS}", pdo.pdo));
            }
        }
        for (message, span) in device.messages.iter().zip(&device.places.messages) {
            self.message(message, span);
        }
        for (pdo, span) in device.pdos.iter().zip(&device.places.pdos) {
            if !ended.contains(&pdo.pdo) {
                self.say(span, format!("the last entry of {} has no `when`", pdo.pdo));
                ended.push(pdo.pdo);
            }
        }
    }

    /// Checks fields that follow each other; gives the bits they take.
    fn fields(&mut self, fields: &[PdoField], span: &Range<usize>) -> u16 {
        for field in fields {
            let Some(object) = field.object else { continue };
            self.known(object, span, "field");
            let known = self.device.dictionary.data_type(object.object).and_then(DataType::bits);
            if field.bits == 0 || known.is_some_and(|known| known < field.bits) {
                self.say(span, format!("{} has fewer than {} bits", object.object, field.bits));
            }
        }
        fields.iter().fold(0_u16, |bits, field| bits.saturating_add(field.bits))
    }

    fn message(&mut self, message: &MessageSpec, span: &Range<usize>) {
        let name = &message.name;
        let bits = self.fields(&message.fields, span);
        if bits > MESSAGE_BITS {
            self.say(span, format!("{name} has {bits} bits; a message holds {MESSAGE_BITS}"));
        }
        let last = message.pgn.saturating_add(u32::from(message.count).saturating_sub(1));
        if message.count == 0 || last > LAST_PGN {
            self.say(span, format!("{name}: groups are 0 to 0x{LAST_PGN:X}, one or more"));
        }
        let address = self.device.j1939.addresses.map_or(0, |[first, _]| first);
        if let Some(number) = &message.number
            && formula(number, Some(address)).is_none_or(|number| number >= u64::from(message.count))
        {
            self.say(
                span,
                format!("{name}: number '{number}' is none of its {} at address {address}", message.count),
            );
        }
    }

    /// Machines, gates, procedures and rules are kept one by one.
    fn repeats(&mut self) {
        let places = &self.device.places;
        let lists = [&places.machines, &places.gates, &places.procedures, &places.rules];
        for span in lists.into_iter().filter_map(|list| list.get(MOST_REPEATS).cloned()) {
            self.say(
                &span,
                format!("machines, gates, procedures and rules repeat {MOST_REPEATS} times in all at most"),
            );
        }
    }

    fn behaviour(&mut self) {
        self.repeats();
        let device = self.device;
        for (machine, span) in device.machines.iter().zip(&device.places.machines) {
            self.machine(machine, span);
        }
        for (gate, span) in device.gates.iter().zip(&device.places.gates) {
            gate.of.iter().chain(&gate.closes).for_each(|of| self.known(*of, span, "for"));
            gate.open.0.iter().for_each(|open| self.condition(open, span));
        }
        for (procedure, span) in device.procedures.iter().zip(&device.places.procedures) {
            procedure.triggers().for_each(|trigger| self.trigger(trigger, span));
            if let Some(status) = &procedure.status {
                self.known(status.object, span, "status");
                if !device.codes.contains_key(&status.codes) {
                    self.say(span, format!("there is no table [codes.{}]", status.codes));
                }
            }
            procedure.needs.iter().for_each(|need| self.condition(need, span));
        }
    }

    fn machine(&mut self, machine: &Machine, span: &Range<usize>) {
        self.known(machine.status.object, span, "status");
        self.known(machine.control.object, span, "control");
        let named = |name: &String| machine.states.iter().any(|state| state.name == *name);
        let transitions = machine.transitions.iter().flat_map(|it| it.from.0.iter().chain([&it.to]));
        let forced = machine.forced.iter().flat_map(|it| it.from.0.iter().chain([&it.to]));
        let unknown: Vec<_> = transitions.chain(forced).filter(|name| !named(name)).cloned().collect();
        for name in unknown {
            self.say(span, format!("machine {} has no state '{name}'", machine.name));
        }
    }

    fn condition(&mut self, condition: &Condition, span: &Range<usize>) {
        match condition {
            Condition::Object { object, .. } | Condition::Inside { object, .. } => {
                self.known(*object, span, "condition");
            }
            Condition::Other(all) => all.0.iter().for_each(|one| self.condition(one, span)),
            Condition::State(states) => self.states(states, span),
            _ => {}
        }
    }

    fn trigger(&mut self, trigger: &Trigger, span: &Range<usize>) {
        match trigger {
            Trigger::Write(object, wanted) | Trigger::Read(object, wanted) => {
                self.known(*object, span, "trigger");
                let data_type = self.device.dictionary.data_type(object.object);
                if let (Some(Wanted::Text(text)), Some(known)) = (wanted, data_type.and_then(DataType::bits))
                    && text.len() * 8 != usize::from(known)
                {
                    self.say(span, format!("'{text}' does not fit {}", object.object));
                }
            }
            Trigger::Bit(bit, _) => self.known(bit.object, span, "bit"),
            Trigger::State(states) => self.states(states, span),
            Trigger::Message(message) => {
                if !self.device.messages.iter().any(|spec| spec.name == message.name) {
                    self.say(span, format!("there is no message '{}'", message.name));
                }
                message.when.0.iter().for_each(|when| self.condition(when, span));
            }
            Trigger::Dtc(Some((parameter, fmi))) if self.device.dtc(*parameter, *fmi).is_none() => {
                self.say(span, format!("there is no fault {parameter}/{fmi}"));
            }
            _ => {}
        }
    }

    fn states(&mut self, states: &[String], span: &Range<usize>) {
        let named = |name: &String| {
            self.device.machines.iter().any(|machine| machine.states.iter().any(|state| state.name == *name))
        };
        let unknown: Vec<_> = states.iter().filter(|name| !named(name)).cloned().collect();
        for name in unknown {
            self.say(span, format!("no machine has a state '{name}'"));
        }
    }
}

/// Whether a raw number fits a type; types that hold no integer take any.
fn fits(number: i64, data_type: DataType) -> bool {
    let Some(bits) = data_type.bits() else { return false };
    let number = i128::from(number);
    match data_type {
        DataType::Real32 | DataType::Real64 => true,
        _ if data_type.is_signed() => {
            let limit = 1_i128 << (bits - 1);
            (-limit..limit).contains(&number)
        }
        _ => (0..1_i128 << bits).contains(&number),
    }
}

/// Whether scales lead from an object back to it.
fn leads_back(dictionary: &Dictionary, start: ObjectAddress) -> bool {
    let mut open = vec![start];
    let mut seen = Vec::new();
    while let Some(address) = open.pop() {
        let Some(found) = dictionary.find(address) else { continue };
        let Some(entry) = found.entry else { continue };
        let looks = std::iter::once(&entry.look).chain(entry.modes.iter().map(|(_, look)| look));
        for look in looks {
            let Some(Scale::ByObject { object, .. }) = look.scale else { continue };
            let next = found.shifted(object);
            if next == start {
                return true;
            }
            if !seen.contains(&next) {
                seen.push(next);
                open.push(next);
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of a profile that extends CiA 301, without file name and excerpt.
    pub(super) fn errors(body: &str) -> Vec<String> {
        let text = format!("id = \"x\"\n{body}");
        let file = ProfileFile::parse(&text).unwrap();
        let device = file.device(None, &[super::super::plain_device().clone()]);
        check(&text, &file, &device).iter().map(|it| format!("{}: {}", it.line, it.message)).collect()
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
        assert_eq!(wrong, ["2: default 6 lies outside range 0 to 5"]);
        let wrong = errors(&object("type = \"UNSIGNED8\"\nvalues = { 0x100 = \"x\" }"));
        assert_eq!(wrong, ["2: values 256 does not fit UNSIGNED8"]);
        let default = |text: &str| errors(&object(&format!("type = \"UNSIGNED16\"\ndefault = \"{text}\"")));
        assert_eq!(default("$NODEID+0x200"), [""; 0]);
        assert_eq!(default("$NODEID+0xFFFF"), ["2: default $NODEID+0xFFFF does not fit UNSIGNED16"]);
        assert_eq!(
            default("0x80+$NODE"),
            ["2: default '0x80+$NODE' is no number: write 5 or \"$NODEID+0x200\""]
        );
        assert_eq!(errors(&object("unit = \"bar\"")), ["2: a value that is described needs its type"]);
    }

    #[test]
    fn a_mode_says_in_which_values_the_loop_is_open() {
        let mode = |keys: &str| errors(&object(&format!("type = \"INTEGER8\"\n{keys}")));
        let names = "values = { 1 = \"open\", 2 = \"closed\" }";
        assert_eq!(mode(&format!("role = \"mode\"\nopen_loop = [1]\n{names}")), [""; 0]);
        let wrong = mode(&format!("role = \"mode\"\nopen_loop = [3]\n{names}"));
        assert_eq!(wrong, ["2: open_loop 3 is none of its values"]);
        let wrong = mode("open_loop = [128]");
        assert_eq!(
            wrong,
            ["2: open_loop stands at a mode: role = \"mode\"", "2: open_loop 128 does not fit INTEGER8"]
        );
    }

    #[test]
    fn uds_identifiers_fit_their_type() {
        let identifier = |keys: &str| format!("[[uds.identifier]]\nid = 0x1001\nname = \"a\"\n{keys}\n");
        let whole = identifier("type = \"UNSIGNED8\"\nrange = [1, 127]\ndefault = 32");
        assert_eq!(errors(&whole), [""; 0]);
        assert_eq!(errors(&format!("{whole}{whole}")), ["8: UDS identifier 1001 is described twice"]);
        let wrong = errors(&identifier("type = \"UNSIGNED8\"\nrange = [1, 127]\ndefault = 0"));
        assert_eq!(wrong, ["2: default 0 lies outside range 1 to 127"]);
        let wrong = errors(&identifier("type = \"UNSIGNED8\"\nrange = [1, 256]"));
        assert_eq!(wrong, ["2: range or default 256 does not fit UNSIGNED8"]);
        assert_eq!(errors(&identifier("default = 1")), ["2: a value that is described needs its type"]);
        assert_eq!(errors(&identifier("type = \"UNSIGNED8\"\nunit = \"x\"")), ["2: 'x' is no known unit"]);
    }

    #[test]
    fn bits_do_not_overlap() {
        let wrong = errors(&object(
            "type = \"UNSIGNED8\"\nbits = [{ bit = 0, width = 4, name = \"a\" }, { bit = 3, name = \"b\" }, { bit = 8, name = \"c\" }]",
        ));
        assert_eq!(wrong, ["2: bit 3 is named twice", "2: bits 8 to 8 do not fit UNSIGNED8"]);
    }

    #[test]
    fn objects_are_described_once() {
        let twice = "[[object]]\nindex = 0x2000\nname = \"a\"\ntype = \"UNSIGNED8\"\n\
                     [[object]]\nindex = 0x1FFE\nrepeat = { count = 3, stride = 1 }\nname = \"b\"\ntype = \"UNSIGNED8\"\n";
        assert_eq!(errors(twice), ["6: 2000:00 is described twice"]);
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
        assert_eq!(wrong[2], "8: scale: 2000:09 is no object of this profile");
    }

    #[test]
    fn pdos_hold_known_objects_and_end_with_a_default() {
        let pdo = "[[pdo]]\npdo = \"TPDO1\"\nmapping = \"fixed\"\n\
            fields = [{ object = \"1001:00\", bits = 16 }, { object = \"2000:00\", bits = 64 }]\n\
            when = { object = \"1000:00\", equals = 1 }\n";
        let wrong = errors(pdo);
        assert_eq!(wrong[0], "2: 1001:00 has fewer than 16 bits");
        assert_eq!(wrong[1], "2: field: 2000:00 is no object of this profile");
        assert_eq!(wrong[2], "2: TPDO1 has 80 bits; a frame holds 64");
        assert_eq!(wrong[3], "2: the last entry of TPDO1 has no `when`");
    }

    #[test]
    fn machines_and_procedures_name_what_there_is() {
        let machine = "[[machine]]\nname = \"m\"\nstatus = { object = \"1001:00\", mask = 1 }\n\
            control = { object = \"1001:00\", mask = 1 }\nstates = [{ name = \"A\", value = 0 }]\n\
            transitions = [{ from = \"A\", to = \"B\", mask = 1, value = 1 }]\n";
        assert_eq!(errors(machine), ["2: machine m has no state 'B'"]);
        let procedure = "[[procedure]]\nname = \"p\"\nstart = { write = \"1001:00\" }\n\
            status = { object = \"1001:00\", codes = \"none\" }\n";
        assert_eq!(errors(procedure), ["2: there is no table [codes.none]"]);
    }
}
