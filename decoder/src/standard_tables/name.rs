//! Texts of the codes in a J1939 NAME: manufacturer and function.

use super::table::{FILES, TableIndex};
use crate::wire::j1939::NameFields;

/// Industry groups of a NAME (J1939-81 §4.1.1.2).
const AGRICULTURE: u8 = 2;
const MARINE: u8 = 4;

/// Last function that does not depend on industry group and vehicle system (J1939-81 §4.1.1.5).
const LAST_GLOBAL: u8 = 127;

fn index() -> &'static TableIndex {
    let [.., names] = &FILES;
    names.index()
}

fn find_text(table: &str, number: u64) -> Option<&'static str> {
    index().values(table)?.find_text(number)
}

/// Manufacturer of a NAME. NMEA 2000 and J1939 have separate lists of the same codes.
pub fn manufacturer_name(name: &NameFields) -> Option<&'static str> {
    let code = u64::from(name.manufacturer_code);
    let tables = if name.industry_group == MARINE {
        ["MANUFACTURER_NMEA2000", "MANUFACTURER_J1939"]
    } else {
        ["MANUFACTURER_J1939", "MANUFACTURER_NMEA2000"]
    };
    tables.into_iter().find_map(|table| find_text(table, code))
}

/// Function of a NAME; the vehicle system of a marine device if its function is unknown.
pub fn function_name(name: &NameFields) -> Option<&'static str> {
    let (system, function) = (u64::from(name.device_class), u64::from(name.function));
    match (name.industry_group, name.function) {
        (MARINE, _) => {
            let found = find_text("FUNCTION_MARINE", system << 8 | function);
            found.or_else(|| find_text("CLASS_MARINE", system))
        }
        (_, ..=LAST_GLOBAL) => find_text("FUNCTION_GLOBAL", function),
        (AGRICULTURE, _) => find_text("FUNCTION_AGRICULTURE", function),
        (0, _) if system == 0 => find_text("FUNCTION_NON_SPECIFIC", function),
        _ => None,
    }
}

/// Function with its instance and manufacturer, as far as they are known: `engine #1, Cummins`.
pub fn describe_name(name: &NameFields) -> Option<String> {
    let instance = u32::from(name.function_instance).saturating_add(1);
    let function = function_name(name).map(|function| format!("{function} #{instance}"));
    let parts: Vec<_> = function.into_iter().chain(manufacturer_name(name).map(str::to_owned)).collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::j1939::J1939Name;

    /// NAME with industry group, device class, function, function instance and manufacturer (J1939-81 figure 1).
    fn fields(industry: u64, class: u64, function: u64, instance: u64, manufacturer: u64) -> NameFields {
        J1939Name(industry << 60 | class << 49 | function << 40 | instance << 35 | manufacturer << 21)
            .fields()
    }

    #[test]
    fn names_of_trucks_boats_and_tractors() {
        let described = |fields: NameFields| describe_name(&fields);
        assert_eq!(described(fields(0, 0, 0, 0, 10)).unwrap(), "engine #1, Cummins");
        // Marine: class 60 navigation, function 145 ownship position; 137 is Maretron in NMEA 2000.
        assert_eq!(described(fields(4, 60, 145, 0, 137)).unwrap(), "Ownship Position (GNSS) #1, Maretron");
        assert_eq!(described(fields(2, 5, 132, 1, 0x7FF)).unwrap(), "machine control #2");
        // Function 200 of another industry depends on tables that are not here; code 2046 is not assigned.
        assert_eq!(described(fields(1, 9, 200, 0, 2046)), None);
    }
}
