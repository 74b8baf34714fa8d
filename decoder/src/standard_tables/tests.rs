//! Values of hand-made payloads, and arbitrary payloads of every group.

use proptest::prelude::*;

use super::group::standard_group;
use super::standard::Standard;
use super::table::FILES;
use crate::profile::PayloadLayout;
use crate::wire::j1939::Pgn;

/// Name and text of each value.
fn texts(layout: &PayloadLayout, payload: &[u8]) -> Vec<(String, String)> {
    let named = |name: Option<&str>| name.unwrap_or_default().to_owned();
    layout.decode_signals(payload).map(|signal| (named(signal.name()), signal.text())).collect()
}

fn values(standard: Standard, pgn: u32, payload: &[u8]) -> Vec<String> {
    let group = standard_group(&[standard], Pgn::new(pgn), payload).unwrap();
    texts(&group.layout, payload).into_iter().map(|(name, text)| format!("{name} = {text}")).collect()
}

#[test]
fn numbers_states_and_missing_values_of_nmea_2000() {
    // 3D09h = 15625 × 0.0001 rad; 7FFF: not available, 7FFE: error; 1: magnetic; six reserved bits.
    assert_eq!(
        values(Standard::Nmea2000, 127_250, &[1, 0x09, 0x3D, 0xFF, 0x7F, 0xFE, 0x7F, 0xFD]),
        [
            "SID = 1",
            "Heading = 1.5625 rad",
            "Deviation = not available",
            "Variation = error",
            "Reference = Magnetic (1)"
        ]
    );
}

#[test]
fn dates_times_and_positions() {
    // 4B2Dh = 19245 days: 2022-09-10. 1A7FC108h = 444580104 × 0.0001 s = 44458.0104 s: 12:20:58.0104.
    // Local offset FFC4h = -60 × 60 s.
    assert_eq!(
        values(Standard::Nmea2000, 129_033, &[0x2D, 0x4B, 0x08, 0xC1, 0x7F, 0x1A, 0xC4, 0xFF]),
        ["Date = 2022-09-10", "Time = 12:20:58.0104", "Local Offset = -3600 s"]
    );
}

#[test]
fn repeated_fields_have_numbers() {
    // 129029 with two reference stations: types 0 and 1, IDs 1 and 2, ages 0.01 s and 0.02 s.
    let mut payload = vec![0; 43];
    payload[42] = 2;
    payload.extend([0x10, 0x00, 0x01, 0x00, 0x21, 0x00, 0x02, 0x00]);
    let found = values(Standard::Nmea2000, 129_029, &payload);
    assert_eq!(
        found[found.len() - 6..],
        [
            "Reference Station Type 1 = GPS (0)",
            "Reference Station ID 1 = 1",
            "Age of DGNSS Corrections 1 = 0.01 s",
            "Reference Station Type 2 = GLONASS (1)",
            "Reference Station ID 2 = 2",
            "Age of DGNSS Corrections 2 = 0.02 s"
        ]
    );
    // An unavailable count is none, and a payload that ends early has only the complete fields.
    payload[42] = 0xFF;
    assert!(values(Standard::Nmea2000, 129_029, &payload).last().unwrap().starts_with("Reference Stations"));
    payload[42] = 2;
    payload.truncate(46);
    assert_eq!(values(Standard::Nmea2000, 129_029, &payload).last().unwrap(), "Reference Station ID 1 = 1");
}

#[test]
fn texts_of_variable_length() {
    // 126998: length with itself and the encoding, encoding 1 or 0 (UTF-16), characters.
    let payload = [4, 1, b'A', b'b', 6, 0, 0x41, 0x00, 0xE9, 0x00, 2, 1];
    assert_eq!(
        values(Standard::Nmea2000, 126_998, &payload),
        [
            "Installation Description #1 = \"Ab\"",
            "Installation Description #2 = \"Aé\"",
            "Manufacturer Information = \"\""
        ]
    );
}

#[test]
fn product_information_with_and_without_its_end() {
    let mut payload = vec![0x34, 0x08, 0xC5, 0x79];
    for text in ["CORTEX", "1.08", "M1", "A3"] {
        let mut field = text.as_bytes().to_vec();
        field.resize(32, 0xFF);
        payload.extend(field);
    }
    let expected = [
        "NMEA 2000 Version = 2.100",
        "Product Code = 31173",
        "Model ID = \"CORTEX\"",
        "Software Version Code = \"1.08\"",
        "Model Version = \"M1\"",
        "Model Serial Code = \"A3\"",
    ];
    assert_eq!(values(Standard::Nmea2000, 126_996, &payload), expected);
    payload.extend([2, 1]);
    assert_eq!(
        values(Standard::Nmea2000, 126_996, &payload)[6..],
        ["Certification Level = 2", "Load Equivalency = 1"]
    );
}

#[test]
fn messages_of_manufacturers_by_their_required_numbers() {
    // Manufacturer 419 (Fusion), industry 4: 99A3h. Message 7 is the album: source, index, length, text, 0.
    let payload = [0xA3, 0x99, 7, 0x80, 11, 6, 0, 0, 0, 2, b'O', b'K', 0];
    let group = standard_group(&[Standard::Nmea2000], Pgn::new(130_820), &payload).unwrap();
    assert_eq!(&*group.name, "Fusion: Album Name");
    assert_eq!(texts(&group.layout, &payload).last().unwrap(), &("Album".to_owned(), "\"OK\"".to_owned()));
    // An unknown message of a known manufacturer: manufacturer, industry, data.
    let payload = [0xA3, 0x99, 0xF7, 1, 2, 3, 4, 5];
    let found = values(Standard::Nmea2000, 65_400, &payload);
    assert_eq!(
        found,
        [
            "Manufacturer Code = Fusion Electronics (419)",
            "Industry Code = Marine Industry (4)",
            "Data = F7 01 02 03 04 05"
        ]
    );
}

#[test]
fn keys_select_the_next_value() {
    // 61184 of Victron (358): register ED8Dh is the voltage of channel 1 in 0.01 V: 04F8h = 12.72 V.
    let found = values(Standard::Nmea2000, 61_184, &[0x66, 0x99, 0x8D, 0xED, 0xF8, 0x04, 0xFF, 0xFF]);
    assert_eq!(found.last().unwrap(), "Channel 1 Voltage = 12.72 V");
}

#[test]
fn parameters_of_other_groups_in_a_group_function() {
    // Command (1) for 127250 (01F112h): priority 8 (unchanged), one parameter: field 2 (heading) = 3D09h.
    let payload = [1, 0x12, 0xF1, 0x01, 0xF8, 1, 2, 0x09, 0x3D];
    let found = values(Standard::Nmea2000, 126_208, &payload);
    assert_eq!(found[1], "PGN = 127250 vessel heading");
    assert_eq!(found.last().unwrap(), "Heading = 1.5625 rad");
    // 130850 (01FF22h) has several definitions, which start with 11 bits of manufacturer (1857 in two bytes), two reserved
    // bits (parameter 2) and three bits of industry (in one byte).
    let payload = [1, 0x22, 0xFF, 0x01, 0xF8, 2, 1, 0x41, 0x07, 3, 0x04];
    let found = values(Standard::Nmea2000, 126_208, &payload);
    let expected = [
        "Parameter 1 = 1",
        "Manufacturer Code = Simrad (1857)",
        "Parameter 2 = 3",
        "Industry Code = Marine Industry (4)",
    ];
    assert_eq!(found[found.len() - 4..], expected);
}

#[test]
fn parameters_of_j1939() {
    // EEC1: torque mode 1, high resolution 2 × 0.125 %; demand 7Dh - 125 = 0 %; actual 96h - 125 = 25 %;
    // speed 35F0h × 0.125 = 1726 rpm; source FFh; starter mode Fh; demand FEh.
    assert_eq!(
        values(Standard::J1939, 61_444, &[0x21, 0x7D, 0x96, 0xF0, 0x35, 0xFF, 0xFF, 0xFE]),
        [
            "Engine Torque Mode = accelerator pedal (1)",
            "Actual Engine - Percent Torque High Resolution = 0.250 %",
            "Driver's Demand Engine - Percent Torque = 0 %",
            "Actual Engine - Percent Torque = 25 %",
            "Engine Speed = 1726.000 rpm",
            "Source Address of Controlling Device for Engine Control = not available",
            "Engine Starter Mode = not available (15)",
            "Engine Demand - Percent Torque = error"
        ]
    );
    // Coolant 7Dh - 40 = 85 °C; oil 2D00h × 0.03125 - 273 = 87 °C.
    let found = values(Standard::J1939, 65_262, &[0x7D, 0xFF, 0x00, 0x2D, 0xFF, 0xFF, 0xFF, 0xFF]);
    assert_eq!(
        (found[0].as_str(), found[2].as_str()),
        ("Engine Coolant Temp = 85 °C", "Engine Oil Temp 1 = 87.0000 °C")
    );
}

#[test]
fn identifications_are_texts_up_to_an_asterisk() {
    assert_eq!(
        values(Standard::J1939, 65_259, b"CMMNS*6C u07D*123456**"),
        ["Make = \"CMMNS\"", "Model = \"6C u07D\"", "Serial Number = \"123456\"", "Unit Number = \"\""]
    );
    assert_eq!(values(Standard::J1939, 65_260, b"1FUJ*"), ["Vehicle Identification Number = \"1FUJ\""]);
}

#[test]
fn groups_of_rv_c() {
    // DC_SOURCE_STATUS_1: instance 1, priority 120, 00F4h × 0.05 = 12.2 V, 2_000_000_000 × 0.001 - 2_000_000 = 0 A.
    let found = values(Standard::RvC, 0x1_FFFD, &[1, 120, 0xF4, 0, 0x00, 0x94, 0x35, 0x77]);
    assert_eq!(found[2..], ["dc voltage = 12.20 V", "dc current = 0.000 A"]);
    assert_eq!(found[0], "instance = main house battery bank (1)");
}

#[test]
fn a_single_frame_that_is_too_short_lacks_its_last_fields() {
    let payload = [1, 0x09];
    let group = standard_group(&[Standard::Nmea2000], Pgn::new(127_250), &payload).unwrap();
    assert_eq!(texts(&group.layout, &payload).len(), 1);
    assert_eq!(group.layout.missing_fields(&payload).count(), 4);
}

#[test]
fn equal_lengths_share_a_layout() {
    let group =
        |payload: &[u8]| standard_group(&[Standard::Nmea2000], Pgn::new(126_998), payload).unwrap().layout;
    let first = group(&[3, 1, b'A', 2, 1, 2, 1]);
    assert!(std::sync::Arc::ptr_eq(&first, &group(&[3, 1, b'B', 2, 1, 2, 1])));
    assert!(!std::sync::Arc::ptr_eq(&first, &group(&[2, 1, 2, 1, 2, 1])));
}

/// Group and payload of any table; the payload starts with the required numbers of one of its definitions or with any bytes.
fn payload() -> impl Strategy<Value = (usize, usize, Vec<u8>)> {
    (0..3_usize, any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 0..300))
        .prop_map(|(file, group, payload)| (file, group.index(10_000), payload))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 2_000, ..ProptestConfig::default() })]

    #[test]
    fn any_payload_has_fields_within_it((file, group, payload) in payload()) {
        let standard = [Standard::J1939, Standard::Nmea2000, Standard::RvC][file];
        let numbers: Vec<u32> = FILES[file].index().numbers().collect();
        let pgn = Pgn::new(numbers[group % numbers.len()]);
        if let Some(found) = standard_group(&[standard], pgn, &payload) {
            let is_single = payload.len() <= 8;
            for field in &found.layout.fields {
                prop_assert!(field.meaning.is_some());
                prop_assert!(is_single || usize::from(field.end().unwrap()) <= payload.len() * 8);
            }
            prop_assert!(is_single || found.layout.missing_fields(&payload).count() == 0);
            texts(&found.layout, &payload);
        }
    }
}
