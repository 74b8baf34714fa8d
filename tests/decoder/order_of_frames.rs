//! Captures without timestamps: the order of frames shows what times would show. Frames of other streams are the clock.

use std::fmt::Write as _;

use cobscope_decoder::session::SessionOptions;

use crate::rules::{judge, plain_setup};

/// Texts of the findings of a rule in frames without timestamps, in candump's form for the screen.
fn texts(rule: &str, frames: &[&str]) -> Vec<String> {
    let mut text = String::new();
    for frame in frames {
        let (id, bytes) = frame.split_once('#').unwrap();
        let pairs: Vec<_> = bytes.as_bytes().chunks(2).map(|pair| String::from_utf8_lossy(pair)).collect();
        writeln!(text, "  can0  {id}   [{}]  {}", pairs.len(), pairs.join(" ")).unwrap();
    }
    let findings = judge(&text, &SessionOptions::default(), plain_setup()).1;
    let own = findings.groups.iter().filter(|group| *group.rule == *rule);
    own.map(|group| group.text.clone()).collect()
}

const BOOT: &str = "701#00";
const PRE: &str = "701#7F";
const ERROR: &str = "081#1081010000000000";
const GONE: &str = "081#0000000000000000";

#[test]
fn an_error_after_the_boot_up_is_reported_if_heartbeats_follow() {
    let found = |frames: &[&str]| texts("emcy-raised", frames);
    let text = "EMCY 8110 CAN overrun, frames lost; reported at power-on, not cleared in the ";
    assert_eq!(found(&[BOOT, ERROR, PRE, PRE]), [format!("{text}2 heartbeats after it")]);
    assert_eq!(found(&[BOOT, ERROR, PRE]), [format!("{text}1 heartbeat after it")]);
    // Nothing shows how long the error was there, or it was cleared.
    assert_eq!(found(&[BOOT, ERROR]), [""; 0]);
    assert_eq!(found(&[BOOT, ERROR, PRE, GONE, PRE]), [""; 0]);
    // A restart ends the error of the time before it.
    assert_eq!(found(&[BOOT, ERROR, PRE, BOOT, PRE]), [""; 0]);
}

/// CiA 301 §7.3.2.2.3: no PDO in pre-operational. Two reports of the state precede the RPDO, and one follows it.
#[test]
fn commands_to_a_node_that_stays_pre_operational() {
    let found = |frames: &[&str]| texts("pdo-outside-operational", frames);
    let (pre, command) = ("715#7F", "215#000100");
    let text = "RPDO1 received in NMT state pre-operational {3}, 3 reports of it";
    assert_eq!(found(&[pre, pre, command, command, pre]), [text]);
    assert_eq!(found(&[pre, command, pre]), [""; 0]);
    assert_eq!(found(&[pre, pre, command]), [""; 0]);
    assert_eq!(found(&[pre, pre, command, "715#05"]), [""; 0]);
    assert_eq!(found(&[pre, pre, "000#0115", command, pre]), [""; 0]);
}

#[test]
fn a_request_repeated_after_other_frames_had_no_response() {
    let found = |frames: &[&str]| texts("sdo-no-response", frames);
    let (alive, request) = ("705#05", "605#4018100100000000");
    let (other, answer) = ("605#4018100200000000", "585#4318100292010000");
    let repeated = [alive, other, answer, request, alive, "706#05", request, alive, other, answer, alive];
    let text = "no SDO response (same request repeated after 2 other frames; no timestamps)";
    assert_eq!(found(&repeated), [text]);
    // Nothing passed between the two requests.
    assert_eq!(found(&[alive, other, answer, request, request, other, answer, alive]), [""; 0]);
    // The response follows the repetition.
    let late = [alive, request, alive, request, "585#4318100192010000", alive];
    assert_eq!(found(&late), [""; 0]);
    // Without timestamps, nothing proves that the client did not wait.
    assert_eq!(texts("sdo-client-does-not-wait", &repeated), [""; 0]);
}
