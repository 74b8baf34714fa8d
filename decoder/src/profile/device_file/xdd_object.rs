//! Converts objects of an XDD and their parameters to entries.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use super::code::{EntryAccess, ObjectType, data_type};
use super::number::parse_integer;
use super::problem::DescriptionProblems;
use super::value::{EntryValue, Reading};
use super::xml::XmlAttributes;
use super::{DeviceObject, LONGEST_VALUE};
use crate::profile::DataType;
use crate::profile::quoted::quote_start;
use crate::wire::canopen::ObjectAddress;

/// `CANopenObject` or `CANopenSubObject` as parsed.
#[derive(Debug)]
pub(super) struct RawObject {
    pub(super) is_sub: bool,
    pub(super) attributes: XmlAttributes,
    pub(super) line: usize,
}

/// A `parameter`, or another element with a `uniqueID` that describes a value.
#[derive(Debug, Default)]
pub(super) struct DescribedValue {
    pub(super) access: Option<String>,
    pub(super) data_type: Option<DataType>,
    /// `dataTypeIDRef` or `templateIDRef`: element with the other properties.
    pub(super) reference: Option<String>,
    pub(super) default: Option<String>,
    pub(super) actual: Option<String>,
    pub(super) low: Option<String>,
    pub(super) high: Option<String>,
}

/// Descriptions by `uniqueID`.
pub(super) type Descriptions = HashMap<String, DescribedValue, RandomState>;

/// `CANopenObject` whose `CANopenSubObject`s follow.
struct ParentObject<'a> {
    raw: &'a RawObject,
    index: u16,
    name: String,
    object_type: ObjectType,
    has_entries: bool,
}

/// Entries in order of their unique addresses.
pub(super) fn convert_entries(
    raws: &[RawObject],
    descriptions: &Descriptions,
    problems: &mut DescriptionProblems,
) -> Vec<DeviceObject> {
    let mut found = Vec::new();
    let mut parent = None;
    for raw in raws {
        let mut reader = ObjectReader { raw, descriptions, problems };
        if raw.is_sub {
            found.extend(reader.sub_object(parent.as_mut()));
        } else {
            finish_object(parent.take(), &mut found, &mut reader);
            parent = reader.read_object();
        }
    }
    if let Some(last) = raws.last() {
        finish_object(parent, &mut found, &mut ObjectReader { raw: last, descriptions, problems });
    }
    found.sort_by_key(|entry| entry.address);
    found.dedup_by(|second, first| {
        let is_same = first.address == second.address;
        if is_same {
            problems.add_problem(
                second.line,
                format!(
                    "duplicate entry for {}; the first one, in line {}, is used",
                    second.address, first.line
                ),
            );
        }
        is_same
    });
    found
}

/// Adds an object without sub-objects as an entry.
fn finish_object<'a>(
    parent: Option<ParentObject<'a>>,
    found: &mut Vec<DeviceObject>,
    reader: &mut ObjectReader<'a, '_>,
) {
    let Some(parent) = parent.filter(|parent| !parent.has_entries) else { return };
    match parent.object_type {
        ObjectType::Null | ObjectType::Type => {}
        ObjectType::Array | ObjectType::Record => {
            let reason = format!(
                "{:04X} skipped: its objectType requires entries, but no CANopenSubObject defines one",
                parent.index
            );
            reader.problems.add_problem(parent.raw.line, reason);
        }
        ObjectType::Var | ObjectType::Domain => {
            let mut reader = ObjectReader {
                raw: parent.raw,
                descriptions: reader.descriptions,
                problems: reader.problems,
            };
            let fallback = (parent.object_type == ObjectType::Domain).then_some(DataType::Domain);
            found.push(reader.read_entry(ObjectAddress::new(parent.index, 0), parent.name, fallback));
        }
    }
}

struct ObjectReader<'a, 'p> {
    raw: &'a RawObject,
    descriptions: &'a Descriptions,
    problems: &'p mut DescriptionProblems,
}

impl<'a> ObjectReader<'a, '_> {
    fn read_object(&mut self) -> Option<ParentObject<'a>> {
        let index = self.read_hexadecimal("index").and_then(|number| u16::try_from(number).ok());
        if index.is_none() {
            self.report_problem("CANopenObject skipped: expected an index of four hexadecimal digits");
        }
        let code =
            self.raw.attributes.get("objectType").map_or(Some(7), |text| Some(parse_integer(text)?.value));
        let object_type = code.and_then(ObjectType::from_code).unwrap_or_else(|| {
            self.report_problem("objectType is undefined in CiA 301; treated as a variable");
            ObjectType::Var
        });
        let name = self.read_text("name").unwrap_or_default();
        Some(ParentObject { raw: self.raw, index: index?, name, object_type, has_entries: false })
    }

    fn sub_object(&mut self, parent: Option<&mut ParentObject<'_>>) -> Option<DeviceObject> {
        let Some(parent) = parent else {
            self.report_problem("CANopenSubObject skipped: not inside an object");
            return None;
        };
        parent.has_entries = true;
        let Some(sub) = self.read_hexadecimal("subIndex").and_then(|number| u8::try_from(number).ok()) else {
            self.report_problem("CANopenSubObject skipped: expected a subIndex of two hexadecimal digits");
            return None;
        };
        let mut entry = self.read_entry(ObjectAddress::new(parent.index, sub), parent.name.clone(), None);
        entry.entry_name = self.read_text("name");
        Some(entry)
    }

    fn read_entry(
        &mut self,
        address: ObjectAddress,
        object_name: String,
        fallback: Option<DataType>,
    ) -> DeviceObject {
        let described = self.described_parameter();
        let data_type = self.data_type(described).or(fallback);
        if data_type.is_none() {
            self.report_problem(format!("{address} without a data type"));
        }
        let pick = |attribute, of: fn(&DescribedValue) -> Option<&String>| {
            let own = self.raw.attributes.get(attribute);
            own.or_else(|| self.inherited_property(described, of).map(String::as_str))
        };
        let default = pick("defaultValue", |described| described.default.as_ref());
        let low = pick("lowLimit", |described| described.low.as_ref());
        let high = pick("highLimit", |described| described.high.as_ref());
        let value = pick("actualValue", |described| described.actual.as_ref());
        DeviceObject {
            address,
            object_name,
            entry_name: None,
            denotation: self.raw.attributes.get("denotation").and_then(|_| self.read_text("denotation")),
            data_type,
            access: self.read_access(described),
            default: self.read_given("defaultValue", default, data_type, EntryValue::parse_value),
            low: self.read_given("lowLimit", low, data_type, EntryValue::read_limit),
            high: self.read_given("highLimit", high, data_type, EntryValue::read_limit),
            value: self.read_given("actualValue", value, data_type, EntryValue::parse_value),
            mappable: self.read_mappable(),
            line: self.raw.line,
        }
    }

    /// The `parameter` that the object refers to.
    fn described_parameter(&mut self) -> Option<&'a DescribedValue> {
        let id = self.raw.attributes.get("uniqueIDRef")?;
        let found = self.descriptions.get(id);
        if found.is_none() {
            self.report_problem(format!("uniqueIDRef {}: no parameter has this uniqueID", quote_start(id)));
        }
        found
    }

    /// Property of a parameter, otherwise that of its template or type.
    fn inherited_property<T>(
        &self,
        described: Option<&'a DescribedValue>,
        of: fn(&'a DescribedValue) -> Option<T>,
    ) -> Option<T> {
        let described = described?;
        of(described).or_else(|| of(self.descriptions.get(described.reference.as_ref()?)?))
    }

    fn data_type(&mut self, described: Option<&'a DescribedValue>) -> Option<DataType> {
        if let Some(code) = self.read_hexadecimal("dataType") {
            if let Some(found) = data_type(i128::from(code)) {
                return Some(found);
            }
            self.report_problem(format!("dataType {code:#X} is undefined in CiA 301"));
        }
        self.inherited_property(described, |described| described.data_type)
    }

    /// `accessType` of the object, otherwise `access` of the parameter, whose default is "read".
    fn read_access(&mut self, described: Option<&'a DescribedValue>) -> Option<EntryAccess> {
        if let Some(word) = self.raw.attributes.get("accessType") {
            let access = EntryAccess::from_keyword(word);
            if access.is_none() {
                self.report_problem(format!(
                    "accessType {}: expected ro, wo, rw, rwr, rww or const",
                    quote_start(word)
                ));
            }
            return access;
        }
        if described.is_none() {
            self.report_problem("object without accessType");
            return None;
        }
        let word =
            self.inherited_property(described, |described| described.access.as_deref()).unwrap_or("read");
        let access = EntryAccess::of_parameter(word);
        if access.is_none() && word != "noAccess" {
            self.report_problem(format!(
                "access {}: expected read, write, readWrite or const",
                quote_start(word)
            ));
        }
        access
    }

    fn read_mappable(&mut self) -> Option<bool> {
        let word = self.raw.attributes.get("PDOmapping")?;
        match word {
            "no" | "No" | "0" => Some(false),
            "optional" | "Optional" | "default" | "Default" | "TPDO" | "RPDO" | "1" => Some(true),
            _ => {
                self.report_problem(format!(
                    "PDOmapping {}: expected no, default, optional, TPDO or RPDO",
                    quote_start(word)
                ));
                None
            }
        }
    }

    fn read_given(
        &mut self,
        key: &str,
        text: Option<&str>,
        data_type: Option<DataType>,
        read: fn(&str, Option<DataType>) -> Reading,
    ) -> Option<EntryValue> {
        let (given, complaint) = read(text?, data_type);
        if let Some(complaint) = complaint {
            self.report_problem(format!("{key} {complaint}"));
        }
        given
    }

    /// Parses a number of type hexBinary; accepts the prefix 0x that some editors write.
    fn read_hexadecimal(&self, name: &str) -> Option<u64> {
        let text = self.raw.attributes.get(name)?;
        let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")).unwrap_or(text);
        digits.chars().all(|digit| digit.is_ascii_hexdigit()).then(|| u64::from_str_radix(digits, 16).ok())?
    }

    fn read_text(&mut self, name: &str) -> Option<String> {
        let Some(text) = self.raw.attributes.get(name) else {
            self.report_problem(format!("object without {name}"));
            return None;
        };
        Some(text.chars().take(LONGEST_VALUE).collect())
    }

    fn report_problem(&mut self, reason: impl Into<String>) {
        self.problems.add_problem(self.raw.line, reason);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{DeviceFile, parse_device_file};
    use super::*;

    fn read(text: &str) -> DeviceFile {
        parse_device_file(format!("<p>{text}</p>").as_bytes()).unwrap()
    }

    #[test]
    fn an_attribute_counts_before_the_parameter_and_the_parameter_before_its_template() {
        let file = read(
            "<CANopenObject index='2000' name='A' uniqueIDRef='P' defaultValue='1'/>\
             <parameterTemplate uniqueID='T' access='const'><INT/><defaultValue value='3'/><q:range><minValue value='-5'/></q:range>\
             </parameterTemplate><parameter uniqueID='P' templateIDRef='T'><label><UDINT/></label><defaultValue value='2'/></parameter>",
        );
        let [entry] = &file.objects[..] else { panic!("{file:?}") };
        assert_eq!((entry.data_type, entry.access), (Some(DataType::Integer16), Some(EntryAccess::Const)));
        assert_eq!(
            (&entry.default, &entry.low),
            (&Some(EntryValue::Number(1)), &Some(EntryValue::Number(-5)))
        );
        assert!(file.problems.is_empty(), "{:?}", file.problems);
    }

    #[test]
    fn entries_are_sorted_and_numbers_hexadecimal() {
        let file = read(
            "<CANopenObject index='0x2001' name='B' dataType='0x0005' accessType='rw'/>\
             <CANopenObject index='2000' name='A' objectType='9'><CANopenSubObject subIndex='1F' name='S' dataType='1B' accessType='ro'/>\
             </CANopenObject><CANopenObject index='2000' objectType='0'/>",
        );
        let found: Vec<_> =
            file.objects.iter().map(|entry| (entry.address.to_string(), entry.data_type)).collect();
        assert_eq!(
            found,
            [("2000:1F".into(), Some(DataType::Unsigned64)), ("2001:00".into(), Some(DataType::Unsigned8))]
        );
        assert_eq!(file.objects[0].entry_name.as_deref(), Some("S"));
    }
}
