//! Conclusions about random parts of small machines: what fails, and the same capture in which it does not.

use std::fmt::Write as _;
use std::fs;

use cobscope_decoder::conclusion::{all_hypotheses, find_hypothesis};
use cobscope_decoder::finding::{RuleOrigin, Severity};
use cobscope_decoder::{CaptureFindings, Reading};

use crate::support::workspace;

/// A periodic message of a machine.
#[derive(Clone)]
struct Message {
    id: &'static str,
    /// Period in ms.
    period: u32,
    /// Times in ms in which it is sent.
    times: Vec<(u32, u32)>,
    payload: fn(u32) -> String,
}

/// A machine of 20 s.
const END: u32 = 20_000;

fn message(id: &'static str, period: u32, payload: fn(u32) -> String) -> Message {
    Message { id, period, times: vec![(0, END)], payload }
}

/// A slow value with noise in its low byte, as a sensor sends it.
fn sensor(count: u32) -> String {
    let value = 0x3000 + count * 37 % 0x400;
    format!("{:02X}{:02X}FFFFFFFFFFFF", value % 256, value / 256)
}

fn operational(_count: u32) -> String {
    "05".to_owned()
}

fn nothing(_count: u32) -> String {
    String::new()
}

/// Three ECUs with two groups each.
fn ecus() -> Vec<Message> {
    vec![
        message("0CF00400", 20, sensor),
        message("18FEF100", 100, sensor),
        message("0CF00303", 50, sensor),
        message("18FF2103", 200, sensor),
        message("18FEF50B", 500, sensor),
        message("18FF330B", 100, sensor),
    ]
}

/// A controller with SYNC, set points and heartbeat, and three nodes with heartbeat and two TPDOs.
fn nodes() -> Vec<Message> {
    vec![
        message("080", 50, nothing),
        message("205", 50, sensor),
        message("206", 50, sensor),
        message("207", 50, sensor),
        message("77F", 200, operational),
        message("705", 100, operational),
        message("185", 50, sensor),
        message("285", 100, sensor),
        message("706", 100, operational),
        message("186", 50, sensor),
        message("286", 100, sensor),
        message("707", 100, operational),
        message("187", 50, sensor),
        message("287", 100, sensor),
    ]
}

/// Sends messages with these identifiers, by their ends, only at these times.
fn only(machine: &mut [Message], ends: &[&str], times: &[(u32, u32)]) {
    let meant = machine.iter_mut().filter(|message| ends.iter().any(|end| message.id.ends_with(end)));
    meant.for_each(|message| message.times = times.to_vec());
}

/// Text of a capture: the periodic messages, and single frames at times in µs.
fn capture(machine: &[Message], frames: &[(u32, String)]) -> String {
    let mut all = frames.to_vec();
    for (place, message) in (0_u32..).zip(machine) {
        for count in 0..END / message.period {
            // Each message has its own phase and a jitter of 1 %.
            let time = count * message.period * 1_000 + place * 310 + count * 7 % 11 * message.period;
            let is_sent = message.times.iter().any(|(from, to)| (from * 1_000..to * 1_000).contains(&time));
            if is_sent {
                all.push((time, format!("{}#{}", message.id, (message.payload)(count))));
            }
        }
    }
    all.sort();
    all.iter().fold(String::new(), |mut text, (time, frame)| {
        writeln!(text, "({}.{:06}) can0 {frame}", 1_700_000_000 + time / 1_000_000, time % 1_000_000)
            .unwrap();
        text
    })
}

fn judge(text: &str) -> CaptureFindings {
    let mut reading = Reading::new(());
    reading.run(text.as_bytes()).unwrap();
    reading.finish().findings
}

/// Conclusions with at least a warning: name and nodes.
fn concluded(machine: &[Message], frames: &[(u32, String)]) -> Vec<String> {
    let findings = judge(&capture(machine, frames));
    let groups = findings.reported_groups().filter(|group| {
        findings.rules[usize::from(group.key.rule)].origin == RuleOrigin::Conclusion
            && group.severity > Severity::Note
    });
    let mut all: Vec<_> = groups
        .map(|group| {
            let nodes: Vec<_> = group.nodes.iter().map(ToString::to_string).collect();
            format!("{} {}", group.rule, nodes.join(" ")).trim_end().to_owned()
        })
        .collect();
    all.sort();
    all
}

fn claim(address: u8, time: u32) -> (u32, String) {
    (time * 1_000, format!("18EEFF{address:02X}#{address:02X}00000000000080"))
}

#[test]
fn healthy_machines_have_none() {
    assert_eq!(concluded(&ecus(), &[]), [""; 0]);
    assert_eq!(concluded(&nodes(), &[]), [""; 0]);
}

#[test]
fn a_node_that_ends_is_silent() {
    let ended = |ends: &[&str], at: u32| {
        let mut machine = ecus();
        only(&mut machine, ends, &[(0, at)]);
        concluded(&machine, &[])
    };
    assert_eq!(ended(&["03"], 10_000), ["node-silent sa:0x03"]);
    assert_eq!(ended(&["03"], 19_800), [""; 0], "too short before the end");
    assert_eq!(ended(&["0CF00303", "18FF2103"], 10_000), ["node-silent sa:0x03"]);
    assert_eq!(ended(&["18FF2103"], 10_000), ["message-stopped sa:0x03"]);
    assert_eq!(ended(&["00", "03", "0B"], 10_000), [""; 0], "the whole machine");
    assert_eq!(ended(&["03", "0B"], 10_000), ["nodes-silent sa:0x03 sa:0x0B"]);
}

#[test]
fn a_node_that_returns_was_interrupted_or_restarted() {
    let gap = |ends: &[&str], from: u32, to: u32, frames: &[(u32, String)]| {
        let mut machine = ecus();
        only(&mut machine, ends, &[(0, from), (to, END)]);
        concluded(&machine, frames)
    };
    assert_eq!(gap(&["03"], 8_000, 11_000, &[]), ["node-interrupted sa:0x03"]);
    assert_eq!(gap(&["03"], 8_000, 8_900, &[]), [""; 0], "a pause of its application");
    assert_eq!(gap(&["03"], 8_000, 11_000, &[claim(3, 10_900)]), ["node-restarted sa:0x03"]);
    assert_eq!(gap(&["03", "0B"], 8_000, 11_000, &[]), ["nodes-interrupted sa:0x03 sa:0x0B"]);
    let claims = [claim(3, 10_900), claim(0x0B, 10_950)];
    assert_eq!(gap(&["03", "0B"], 8_000, 11_000, &claims), ["nodes-restarted sa:0x03 sa:0x0B"]);
    let all = [claim(0, 10_900), claim(3, 10_920), claim(0x0B, 10_950)];
    assert_eq!(gap(&["00", "03", "0B"], 8_000, 11_000, &all), [""; 0], "the machine is switched on");
}

#[test]
fn a_claim_alone_is_a_restart_unless_it_answers() {
    assert_eq!(concluded(&ecus(), &[claim(3, 9_000)]), ["node-restarted sa:0x03"]);
    let request = (8_900_000, "18EAFFF9#00EE00".to_owned());
    assert_eq!(concluded(&ecus(), &[request, claim(3, 9_000)]), [""; 0]);
    assert_eq!(concluded(&ecus(), &[claim(3, 9_000), claim(3, 9_500)]), [""; 0], "a conflict of addresses");
}

#[test]
fn the_controller_is_one_sender() {
    let ended = |ends: &[&str]| {
        let mut machine = nodes();
        only(&mut machine, ends, &[(0, 10_000)]);
        concluded(&machine, &[])
    };
    assert_eq!(ended(&["080", "205", "206", "207", "77F"]), ["controller-silent"]);
    assert_eq!(ended(&["080"]), ["sync-stopped"]);
}

#[test]
fn a_command_explains_what_ends() {
    let mut machine = nodes();
    only(&mut machine, &["185", "285"], &[(0, 10_000)]);
    assert_eq!(concluded(&machine, &[]), ["application-stalled 5"]);
    let stop = (9_990_000, "000#0205".to_owned());
    assert!(!concluded(&machine, &[stop]).contains(&"application-stalled 5".to_owned()));
}

#[test]
fn a_longer_period_is_one_from_the_factor_of_one_and_a_half() {
    let slower = |period: u32| {
        let mut machine = ecus();
        only(&mut machine, &["18FEF100"], &[(0, 10_000)]);
        machine.push(Message { times: vec![(10_000, END)], ..message("18FEF100", period, sensor) });
        concluded(&machine, &[])
    };
    assert_eq!(slower(200), ["message-slower sa:0x00"]);
    assert_eq!(slower(140), [""; 0]);
}

#[test]
fn elements_between_the_usual_ones_are_a_second_sender() {
    let second = |times: (u32, u32)| {
        let mut machine = ecus();
        // Phase: a third of the period.
        let frames: Vec<_> = (times.0 / 100..times.1 / 100)
            .map(|count| (count * 100_000 + 33_000, format!("18FEF100#{}", sensor(count))))
            .collect();
        only(&mut machine, &[], &[]);
        concluded(&machine, &frames)
    };
    assert_eq!(second((8_000, END)), ["second-sender sa:0x00"]);
    assert_eq!(second((8_000, 8_500)), [""; 0], "five of them");
}

#[test]
fn a_payload_freezes_while_others_change() {
    fn stuck(count: u32) -> String {
        sensor(count.min(100))
    }
    let mut machine = ecus();
    machine[1].payload = stuck;
    assert_eq!(concluded(&machine, &[]), ["value-frozen sa:0x00"]);
    let places = [400, 100, 160, 40, 16, 80];
    let mut still = ecus();
    still.iter_mut().zip(places).for_each(|(message, _)| message.payload = stuck);
    assert_eq!(concluded(&still, &[]), [""; 0], "the machine stands still");
}

#[test]
fn single_frames_with_another_value_are_jumps() {
    fn jumping(count: u32) -> String {
        if count > 500 && count.is_multiple_of(40) { "409CFFFFFFFFFFFF".to_owned() } else { sensor(count) }
    }
    let mut machine = ecus();
    machine[0].payload = jumping;
    assert_eq!(concluded(&machine, &[]), ["value-jumps sa:0x00"]);
}

#[test]
fn a_message_sent_far_too_often_explains_late_ones() {
    let mut machine = ecus();
    let frames: Vec<_> =
        (0..1_500).map(|count| (9_000_000 + count * 900, "0CFF6603#00".to_owned())).collect();
    only(&mut machine, &["0B"], &[(0, 9_100), (10_400, END)]);
    assert_eq!(concluded(&machine, &frames), ["babbling sa:0x03"]);
    assert_eq!(concluded(&ecus(), &frames[..100]), [""; 0], "100 frames");
}

#[test]
fn a_burst_of_error_frames_that_ends_a_node_is_its_own() {
    let mut machine = nodes();
    only(&mut machine, &["705", "185", "285"], &[(0, 10_000)]);
    let errors: Vec<_> =
        (0..32).map(|count| (9_900_000 + count * 3_000, "20000088#0000040000000000".to_owned())).collect();
    assert_eq!(concluded(&machine, &errors), ["node-bus-off 5"]);
    assert!(!concluded(&machine, &errors[..8]).contains(&"node-bus-off 5".to_owned()), "eight errors");
}

#[test]
fn a_command_against_the_set_points_is_of_a_second_master() {
    let mut machine = nodes();
    only(&mut machine, &["705", "706", "707"], &[(0, 10_000)]);
    only(&mut machine, &["185", "285", "186", "286", "187", "287"], &[(0, 10_000)]);
    for id in ["705", "706", "707"] {
        machine.push(Message { times: vec![(10_000, END)], ..message(id, 100, |_| "04".to_owned()) });
    }
    let stop = [(9_995_000, "000#0200".to_owned())];
    let found = concluded(&machine, &stop);
    // Where a rule names the command as the cause of its findings, it says so itself.
    let findings = judge(&capture(&machine, &stop));
    let is_named = findings.reported_groups().any(|group| &*group.rule == "pdo-outside-operational");
    assert!(found == ["second-master"] || is_named, "{found:?}");
    only(&mut machine, &["080", "205", "206", "207"], &[(0, 10_000)]);
    assert_eq!(concluded(&machine, &stop), [""; 0], "the controller stands still, too");
}

#[test]
fn a_node_without_a_start_waits() {
    let waiting = |object: &str, others: &str| {
        let mut machine = nodes();
        machine.retain(|message| !["705", "185", "285"].contains(&message.id));
        machine.push(message("705", 100, |_| "7F".to_owned()));
        let read = |node: u32, time: u32, object: &str| {
            let answer = format!("58{node}#43{object}78563412");
            [(time, format!("60{node}#40{object}00000000")), (time + 2_000, answer)]
        };
        let frames = [read(5, 1_000_000, object), read(6, 1_100_000, others)].concat();
        concluded(&machine, &frames)
    };
    assert_eq!(waiting("181002", "181002"), ["not-started 5"]);
    assert_eq!(waiting("181001", "181002"), ["not-accepted 5"], "its identity was not read to the end");
    let mut machine = nodes();
    machine.retain(|message| !["705", "185", "285"].contains(&message.id));
    machine.push(message("705", 100, |_| "7F".to_owned()));
    let refused =
        [(1_000_000, "605#2B171000E8030000".to_owned()), (1_002_000, "585#8017100022000008".to_owned())];
    assert_eq!(concluded(&machine, &refused), [""; 0], "the refused write is the cause");
}

#[test]
fn reports_of_communication_name_the_message() {
    let every = |code: &str| -> Vec<(u32, String)> {
        (0..5).map(|count| (5_000_000 + count * 1_000_000, format!("085#{code}110000000000"))).collect()
    };
    assert_eq!(concluded(&nodes(), &every("3081")), ["consumer-short 5"]);
    assert_eq!(concluded(&nodes(), &every("1082")), ["length-differs 5"]);
    assert_eq!(concluded(&nodes(), &every("3081")[..2]), [""; 0], "two reports");
}

#[test]
fn a_working_set_without_a_terminal_waits() {
    let set = (500_000, "1CFE0D8A#01FFFFFFFFFFFFFF".to_owned());
    assert_eq!(concluded(&ecus(), std::slice::from_ref(&set)), ["terminal-absent sa:0x8A"]);
    let status = (600_000, "0CE6FF26#FE80E80300000000".to_owned());
    assert_eq!(concluded(&ecus(), &[set, status]), [""; 0]);
}

#[test]
fn a_drive_that_stays_in_its_state_does_not_follow() {
    let drive = |control: fn(u32) -> String, status: fn(u32) -> String| {
        let mut machine = nodes();
        machine.retain(|message| !["205", "185"].contains(&message.id));
        machine.push(message("205", 50, control));
        machine.push(message("185", 50, status));
        concluded(&machine, &[])
    };
    assert_eq!(drive(|_| "0700".to_owned(), |_| "2102".to_owned()), ["command-not-followed 5"]);
    assert_eq!(drive(|_| "0700".to_owned(), |_| "3302".to_owned()), [""; 0], "switched on, as commanded");
    assert_eq!(drive(|_| "0600".to_owned(), |_| "2102".to_owned()), [""; 0], "ready, as commanded");
}

#[test]
fn frames_lost_at_random_are_no_failure() {
    for family in [ecus(), nodes()] {
        for seed in 0..6_u32 {
            let text = capture(&family, &[]);
            let mut random = seed.wrapping_mul(2_654_435_761) | 1;
            let kept = text.lines().filter(|_| {
                random ^= random << 13;
                random ^= random >> 17;
                random ^= random << 5;
                random % 100 >= 2
            });
            let text: String = kept.flat_map(|line| [line, "\n"]).collect();
            let findings = judge(&text);
            let found: Vec<_> = findings
                .reported_groups()
                .filter(|group| findings.rules[usize::from(group.key.rule)].origin == RuleOrigin::Conclusion)
                .map(|group| group.text.clone())
                .collect();
            assert_eq!(found, [""; 0]);
        }
    }
}

#[test]
fn every_row_has_a_test_and_a_page() {
    let tests = include_str!("conclusions.rs");
    for row in all_hypotheses() {
        // A controller is tested with the silence that lasts.
        let is_tested = tests.contains(&format!("\"{}", row.id)) || row.id == "controller-interrupted";
        assert!(is_tested, "{}", row.id);
        assert!(find_hypothesis(&row.id).unwrap().manual_text().contains(&row.observed));
    }
}

/// Rows as the table of the page.
fn table() -> String {
    let mut text = String::from(
        "## Conclusions\n\n| name | part of the machine | fails by | the capture shows |\n| --- | --- | --- | --- |\n",
    );
    for row in all_hypotheses() {
        writeln!(text, "| `{}` | {} | {} | {} |", row.id, row.component, row.mode, row.observed).unwrap();
    }
    text
}

#[test]
fn the_page_has_all_rows() {
    const MARK: &str = "hypotheses.toml. -->\n";
    let path = workspace().join("docs/diagnosis.md");
    let page = fs::read_to_string(&path).unwrap();
    let (written, _) = page.split_once(MARK).unwrap();
    let wanted = format!("{written}{MARK}\n{}", table());
    if std::env::var_os("COBSCOPE_BLESS").is_some() {
        fs::write(&path, &wanted).unwrap();
        return;
    }
    assert!(page == wanted, "docs/diagnosis.md is not the present one: COBSCOPE_BLESS=1 writes it");
}
