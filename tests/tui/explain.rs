//! `cobscope explain`.

use crate::cli::run;

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
    assert!(explain("601#2B171000E8030000").contains("initiate download of 1017:00, expedited, 2 bytes"));
    let segment = explain("581#8101020304050607");
    assert!(segment.contains("segment 1, the last one") && !segment.contains("REFUSED"), "{segment}");
    assert!(explain("581#8017100000000206").contains("REFUSED 06020000"));
}

#[test]
fn anything_else_says_what_is_understood() {
    let output = run(&["explain", "pump"], "");
    assert_eq!(output.code, 2);
    assert!(output.stderr.contains("cannot read \"pump\"") && output.stderr.contains("1018sub1"));
    assert_eq!(run(&["explain", "12345#00"], "").code, 2);
}
