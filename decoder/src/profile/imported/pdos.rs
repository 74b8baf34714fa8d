//! Default PDO mappings, if the file defines them completely and all mapped objects are known.

use crate::profile::dictionary::Dictionary;
use crate::profile::entry::ObjectEntry;
use crate::profile::{DataType, PdoName};
use crate::wire::canopen::ObjectAddress;

/// Last index of the data types, which serve as gaps in a mapping (CiA 301 §7.4.7.1).
const LAST_DUMMY: u16 = 0x1F;

/// Max entries of a mapping, and max bits of a frame (CiA 301 §7.5.2.36).
const MOST_ENTRIES: i64 = 64;
const FRAME_BITS: u16 = 64;

/// Contents of a PDO: objects with their length in bits; `None` for a gap.
pub(super) struct ImportedPdo {
    pub(super) name: PdoName,
    pub(super) fields: Vec<(Option<ObjectAddress>, u16)>,
}

/// PDOs with a default mapping, and reasons why others are omitted.
pub(super) fn import_pdos(
    objects: &[ObjectEntry],
    dictionary: &Dictionary,
) -> (Vec<ImportedPdo>, Vec<String>) {
    let (mut pdos, mut left_out) = (Vec::new(), Vec::new());
    for object in objects {
        let communication = object.index.checked_sub(0x200).and_then(PdoName::of_parameter);
        let Some(name) = communication.filter(|name| name.mapping_index() == object.index) else { continue };
        match pdo_fields(name, dictionary) {
            Ok(fields) if fields.is_empty() => {}
            Ok(fields) => pdos.push(ImportedPdo { name, fields }),
            Err(reason) => left_out.push(format!("{name} omitted: {reason}")),
        }
    }
    (pdos, left_out)
}

/// Fields of a PDO; empty if nothing is mapped.
fn pdo_fields(name: PdoName, dictionary: &Dictionary) -> Result<Vec<(Option<ObjectAddress>, u16)>, String> {
    let default = |sub| {
        let address = ObjectAddress::new(name.mapping_index(), sub);
        dictionary.find_object(address).and_then(|found| found.entry?.default_number(None))
    };
    let mut fields = Vec::new();
    let Some(count @ 1..=MOST_ENTRIES) = default(0) else { return Ok(fields) };
    let mut bits: u16 = 0;
    for place in 1..=u8::try_from(count).unwrap_or(0) {
        let Some(entry) = default(place) else {
            return Err(format!("entry {place} of {count} has no default"));
        };
        // Bits 31..16 index, 15..8 sub-index, 7..0 length in bits (CiA 301 figure 70).
        let [width, sub, low, high, ..] = entry.to_le_bytes();
        let object = ObjectAddress::new(u16::from_le_bytes([low, high]), sub);
        let width = u16::from(width);
        bits = bits.saturating_add(width);
        if width == 0 {
            return Err(format!("entry {place} of {count} has a length of 0 bits"));
        }
        if bits > FRAME_BITS {
            return Err(format!("length {bits} bits with {object} (max {FRAME_BITS})"));
        }
        if object.index <= LAST_DUMMY {
            fields.push((None, width));
            continue;
        }
        let entry = dictionary.find_object(object).and_then(|found| found.entry);
        let Some(entry) = entry else { return Err(format!("unknown object {object}")) };
        if entry.data_type.and_then(DataType::bits).is_some_and(|known| known < width) {
            return Err(format!("{object}: field of {width} bits does not fit the object"));
        }
        fields.push((Some(object), width));
    }
    Ok(fields)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::sync::Arc;

    use super::*;
    use crate::profile::device_file;

    fn of(mapping: &[&str]) -> (Vec<ImportedPdo>, Vec<String>) {
        let mut text = format!(
            "[6041]\nParameterName=s\nDataType=6\nAccessType=ro\n[1A02]\nParameterName=m\nObjectType=9\n\
             [1A02sub0]\nParameterName=n\nDataType=5\nAccessType=rw\nDefaultValue={}",
            mapping.len()
        );
        for (sub, entry) in (1..).zip(mapping) {
            let keys = "ParameterName=e\nDataType=7\nAccessType=rw";
            write!(text, "\n[1A02sub{sub}]\n{keys}\nDefaultValue={entry}").unwrap();
        }
        let file = Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap());
        let device = super::super::describe_device(&file, "x.eds");
        import_pdos(device.dictionary.own_objects(), &device.dictionary)
    }

    #[test]
    fn mappings_with_known_objects_are_pdos() {
        let (pdos, left_out) = of(&["0x60410010", "0x00050008", "0x10010008"]);
        assert_eq!((pdos.len(), left_out.len()), (1, 0));
        assert_eq!(pdos[0].name.to_string(), "TPDO3");
        let objects: Vec<_> =
            pdos[0].fields.iter().map(|(object, bits)| (object.map(|it| it.to_string()), *bits)).collect();
        assert_eq!(objects, [(Some("6041:00".into()), 16), (None, 8), (Some("1001:00".into()), 8)]);
        assert!(of(&[]).0.is_empty());
    }

    #[test]
    fn other_pdos_are_reported() {
        let reason = |mapping: &[&str]| of(mapping).1.join("");
        assert_eq!(reason(&["0x60420010"]), "TPDO3 omitted: unknown object 6042:00");
        assert_eq!(
            reason(&["0x60410020"]),
            "TPDO3 omitted: 6041:00: field of 32 bits does not fit the object"
        );
        assert_eq!(reason(&[""]), "TPDO3 omitted: entry 1 of 1 has no default");
        let five = ["0x60410010"; 5];
        assert_eq!(reason(&five), "TPDO3 omitted: length 80 bits with 6041:00 (max 64)");
        assert_eq!(reason(&["0"]), "TPDO3 omitted: entry 1 of 1 has a length of 0 bits");
    }
}
