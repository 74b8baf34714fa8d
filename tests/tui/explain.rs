//! `cobscope explain`.

use std::collections::{BTreeMap, BTreeSet};

use cobscope_decoder::profile::Catalogue;

use crate::cli::run;
use crate::support::step;

fn explain(thing: &str) -> String {
    let output = run(&["explain", thing], "");
    assert_eq!(output.code, 0, "{thing}: {}", output.stderr);
    output.stdout
}

#[test]
fn codes_objects_and_identifiers() {
    // CiA 301 table 22 and §7.2.7.1; §7.5.2.14; §7.3.3.
    assert!(explain("0x06020000").starts_with("06020000  SDO abort code: object does not exist\n"));
    assert!(explain("8130").starts_with("8130  EMCY error code: heartbeat or life-guard error\n"));
    assert!(explain("8130").contains("\n      CiA 301: Life guard error or heartbeat error\n"));
    assert!(
        explain("06020000").contains("\n          CiA 301: Object does not exist in the object dictionary\n")
    );
    assert!(explain("1017").starts_with("1017:00  object: Producer heartbeat time, UNSIGNED16, in ms\n"));
    for form in ["1018:01", "0x1018:01", "1018h:01h", "1018sub1"] {
        assert_eq!(explain(form), "1018:01  object: Identity object, Vendor-ID, UNSIGNED32\n");
    }
    assert!(explain("185").contains("TPDO1, sent by node 5/05"));
    assert!(explain("0x60A").contains("SDO request to node 10/0A"));
    assert!(explain("6E5").contains("restricted"));
}

#[test]
fn one_pasted_frame() {
    let heartbeat = explain("705#05");
    assert!(heartbeat.contains("node 5/05") && heartbeat.contains("state: operational"), "{heartbeat}");
    // 0x2B: download, expedited, two bytes; 1017:00.
    let written = explain("601#2B171000E8030000");
    assert!(written.contains("initiate download of 1017:00, expedited, 2 bytes"), "{written}");
    assert!(written.contains("\n     1017:00 Producer heartbeat time = 1000 ms\n"), "{written}");
    assert!(explain("601#4018100100000000").ends_with("     1018:01 Identity object, Vendor-ID\n"));
    let segment = explain("581#8101020304050607");
    assert!(segment.contains("segment 1 (last)") && !segment.contains("REFUSED"), "{segment}");
    assert!(explain("581#8017100000000206").contains("REFUSED 06020000"));
}

#[test]
fn a_line_of_any_capture_is_explained() {
    for line in [
        "601 40 41 60 00 00 00 00 00",
        "0.125 Tx 601 8 40 41 60 00 00 00 00 00",
        "ID: 0x601 DLC: 8 Data: 0x40 0x41 0x60 0x00 0x00 0x00 0x00 0x00",
    ] {
        assert!(explain(line).contains("6041:00"), "{line}: {}", explain(line));
    }
}

/// Bytes by hand from CiA 301 §7.2.4.3.17 and §7.2.4.3.5, §7.2.7.1, ISO 14229-1 and SAE J2012.
#[test]
fn bytes_without_an_identifier_are_messages() {
    for bytes in
        ["80 00 00 00 00 00 04 05", "8000000000000405", "0x80, 0x00, 0x00, 0x00, 0x00, 0x00, 0x04, 0x05"]
    {
        let abort = explain(bytes);
        assert!(abort.contains("05040000  SDO abort code: SDO timed out"), "{abort}");
        assert_eq!(abort.matches("SDO abort code:").count(), 1, "{abort}");
    }
    assert_eq!(
        explain("40 41 60 00 00 00 00 00").lines().next(),
        Some("SDO request: initiate upload of 6041:00")
    );
    assert!(explain("4B 17 10 00 E8 03 00 00").contains("1017:00 Producer heartbeat time = 1000 ms"));
    for emcy in ["30 81 11 00 00 00 00 00", "8130 11 00 00 00 00 00", "EMCY 8130"] {
        assert!(explain(emcy).starts_with("8130  EMCY error code: heartbeat or life-guard error"), "{emcy}");
    }
    assert!(explain("8130 11 00 00 00 00 00").contains("register     11 (generic, communication)"));
    let refused = explain("7F 22 31");
    assert!(
        refused.starts_with("UDS: negative response to 22")
            && refused.contains("\n31  UDS negative response")
    );
    assert!(explain("03 22 F1 90 00 00 00 00").starts_with("UDS in a single frame: request 22"));
}

/// CiA 301 §7.5.2.5, §7.5.2.8, §7.5.2.17, §7.5.2.37; bits of the status word: CiA 402-2.
#[test]
fn values_with_bits_are_explained() {
    assert!(explain("8000018A").starts_with("8000018A  COB-ID: PDO on 18A, not valid (bit 31)\n"));
    assert!(explain("40000080").starts_with("40000080  COB-ID: SYNC on 080, produces SYNC (bit 30)\n"));
    assert!(explain("0x20000123").contains("29-bit identifier (bit 29)"));
    assert!(explain("06090030").starts_with("06090030  SDO abort code"));
    for value in ["6041=0670", "6041:00 = 0x0670", "status word 0670", "Statusword: 0670h"] {
        let text = explain(value);
        assert!(text.contains("cia402: Statusword: 0670h voltage enabled"), "{text}");
        assert!(text.contains("switch on disabled"), "{text}");
    }
}

#[test]
fn trouble_codes_have_names_and_bytes() {
    assert!(explain("U0064-87").starts_with("U0064-87  UDS trouble code C0 64 87: network"));
    assert!(explain("u006487").contains("failure type 87 bus signal or message failure"));
    assert!(explain("P0102").starts_with("P0102  UDS trouble code 01 02: powertrain"));
    assert!(explain("B1234-13").starts_with("B1234-13  UDS trouble code 92 34 13: body"));
    for fault in ["SPN 298985 FMI 19", "spn: 298985, fmi: 19", "298985/19"] {
        assert!(explain(fault).starts_with("SPN 298985 FMI 19"), "{fault}");
    }
    assert!(explain("NRC 0x31").starts_with("31  UDS negative response"));
}

#[test]
fn lines_of_this_program_are_explained() {
    let event = explain("    1.066  5/05              EMCY   8130 heartbeat; warning [emcy-raised] {3}");
    assert!(event.starts_with("emcy-raised  ") && event.contains("8130  EMCY error code"), "{event}");
    for (line, expected) in [
        ("    0.120  master→5          NMT    start: operational → operational? {6}", "000  COB-ID"),
        ("    0.066  5/05              PDO    TPDO1 37 02 {2}", "185  COB-ID"),
        ("    0.066  5/05              HB     operational {2}", "705  COB-ID"),
        ("        –  client→1          SDO w  1017:00 = 1000 ms ok exp {3-4}", "1017:00  object"),
        ("    0.100  client→1          SDO w  1017:00 REFUSED 06020000 {3-4}", "06020000  SDO abort code"),
    ] {
        assert!(explain(line).contains(expected), "{line}: {}", explain(line));
    }
}

#[test]
fn frames_without_blanks_and_error_frames_are_explained() {
    for line in ["t7011057FEE", "{\"id\":\"0x701\",\"data\":\"05\"}", "1;100,0;1;Rx;701;1;05"] {
        assert!(explain(line).contains("node 1/01"), "{line}: {}", explain(line));
    }
    let error = explain("20000088#0000900000000000");
    assert!(error.starts_with("20000088  error frame") && !error.contains("J1939"), "{error}");
}

#[test]
fn a_defect_of_a_frame_is_named() {
    let reported = |thing: &str| {
        let output = run(&["explain", thing], "");
        assert_eq!((output.code, output.stdout.as_str()), (2, ""), "{thing}");
        output.stderr
    };
    let digits = "cobscope: explain: found \"601#ZZ\": data digits \"ZZ\"; expected pairs of hex digits (0 to 9, A to F)\n";
    assert_eq!(reported("601#ZZ"), digits);
    assert!(reported("601#40O0").contains("data digits \"O\""));
    assert!(reported("601#401").contains("3 data digits; expected pairs of hex digits"));
    assert!(reported("6G1#40").contains("identifier \"6G1\"; expected 3 to 8 hex digits"));
    assert!(reported("601#001122334455667788").contains("9 data bytes; expected max 8"));
    assert!(reported("601#4\u{e9}").contains("data digits \"\u{e9}\""));
}

#[test]
fn an_identifier_is_no_abort_code_unless_it_can_be_one() {
    let identifier = explain("18FECA80");
    assert!(identifier.contains("DM1") && !identifier.contains("abort"), "{identifier}");
    assert!(explain("06090099").contains("SDO abort code: undefined in CiA 301"));
}

#[test]
fn a_trouble_code_in_hex_in_either_order() {
    // SPN 298985 is 48FE9, FMI 19 is 13: sent as E9 8F, then 4 << 5 | 13 = 93 (J1939-73 §5.7.1.6); with a count of 1
    // as E9 8F 93 01. The manual of the PVE prints the three bytes as a number, 938FE9.
    let device = ["--device", "danfoss-pve-ci"];
    for thing in ["0x938FE9", "938fe9", "938FE9h", "E98F93", "E98F9301", "01938FE9"] {
        let output = run(&[&["explain", thing], &device[..]].concat(), "");
        assert!(
            output.stdout.starts_with("SPN 298985 FMI 19  J1939 fault of "),
            "{thing}: {}",
            output.stdout
        );
        assert_eq!(output.stdout.matches("J1939 fault").count(), 1, "{thing}");
        assert!(explain(thing).starts_with("SPN 298985 FMI 19  J1939 fault: "), "{thing}");
    }
    // Unknown to all devices: 5B0003 is SPN 2 << 16 | 3, FMI 27 in one order, SPN 91 FMI 3 in the other.
    let both = explain("5B0003");
    assert!(both.contains("SPN 131075 FMI 27") && both.contains("SPN 91 FMI 3"), "{both}");
    // Not a fault of any device: identifiers and abort codes keep their meaning.
    assert!(!explain("18FECA80").contains("SPN"));
    assert!(explain("06020000").starts_with("06020000  SDO abort code"));
    assert_eq!(run(&["explain", "938FZ9"], "").code, 2);
}

#[test]
fn a_misspelt_rule_suggests_the_right_one() {
    let texts = |thing: &str| run(&["explain", thing], "").stderr;
    let expected = "cobscope: explain: unknown rule 'node-los'; did you mean 'node-lost'?\n";
    assert_eq!(texts("node-los"), expected);
    assert_eq!(texts("nod-lost"), expected.replace("'node-los'", "'nod-lost'"));
    assert!(texts("whatever").contains("expected a rule"));
}

#[test]
fn diagnostics() {
    // ISO 14229-1 Annex A.1 and C.1.
    let code = explain("nrc:31");
    assert!(code.starts_with("31  UDS negative response: out of range\n"), "{code}");
    assert!(code.contains("request-out-of-range") && code.contains("danfoss-pve-ci"), "{code}");
    assert!(explain("did:F190").starts_with("F190  UDS identifier: VIN\n"));
    // UDS - change Node ID: 1001 is sent 01 10; 1BC78820 is node F1 to node 20.
    let own = by("danfoss-pve-ci", "did:0x1001");
    assert!(own.contains("UDS identifier: node-ID") && own.contains("01 10"), "{own}");
    let frame = by("danfoss-pve-ci", "1BC78820#042E011021");
    assert!(frame.starts_with("ISO-TP from F1 to 20 (EDP and DP set"), "{frame}");
    assert!(
        frame.contains("request 2E write data by identifier, identifier 1001 node-ID, data 21"),
        "{frame}"
    );
    assert!(explain("1BC78820#042E011021").contains("of danfoss-pve-ci: 1001 node-ID"));
    assert!(explain("18DAF120#037F2231").contains("negative response to 22"));
    assert!(explain("18DAF120#30081400").contains("8 frames, 20000 µs"));
}

#[test]
fn anything_else_says_what_is_understood() {
    let output = run(&["explain", "pump"], "");
    assert_eq!(output.code, 2);
    assert!(output.stderr.contains("found \"pump\"; expected") && output.stderr.contains("1018sub1"));
    assert_eq!(run(&["explain", "12345#0"], "").code, 2);
}

#[test]
fn a_group_may_be_written_with_its_letters() {
    let all = ["pgn:65226", "pgn:0xFECA", "pgn:FECA"].map(|thing| run(&["explain", thing], "").stdout);
    assert!(all[0].contains("FECA") && all.iter().all(|text| *text == all[0]), "{all:?}");
}

fn by(device: &str, thing: &str) -> String {
    let output = run(&["explain", thing, "--device", device], "");
    assert_eq!(output.code, 0, "{thing}: {}", output.stderr);
    output.stdout
}

#[test]
fn an_error_code_by_the_manual() {
    // RE 30027-Z, 12 and 14.3: 8102, register 10, pre-operational; 5C00:00 = 0 sends 81 before 02.
    let expected = "\
8102  EMCY error code of SYDFEC: life guarding: master silent
      register     10 (communication)
      reaction     to NMT pre-operational
      check        the master stopped guarding
                   guard time × life time factor too short for the master's cycle
                   requests lost on a loaded or disturbed bus
      sent as      81 02: most significant byte first (5C00:00 EMCY byte order = 0, as delivered); a tool that expects
                   the order of CiA 301 shows 0281
      CiA 301      Communication
      hint         Check wiring, termination and error frames around this time.
      section      12, 14.3.1.1 of RE 30027-Z/11.06
";
    assert_eq!(by("rexroth-sydfec", "8102"), expected);
    // 5230 and 8120 are not codes of SYDFEC; CiA 301 defines 8120.
    let other = by("rexroth-sydfec", "8120");
    assert!(other.starts_with("8120  EMCY error code: not in the manual of SYDFEC\n"), "{other}");
    assert!(other.contains("CiA 301      CAN in error passive mode\n"), "{other}");
    // The MD2 sends the least significant byte first as in CiA 301, so this is not printed.
    assert!(!by("wandfluh-md2", "2311").contains("sent as"));
}

#[test]
fn a_code_read_in_the_wrong_order_is_recognised() {
    for output in [explain("0281"), by("rexroth-sydfec", "0281")] {
        assert!(
            output.contains("8102 life guarding: master silent: sent most significant byte first"),
            "{output}"
        );
    }
    // 0010 is the general error 1000 of three manuals in reverse order, but their devices send the standard
    // order.
    assert!(!explain("0010").contains("1000"));
}

#[test]
fn without_a_device_every_manual_answers() {
    let output = explain("8102");
    assert!(output.contains("rexroth-sydfec: life guarding: master silent  [12, 14.3.1.1]\n"), "{output}");
    assert!(!output.contains("danfoss"), "{output}");
    let output = explain("08000022");
    for line in ["rexroth-sydfec: service error", "wandfluh-md2: 6043:00, 6843:00"] {
        assert!(output.contains(line), "{output}");
    }
    // Objects: nominal pressure of SYDFEC; only the controller has 6601.
    assert!(
        explain("5208:02").contains("rexroth-sydfec: Command values, Nominal pressure, UNSIGNED16 rw, bar")
    );
    assert!(explain("6601:01").contains("wandfluh-md2:controller: Position actual value 1, INTEGER32 ro"));
}

#[test]
fn an_abort_code_by_the_manual() {
    let output = by("rexroth-sydfec", "06060000");
    assert!(output.starts_with("06060000  SDO abort code of SYDFEC: EEPROM loading error\n"), "{output}");
    assert!(output.contains("CiA 301      Access failed due to a hardware error\n"), "{output}");
    assert!(output.ends_with("section      11.3.1 of RE 30027-Z/11.06\n"), "{output}");
    let output = by("wandfluh-md2", "060A0023");
    assert!(
        output.contains(
            "of objects   100C:00, 100D:00: heartbeat is on: set 1017 to 0 first  [5.4.8, 5.4.9]\n"
        )
    );
    assert!(
        by("danfoss-pve-ci", "06020000").starts_with("06020000  SDO abort code: not in the manual of PVEA\n")
    );
}

#[test]
fn an_object_by_the_manual() {
    // RE 30027-Z, 10.4.1: 0 to 3FFF is 0 bar to the nominal pressure, 315 bar as delivered.
    let expected = "\
503A:00  object of SYDFEC: Pressure set point
         type         INTEGER16 ro
         role         set point
         unit         bar = raw × 5208:02 / 16383
                      5208:02 Command values, Nominal pressure, 315 bar as delivered
         range        0.0 to 315.0 bar, raw 0 to 16383
         storage      lost at reset
         section      10.4.1 of RE 30027-Z/11.06
";
    assert_eq!(by("rexroth-sydfec", "503A"), expected);
    // MD2 5.4.26: control mode of channel 2 at 6043 + 800; stored in group 3.
    let mode = by("wandfluh-md2", "6843:00");
    for line in [
        "values       -8  3-point, 2 solenoids\n",
        "channel      2, one of 8: 6043:00…9843:00\n",
        "storage      kept after a save by 1010:03\n",
        "standard     Control mode, INTEGER8 rw",
    ] {
        assert!(mode.contains(line), "{line}\n{mode}");
    }
    // IFB/IAC 6.3: 6300:01 is a flow with 6043 = -3.
    let set_point = by("rexroth-ifb-iac", "6300:01");
    let line = "6043:00 = -3 (pQ, Q closed loop): Flow set point, l/min = raw × 0.1, -1638.4 to 1638.4 l/min";
    assert!(set_point.contains(line), "{set_point}");
    // VPCD 4.42: the low byte is a number, bits 8 to 15 are flags.
    let status = by("rexroth-vpcd", "2C68:00");
    assert!(status.contains("0-7    fault: 0 = none") && status.contains("8      error 1\n"), "{status}");
    // Not in the manual, but in CiA 301 (7.5.2.20).
    let heartbeat = by("rexroth-sydfec", "1017:00");
    assert!(
        heartbeat.starts_with("1017:00  object of CiA 301, not in the manual of SYDFEC: "),
        "{heartbeat}"
    );
    assert!(heartbeat.ends_with("section      7.5.2.20 of CiA 301 v4.2.0\n"), "{heartbeat}");
}

#[test]
fn an_index_alone_lists_its_entries() {
    let expected = "\
5208  object of SYDFEC: Command values
      5208:01  Command values, Command value source, UNSIGNED16 rw, 4 values, default CAN bus (0)  [17.1, 17.2]
      5208:02  Command values, Nominal pressure, UNSIGNED16 rw, bar, 1 to 450 bar, default 315 bar  [17.1, 17.2]
";
    assert_eq!(by("rexroth-sydfec", "5208"), expected);
    let none = by("wandfluh-md2", "1018:07");
    assert!(none.contains("Identity object, without this sub-index") && none.contains("1018:04"), "{none}");
}

#[test]
fn a_frame_of_the_device() {
    // 08: pressure control; 1FA0 = 8096 of 16383 = 49.4 %; 2000 = 8192 of 16383 × 315 bar = 157.5 bar.
    let output = by("rexroth-sydfec", "182#08A01F0020");
    for line in ["signals.value: 49.417", "signals.value: 157.509", "signals.bits: pressure-control"] {
        assert!(output.contains(line), "{line}\n{output}");
    }
    let emcy = by("rexroth-sydfec", "082#8102100000000000");
    assert!(emcy.contains("8102  EMCY error code of SYDFEC: life guarding: master silent\n"), "{emcy}");
    assert!(explain("082#8102100000000000").contains("rexroth-sydfec: swapped, 8102"));
    let abort = by("rexroth-sydfec", "582#8000100000000606");
    assert!(abort.contains("06060000  SDO abort code of SYDFEC: EEPROM loading error"), "{abort}");
    // RE 29015, 4.2: 6043 defines words 2 and 3. 01F4 = 500: 50.0 l/min or 500 of 16384; 05DC = 1500: 150.0
    // bar.
    let modes = by("rexroth-ifb-iac", "205#0700F401DC05");
    let flow = modes.split("if 6043:00 = -3 (pQ, Q closed loop):\n").nth(1).unwrap().lines().next().unwrap();
    assert!(flow.contains("Q 50.0 l/min, p 150.0 bar"), "{modes}");
    let position = modes.split("if 6043:00 = 2 (position closed loop):\n").nth(1).unwrap();
    assert!(position.lines().next().unwrap().contains("position 3.1 %"), "{modes}");
    // For any node: 300 + 5 is its RPDO2, 700 + 5 its guarding.
    assert!(by("rexroth-sydfec", "305#01000000").contains("RPDO2 data"));
    assert_eq!(run(&["explain", "705#05", "--device", "rexroth-sydfec"], "").code, 0);
}

#[test]
fn a_device_that_is_not_there() {
    let output = run(&["explain", "8102", "--device", "sydfec"], "");
    assert_eq!(output.code, 2);
    let expected =
        "cobscope: unknown profile 'sydfec'; did you mean 'rexroth-sydfec'? (cobscope profiles list)\n";
    assert_eq!(output.stderr, expected);
    assert_eq!(run(&["explain", "8102", "--device", "wandfluh-md2:pump"], "").code, 2);
}

/// The text with its wrapped lines joined.
fn unfolded(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn every_code_of_every_manual_is_explained() {
    let catalogue = Catalogue::default();
    let mut reported: BTreeMap<String, BTreeSet<(String, String)>> = BTreeMap::new();
    for id in catalogue.ids() {
        let first = catalogue.device(&id).unwrap();
        let variants: Vec<_> = first.variants.iter().map(|it| format!("{id}:{}", it.id)).collect();
        for name in if variants.is_empty() { vec![id.clone()] } else { variants } {
            let device = catalogue.device(&name).unwrap();
            let codes = device.emcy.code.iter().map(|it| (format!("{:04X}", it.code), it.text.clone()));
            let aborts = device.aborts.iter().map(|it| (format!("{:08X}", it.code), it.text.clone()));
            for (code, text) in codes.chain(aborts).step_by(step(3)) {
                let output = unfolded(&by(&name, &code));
                assert!(output.contains(&text), "{code} of {name}: {output}");
                reported.entry(code).or_default().insert((id.clone(), text));
            }
        }
    }
    assert!(reported.len() > 60 / step(3), "{}", reported.len());
    for (code, answers) in reported {
        let output = unfolded(&explain(&code));
        for (id, text) in answers {
            let line = output.split(&format!("{id}: ")).nth(1).unwrap_or_default();
            assert!(line.contains(&text), "{code} of {id}: {output}");
        }
    }
}
