//! Converts entries of a device file to objects of a dictionary.

use super::printable::replace_controls;
use crate::profile::DataType;
use crate::profile::device_file::{self, DescriptionProblem, DeviceFile, DeviceObject};
use crate::profile::dictionary::Dictionary;
use crate::profile::entry::{ObjectEntry, SubEntry};
use crate::profile::object::{
    DefaultValue, NumberFormat, ONCE, SdoAccess, ValueInterpretation, ValueStorage, VariantFilter,
    WriteEffect,
};
use crate::wire::canopen::ObjectAddress;

/// Largest node-ID.
const LAST_NODE: i128 = 127;

/// Converted objects, and problems with omitted parts.
pub(super) struct ImportedObjects {
    pub(super) list: Vec<ObjectEntry>,
    pub(super) problems: Vec<DescriptionProblem>,
}

/// Converts the entries that are `wanted`. Definitions of the standards take precedence, except for access,
/// default and limits.
pub(super) fn import_objects(
    file: &DeviceFile,
    standards: &Dictionary,
    wanted: impl Fn(ObjectAddress) -> bool,
) -> ImportedObjects {
    let wanted: Vec<&DeviceObject> = file.objects.iter().filter(|object| wanted(object.address)).collect();
    let mut objects = ImportedObjects { list: Vec::new(), problems: Vec::new() };
    for entries in wanted.chunk_by(|first, second| first.address.index == second.address.index) {
        let Some(first) = entries.first() else { continue };
        let entries: Vec<SubEntry> =
            entries.iter().map(|entry| objects.import_entry(entry, standards)).collect();
        objects.list.push(ObjectEntry {
            index: first.address.index,
            repeat: ONCE,
            name: object_name(first, standards),
            is_record: entries.len() > 1 || first.address.sub != 0,
            entries,
            only: VariantFilter::default(),
            source: String::new(),
            span: 0..0,
        });
    }
    objects
}

fn object_name(object: &DeviceObject, standards: &Dictionary) -> String {
    match standards.find_object(object.address) {
        Some(found) => found.object_name(),
        None if object.object_name.is_empty() => format!("Object {:04X}", object.address.index),
        None => strip_number(&object.object_name),
    }
}

/// Name without the placeholder of repeat numbers and without terminal control characters.
fn strip_number(name: &str) -> String {
    replace_controls(name).replace("{n}", "(n)")
}

impl ImportedObjects {
    fn import_entry(&mut self, object: &DeviceObject, standards: &Dictionary) -> SubEntry {
        let found = standards.find_object(object.address);
        let same = found.filter(|found| {
            let known = found.entry.and_then(|entry| entry.data_type);
            known.is_some() && (object.data_type.is_none() || object.data_type == known)
        });
        let mut entry = same.and_then(|found| found.lone_entry()).unwrap_or_else(|| plain_entry(object));
        entry.source.clear();
        entry.access = object.access.map(profile_access).or(entry.access);
        entry.note = object.denotation.as_deref().map(replace_controls).unwrap_or_default();
        let Some(data_type) = entry.data_type else { return entry };
        if let Some(given) = &object.default {
            entry.default = default(given, data_type);
            if entry.default.is_none() {
                let reason =
                    format!("{}: default is not a valid {}; ignored", object.address, data_type.name());
                self.problems.push(DescriptionProblem { line: object.line, reason });
            }
        }
        entry.look.range = narrower_limits(object, data_type).or(entry.look.range);
        if let (Some([least, most]), Some(DefaultValue::Number(default))) = (entry.look.range, &entry.default)
            && !(least..=most).contains(default)
        {
            let reason = format!(
                "{}: default {default} is outside its limits {least} to {most}; limits ignored",
                object.address
            );
            self.problems.push(DescriptionProblem { line: object.line, reason });
            entry.look.range = None;
        }
        entry
    }
}

/// Entry without a definition in a standard.
fn plain_entry(object: &DeviceObject) -> SubEntry {
    let name = object.entry_name.as_deref().filter(|name| !name.is_empty()).map(strip_number);
    SubEntry {
        sub: object.address.sub,
        to: object.address.sub,
        data_type: object.data_type,
        access: None,
        format: NumberFormat::Decimal,
        look: ValueInterpretation { name, ..ValueInterpretation::default() },
        modes: Vec::new(),
        default: None,
        storage: ValueStorage::Unknown,
        save: None,
        effect: WriteEffect::Unknown,
        invalidates: Vec::new(),
        channel: None,
        open_loop: Vec::new(),
        only: VariantFilter::default(),
        source: String::new(),
        note: String::new(),
        span: 0..0,
    }
}

/// Access in a profile; process inputs and outputs are read-write.
const fn profile_access(access: device_file::EntryAccess) -> SdoAccess {
    match access {
        device_file::EntryAccess::Ro => SdoAccess::Ro,
        device_file::EntryAccess::Wo => SdoAccess::Wo,
        device_file::EntryAccess::Rw | device_file::EntryAccess::Rwr | device_file::EntryAccess::Rww => {
            SdoAccess::Rw
        }
        device_file::EntryAccess::Const => SdoAccess::Const,
    }
}

/// Default as written in a profile; `None` if it is invalid for its type.
fn default(given: &device_file::EntryValue, data_type: DataType) -> Option<DefaultValue> {
    let holds =
        |number: i128| type_bounds(data_type).is_some_and(|[least, most]| (least..=most).contains(&number));
    let is_number = data_type.bits().is_some();
    Some(match given {
        device_file::EntryValue::Number(number) if holds(*number) => match i64::try_from(*number) {
            Ok(number) => DefaultValue::Number(number),
            Err(_) => DefaultValue::Text(format!("{number:#X}")),
        },
        device_file::EntryValue::Formula { offset }
            if data_type.is_integer() && holds(i128::from(*offset) + LAST_NODE) =>
        {
            DefaultValue::Text(if *offset == 0 {
                "$NODEID".to_owned()
            } else {
                format!("$NODEID+{offset:#X}")
            })
        }
        device_file::EntryValue::Real(number) if matches!(data_type, DataType::Real32 | DataType::Real64) => {
            DefaultValue::Real(*number)
        }
        device_file::EntryValue::Text(text) if !is_number => DefaultValue::Text(text.clone()),
        device_file::EntryValue::Bytes(bytes) if !is_number => {
            let pairs: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            DefaultValue::Text(pairs.join(" "))
        }
        _ => return None,
    })
}

/// Range of an integer type; `None` for other types.
fn type_bounds(data_type: DataType) -> Option<[i128; 2]> {
    let bits = u32::from(data_type.bits()?);
    match data_type {
        DataType::Real32 | DataType::Real64 => None,
        _ if data_type.is_signed() => {
            let limit = 1_i128 << (bits - 1);
            Some([-limit, limit - 1])
        }
        _ => Some([0, (1_i128 << bits) - 1]),
    }
}

/// Limits of an integer, if narrower than its type.
fn narrower_limits(object: &DeviceObject, data_type: DataType) -> Option<[i64; 2]> {
    let [least, most] = type_bounds(data_type).filter(|_| data_type.is_integer())?;
    let limit = |given: &Option<device_file::EntryValue>, fallback| match given {
        None => Some(fallback),
        Some(device_file::EntryValue::Number(number)) => Some(*number),
        Some(_) => None,
    };
    let (low, high) = (limit(&object.low, least)?, limit(&object.high, most)?);
    let says_more = low <= high && low >= least && high <= most && (low, high) != (least, most);
    says_more.then_some([i64::try_from(low).ok()?, i64::try_from(high).ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::plain_device;

    fn of(text: &str) -> ImportedObjects {
        let file = device_file::parse_device_file(text.as_bytes()).unwrap();
        import_objects(&file, &plain_device().dictionary, |_| true)
    }

    #[test]
    fn what_a_standard_knows_better_is_the_standard_s() {
        let objects = of("[1017]\nParameterName=HB\nDataType=6\nAccessType=rw\nDefaultValue=500\n\
            [1A03]\nParameterName=x\nObjectType=9\n[1A03sub1]\nParameterName=y\nDataType=7\nAccessType=ro\nDefaultValue=0x60410010\n\
            [1015]\nParameterName=Wrong type\nDataType=7\nAccessType=rw\n");
        let [inhibit, heartbeat, mapping] = &objects.list[..] else { panic!("{:?}", objects.list) };
        assert_eq!(
            (heartbeat.name.as_str(), heartbeat.entries[0].effect),
            ("Producer heartbeat time", WriteEffect::AtOnce)
        );
        assert_eq!(heartbeat.entries[0].default, Some(DefaultValue::Number(500)));
        assert_eq!((mapping.name.as_str(), mapping.is_record), ("TPDO mapping parameter", true));
        let entry = &mapping.entries[0];
        assert_eq!(
            (entry.sub, entry.to, entry.format, entry.access),
            (1, 1, NumberFormat::Mapping, Some(SdoAccess::Ro))
        );
        // In units of 100 µs it would be UNSIGNED16.
        assert_eq!(
            (inhibit.entries[0].look.unit.as_deref(), inhibit.entries[0].data_type),
            (None, Some(DataType::Unsigned32))
        );
    }

    #[test]
    fn limits_count_where_they_say_more_than_the_type() {
        let range = |keys: &str| {
            let objects = of(&format!("[2000]\nParameterName=a\nAccessType=rw\n{keys}"));
            (objects.list[0].entries[0].look.range, objects.problems.len())
        };
        assert_eq!(range("DataType=2\nLowLimit=-5\nHighLimit=5"), (Some([-5, 5]), 0));
        assert_eq!(range("DataType=5\nLowLimit=1"), (Some([1, 255]), 0));
        assert_eq!(range("DataType=5\nLowLimit=0\nHighLimit=0xFF"), (None, 0));
        assert_eq!(range("DataType=5\nLowLimit=9\nHighLimit=5"), (None, 0));
        assert_eq!(range("DataType=5\nLowLimit=$NODEID\nHighLimit=5"), (None, 0));
        assert_eq!(range("DataType=8\nLowLimit=1\nHighLimit=5"), (None, 0));
        assert_eq!(range("DataType=5\nHighLimit=5\nDefaultValue=6"), (None, 1));
    }

    #[test]
    fn defaults_of_all_kinds() {
        let of = |data_type: u8, value: &str| {
            let text =
                format!("[2000]\nParameterName=a\nAccessType=rw\nDataType={data_type}\nDefaultValue={value}");
            of(&text).list[0].entries[0].default.clone()
        };
        let text = |text: &str| Some(DefaultValue::Text(text.to_owned()));
        assert_eq!(of(3, "0xFFB2"), Some(DefaultValue::Number(-78)));
        assert_eq!(of(7, "$NODEID + 0x80000200"), text("$NODEID+0x80000200"));
        assert_eq!(of(5, "$NODEID"), text("$NODEID"));
        assert_eq!(of(0x1B, "0xFFFFFFFFFFFFFFFF"), text("0xFFFFFFFFFFFFFFFF"));
        assert_eq!(of(8, "1.5"), Some(DefaultValue::Real(1.5)));
        assert_eq!(of(9, "abc"), text("abc"));
        assert_eq!(of(10, "c83d"), text("C8 3D"));
        assert_eq!(of(5, "256"), None);
        assert_eq!(of(5, "$NODEID+0x81"), None);
    }

    #[test]
    fn what_is_no_value_of_the_standard_s_type_is_left_out() {
        let objects = of("[1000]\nParameterName=a\nAccessType=ro\nDefaultValue=by the maker\n");
        let reasons: Vec<_> = objects.problems.iter().map(|problem| problem.reason.as_str()).collect();
        assert_eq!(reasons, ["1000:00: default is not a valid UNSIGNED32; ignored"]);
        assert_eq!(objects.list[0].entries[0].default, None);
    }
}
