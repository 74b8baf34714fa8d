//! Converts the sections of an object to entries (CiA 306-1 §4.6.3, §4.7).

use std::collections::BTreeMap;

use super::code::{EntryAccess, ObjectType, data_type};
use super::ini::{IniEntry, IniFile, IniSection};
use super::number::parse_integer;
use super::problem::DescriptionProblems;
use super::value::{EntryValue, Reading, strip_comment, uncommented_text};
use super::{DeviceObject, LONGEST_VALUE};
use crate::profile::DataType;
use crate::profile::quoted::quote_start;
use crate::wire::canopen::ObjectAddress;

/// Positions of the sections of one index in the list of sections.
#[derive(Debug, Default)]
pub(super) struct IndexSections {
    /// Section `[1003]`.
    pub(super) main: Option<usize>,
    /// Sections `[1003sub1]` by sub-index.
    pub(super) subs: BTreeMap<u8, usize>,
    /// Section `[1003Name]`.
    pub(super) names: Option<usize>,
    /// Section `[1003Value]`.
    pub(super) values: Option<usize>,
    /// Section `[1003Denotation]`.
    pub(super) denotations: Option<usize>,
}

/// File that contains the objects, and the problems found so far.
pub(super) struct ObjectFile<'a, 'p> {
    pub(super) ini: &'a IniFile<'a>,
    pub(super) problems: &'p mut DescriptionProblems,
}

/// Keywords of a compact list by sub-index.
type List<'a> = BTreeMap<u8, &'a IniEntry<'a>>;

impl<'a> ObjectFile<'a, '_> {
    /// Entries of an index in order of their sub-indices.
    pub(super) fn parse_object(&mut self, index: u16, sections: &IndexSections) -> Vec<DeviceObject> {
        let main = sections.main.and_then(|at| self.ini.sections.get(at));
        let Some(main) = main else {
            return self.parse_orphans(index, sections);
        };
        let object_type = self.object_type(main);
        if object_type == ObjectType::Type || object_type == ObjectType::Null {
            return Vec::new();
        }
        let entries = self.common_properties(main, object_type);
        let compact = self.compact_count(main);
        if compact == 0 {
            self.lists_without_use(index, sections);
        }
        if sections.subs.is_empty() && compact == 0 {
            if !object_type.has_entries() {
                return vec![self.parse_entry(ObjectAddress::new(index, 0), main, &entries, object_type)];
            }
            let reason = format!(
                "[{}] skipped: its ObjectType requires entries, but no section defines one",
                main.name
            );
            self.problems.add_problem(main.line, reason);
            return Vec::new();
        }
        if !object_type.has_entries() {
            let reason = format!(
                "[{}] has the ObjectType of a variable, but has entries; treated as a record",
                main.name
            );
            self.problems.add_problem(main.line, reason);
        }
        let mut found = self.parse_subs(index, sections, &entries);
        self.check_count(main, compact, &found);
        if compact > 0 {
            for entry in self.compact_entries(index, sections, main, compact, &entries) {
                found.entry(entry.address.sub).or_insert(entry);
            }
        }
        found.into_values().collect()
    }

    /// Properties that the entries of an object inherit.
    fn common_properties(&mut self, main: &IniSection<'a>, object_type: ObjectType) -> CommonProperties {
        let written = main.value("datatype").filter(|_| object_type == ObjectType::Array);
        CommonProperties {
            object_name: self.parse_name(main, "parametername").unwrap_or_default(),
            data_type: written.and_then(|text| data_type(parse_integer(strip_comment(text))?.value)),
        }
    }

    /// Entries of an index without a main section.
    fn parse_orphans(&mut self, index: u16, sections: &IndexSections) -> Vec<DeviceObject> {
        if let Some(section) = sections.subs.values().next().and_then(|at| self.ini.sections.get(*at)) {
            self.problems
                .add_problem(section.line, format!("[{}] without a section [{index:04X}]", section.name));
        }
        self.lists_without_use(index, sections);
        self.parse_subs(index, sections, &CommonProperties::default()).into_values().collect()
    }

    /// Reports `[1003Name]` and similar sections of an object without `CompactSubObj`.
    fn lists_without_use(&mut self, index: u16, sections: &IndexSections) {
        for at in [sections.names, sections.values, sections.denotations].into_iter().flatten() {
            if let Some(section) = self.ini.sections.get(at) {
                let reason = format!("[{}] skipped: [{index:04X}] has no CompactSubObj", section.name);
                self.problems.add_problem(section.line, reason);
            }
        }
    }

    fn parse_subs(
        &mut self,
        index: u16,
        sections: &IndexSections,
        entries: &CommonProperties,
    ) -> BTreeMap<u8, DeviceObject> {
        let mut found = BTreeMap::new();
        for (sub, at) in &sections.subs {
            let Some(section) = self.ini.sections.get(*at) else { continue };
            let mut entry =
                self.parse_entry(ObjectAddress::new(index, *sub), section, entries, ObjectType::Var);
            entry.entry_name = self.parse_name(section, "parametername");
            found.insert(*sub, entry);
        }
        found
    }

    /// Entry from one section.
    fn parse_entry(
        &mut self,
        address: ObjectAddress,
        section: &IniSection<'a>,
        entries: &CommonProperties,
        object_type: ObjectType,
    ) -> DeviceObject {
        let fallback = match object_type {
            ObjectType::Domain => Some(DataType::Domain),
            _ => entries.data_type.filter(|_| address.sub > 0),
        };
        let data_type = self.data_type(section, fallback);
        DeviceObject {
            address,
            object_name: entries.object_name.clone(),
            entry_name: None,
            denotation: section.value("denotation").and_then(|_| self.parse_name(section, "denotation")),
            data_type,
            access: self.parse_access(section),
            default: self.parse_given(section, "defaultvalue", data_type, EntryValue::parse_value),
            low: self.parse_given(section, "lowlimit", data_type, EntryValue::read_limit),
            high: self.parse_given(section, "highlimit", data_type, EntryValue::read_limit),
            value: self.parse_given(section, "parametervalue", data_type, EntryValue::parse_value),
            mappable: self.parse_number(section, "pdomapping").map(|number| number != 0),
            line: section.line,
        }
    }

    /// Entries defined by `CompactSubObj`: sub-index 0 and equal entries, whose names and values can be in
    /// separate sections (CiA 306-1 §4.6.3, §4.7.2).
    fn compact_entries(
        &mut self,
        index: u16,
        sections: &IndexSections,
        main: &IniSection<'a>,
        last: u8,
        entries: &CommonProperties,
    ) -> Vec<DeviceObject> {
        let mut model = self.parse_entry(ObjectAddress::new(index, 1), main, entries, ObjectType::Var);
        model.value = None;
        let names = self.parse_list(sections.names, last);
        let denotations = self.parse_list(sections.denotations, last);
        let values = self.parse_list(sections.values, last);
        let mut found = vec![number_of_entries(&model, last)];
        for sub in 1..=last {
            let mut entry = model.clone();
            entry.address.sub = sub;
            let name = names.get(&sub).and_then(|name| self.parse_text(name));
            entry.entry_name = Some(name.unwrap_or_else(|| format!("{}{sub}", model.object_name)));
            entry.denotation = denotations.get(&sub).and_then(|name| self.parse_text(name));
            if let Some(value) = values.get(&sub) {
                entry.value = self.take_reading(
                    value,
                    EntryValue::parse_value(uncommented_text(value.value), model.data_type),
                );
            }
            found.push(entry);
        }
        found
    }

    /// Keywords of `[1003Name]` or a similar section, up to sub-index `last`.
    fn parse_list(&mut self, at: Option<usize>, last: u8) -> List<'a> {
        let mut found = List::new();
        let Some(section) = at.and_then(|at| self.ini.sections.get(at)) else { return found };
        for (number, entry) in section.numbered_entries() {
            match u8::try_from(number) {
                Ok(sub) if (1..=last).contains(&sub) => _ = found.insert(sub, entry),
                _ => self
                    .problems
                    .add_problem(entry.line, format!("sub-index {number} skipped: CompactSubObj is {last}")),
            }
        }
        found
    }

    /// Compares `SubNumber` with the number of sub-indices (CiA 306-1 §4.6.3).
    fn check_count(&mut self, main: &IniSection<'a>, compact: u8, found: &BTreeMap<u8, DeviceObject>) {
        let Some(entry) = main.entry("subnumber").filter(|_| compact == 0) else { return };
        let announced = self.parse_number(main, "subnumber");
        if announced.is_some_and(|announced| i128::try_from(found.len()) != Ok(announced)) {
            let reason = format!(
                "SubNumber {} in [{}], but {} sub-index sections",
                entry.value,
                main.name,
                found.len()
            );
            self.problems.add_problem(entry.line, reason);
        }
    }

    /// Object type; 7 (VAR) if `ObjectType` is missing (CiA 306-1 §4.6.3.2).
    fn object_type(&mut self, section: &IniSection<'a>) -> ObjectType {
        let Some(code) = self.parse_number(section, "objecttype") else { return ObjectType::Var };
        ObjectType::from_code(code).unwrap_or_else(|| {
            let line = section.entry("objecttype").map_or(section.line, |entry| entry.line);
            self.problems.add_problem(
                line,
                format!("ObjectType {code} is undefined in CiA 301; treated as a variable"),
            );
            ObjectType::Var
        })
    }

    /// `CompactSubObj`: the last sub-index. 255 is reserved for the structure of the object.
    fn compact_count(&mut self, section: &IniSection<'a>) -> u8 {
        let Some(number) = self.parse_number(section, "compactsubobj") else { return 0 };
        u8::try_from(number).ok().filter(|last| *last < u8::MAX).unwrap_or_else(|| {
            let line = section.entry("compactsubobj").map_or(section.line, |entry| entry.line);
            self.problems.add_problem(line, format!("CompactSubObj {number}: expected 0 to 254"));
            0
        })
    }

    fn data_type(&mut self, section: &IniSection<'a>, fallback: Option<DataType>) -> Option<DataType> {
        if section.value("datatype").is_none() {
            if fallback.is_none() {
                self.problems.add_problem(section.line, format!("[{}] without DataType", section.name));
            }
            return fallback;
        }
        let code = self.parse_number(section, "datatype")?;
        let found = data_type(code).or_else(|| self.defined_type(code));
        if found.is_none() {
            let line = section.entry("datatype").map_or(section.line, |entry| entry.line);
            self.problems.add_problem(line, format!("DataType {code:#X} is undefined in CiA 301"));
        }
        found
    }

    /// Data type that the device defines itself: for an entry with limits, CANFestival writes a type `[A0]`
    /// whose sub-index 1 contains the base type.
    fn defined_type(&self, code: i128) -> Option<DataType> {
        let section = self
            .ini
            .parse_section(&format!("{code:x}sub1"))
            .or_else(|| self.ini.parse_section(&format!("{code:04x}sub1")))?;
        data_type(parse_integer(strip_comment(section.value("defaultvalue")?))?.value)
    }

    fn parse_access(&mut self, section: &IniSection<'a>) -> Option<EntryAccess> {
        let Some(entry) = section.entry("accesstype").filter(|entry| !strip_comment(entry.value).is_empty())
        else {
            self.problems.add_problem(section.line, format!("[{}] without AccessType", section.name));
            return None;
        };
        let word = strip_comment(entry.value);
        let access = EntryAccess::from_keyword(word);
        if access.is_none() {
            self.problems.add_problem(
                entry.line,
                format!("AccessType {}: expected ro, wo, rw, rwr, rww or const", quote_start(word)),
            );
        }
        access
    }

    fn parse_name(&mut self, section: &IniSection<'a>, key: &str) -> Option<String> {
        let name = section.entry(key).and_then(|entry| self.parse_text(entry));
        if name.is_none() {
            self.problems.add_problem(section.line, format!("[{}] without ParameterName", section.name));
        }
        name
    }

    /// Text of a keyword; `None` if empty.
    pub(super) fn parse_text(&mut self, entry: &IniEntry<'_>) -> Option<String> {
        let text = uncommented_text(entry.value);
        let shown = text.char_indices().nth(LONGEST_VALUE).map_or(text, |(at, _)| text.split_at(at).0);
        if shown.len() < text.len() {
            self.problems.add_problem(
                entry.line,
                format!("{}: cut off after {LONGEST_VALUE} characters", quote_start(text)),
            );
        }
        (!shown.is_empty()).then(|| shown.to_owned())
    }

    /// Number of a keyword; `None` if missing, empty or invalid.
    pub(super) fn parse_number(&mut self, section: &IniSection<'a>, key: &str) -> Option<i128> {
        let entry = section.entry(key)?;
        let text = strip_comment(entry.value);
        let found = parse_integer(text);
        let complaint = match found {
            None if text.is_empty() => return None,
            None => Some("expected a number"),
            Some(found) => found.doubt,
        };
        if let Some(complaint) = complaint {
            self.problems
                .add_problem(entry.line, format!("{} {}: {complaint}", entry.name, quote_start(text)));
        }
        found.map(|found| found.value)
    }

    fn parse_given(
        &mut self,
        section: &IniSection<'a>,
        key: &str,
        data_type: Option<DataType>,
        read: fn(&str, Option<DataType>) -> Reading,
    ) -> Option<EntryValue> {
        let entry = section.entry(key)?;
        self.take_reading(entry, read(uncommented_text(entry.value), data_type))
    }

    fn take_reading(&mut self, entry: &IniEntry<'_>, (given, complaint): Reading) -> Option<EntryValue> {
        if let Some(complaint) = complaint {
            self.problems.add_problem(entry.line, format!("{} {complaint}", entry.name));
        }
        given
    }
}

/// Properties common to the entries of an object.
#[derive(Debug, Default)]
struct CommonProperties {
    object_name: String,
    data_type: Option<DataType>,
}

/// Sub-index 0 of a compact object, with the name from CiA 306-1 §4.6.3.
fn number_of_entries(model: &DeviceObject, last: u8) -> DeviceObject {
    DeviceObject {
        address: ObjectAddress::new(model.address.index, 0),
        object_name: model.object_name.clone(),
        entry_name: Some("NrOfObjects".to_owned()),
        denotation: None,
        data_type: Some(DataType::Unsigned8),
        access: Some(EntryAccess::Ro),
        default: Some(EntryValue::Number(i128::from(last))),
        low: None,
        high: None,
        value: None,
        mappable: Some(false),
        line: model.line,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{DeviceFile, parse_device_file};
    use super::*;

    fn read(text: &str) -> (DeviceFile, Vec<String>) {
        let text = format!("[DeviceInfo]\n[MandatoryObjects]\n1=0x2000\n{text}");
        let file = parse_device_file(text.as_bytes()).unwrap();
        let problems = file.problems.iter().map(ToString::to_string).collect();
        (file, problems)
    }

    #[test]
    fn a_variable_without_object_type() {
        let (file, problems) = read("[2000]\nParameterName=Speed\nDataType=3\nAccessType=rw\nPDOMapping=1");
        let [entry] = &file.objects[..] else { panic!("{file:?}") };
        assert_eq!((entry.data_type, entry.access), (Some(DataType::Integer16), Some(EntryAccess::Rw)));
        assert_eq!((entry.mappable, entry.default.as_ref(), entry.line), (Some(true), None, 4));
        assert!(problems.is_empty(), "{problems:?}");
    }

    #[test]
    fn entries_of_an_array_have_its_type_if_they_say_none() {
        let (file, problems) = read(
            "[2000]\nParameterName=A\nObjectType=8\nDataType=3\n[2000sub0]\nParameterName=N\nDataType=5\nAccessType=ro\n\
             [2000sub1]\nParameterName=V\nAccessType=ro",
        );
        let types: Vec<_> = file.objects.iter().map(|entry| entry.data_type).collect();
        assert_eq!(types, [Some(DataType::Unsigned8), Some(DataType::Integer16)]);
        assert!(problems.is_empty(), "{problems:?}");
    }

    #[test]
    fn a_compact_array_of_254_is_255_entries_and_a_list_beyond_it_is_none() {
        let (file, problems) = read(
            "[2000]\nParameterName=A\nObjectType=8\nDataType=3\nAccessType=ro\nCompactSubObj=254\n\
             [2000Name]\nNrOfEntries=4000000000\n254=Last\n255=None\n99999999999999999999=None",
        );
        assert_eq!(file.objects.len(), 255);
        assert_eq!(file.objects[254].entry_name.as_deref(), Some("Last"));
        assert_eq!(file.objects[253].entry_name.as_deref(), Some("A253"));
        assert_eq!(problems, ["line 13: sub-index 255 skipped: CompactSubObj is 254"]);
    }

    #[test]
    fn types_of_the_device_are_looked_up() {
        let (file, _) = read("[2000]\nDataType=0xA0\n[A0]\nObjectType=5\n[A0sub1]\nDefaultValue=0x2");
        assert_eq!(file.objects[0].data_type, Some(DataType::Integer8), "{file:?}");
    }
}
