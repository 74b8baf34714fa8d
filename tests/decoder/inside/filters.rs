//! Filters applied to events.

use crate::event::{Event, EventKind, KindSet};
use crate::query::record::{FieldConsumer, FieldValue, visit_event};
use crate::query::{Filter, MAX_TESTS};
use proptest::prelude::*;

use super::events;

fn filter(text: &str) -> Filter {
    text.parse().unwrap_or_else(|error| panic!("{error}"))
}

/// Kinds of the sample events that match a filter.
fn matching(text: &str) -> Vec<&'static str> {
    let (filter, bus) = (filter(text), events::bus());
    let all = events::all().into_iter();
    all.filter(|event| filter.matches_event(event, &bus, None)).map(|event| event.kind.name()).collect()
}

fn refusal(text: &str) -> String {
    text.parse::<Filter>().map_or_else(|error| error.to_string(), |filter| format!("understood: {filter}"))
}

#[test]
fn the_kind_and_what_is_joined_to_it() {
    assert_eq!(matching("kind == emcy"), ["emcy"; 3]);
    assert_eq!(matching("kind == emcy && code == 0x8130"), ["emcy"]);
    assert_eq!(matching("kind in {node-lost node-back}"), ["node-lost", "node-back"]);
    assert_eq!(matching("kind contains guard"), ["guard-request", "guard-reply"]);
    assert_eq!(matching("kind matches \"^Node-(lost|back)$\""), ["node-lost", "node-back"]);
    assert_eq!(matching("kind == time or kind == sync and counter"), ["sync", "time"]);
    assert_eq!(matching("(kind == time or kind == sync) and counter"), ["sync"]);
    assert!(matching("kind == emcy && kind == sync").is_empty());
}

#[test]
fn a_field_alone_asks_whether_it_is_there() {
    assert_eq!(matching("abort && protocol == canopen && kind == sdo-transfer"), ["sdo-transfer"; 3]);
    assert_eq!(matching("abort.by == receiver"), ["j1939-transfer"]);
    assert_eq!(matching("signals && kind == pdo"), ["pdo"; 2]);
    assert_eq!(matching("missing == 2001sub1 && kind == pdo"), ["pdo"]);
    assert_eq!(matching("toggle_error"), ["guard-reply"]);
    assert_eq!(matching("last_emcy"), ["node-lost"], "null is not there");
    assert_eq!(matching("!(kind == lss) && !node_name").len(), 0);
    assert_eq!(matching("signals.assumed && kind == pdo"), ["pdo"; 2]);
}

#[test]
fn a_comparison_with_a_field_that_is_not_there_is_false() {
    assert_eq!(matching("counter == 5"), ["sync"]);
    assert!(matching("counter != 5").is_empty());
    assert_eq!(matching("!(counter == 5) && kind == sync"), ["sync"]);
    assert_eq!(matching("last_emcy != 0x1000"), ["node-lost"]);
}

#[test]
fn one_value_of_several_is_enough() {
    let all = events::all().len();
    assert_eq!(matching("frames == 3").len(), all);
    assert_eq!(matching("frame.number == 4").len(), all);
    assert_eq!(matching("frames == 5").len(), 0);
    assert_eq!(matching("frames in {1..3}").len(), all);
    assert_eq!(matching("frames != 3").len(), all, "the other one is 4");
    assert_eq!(matching("signals.id == 2001sub1 && kind == pdo"), ["pdo"]);
    assert_eq!(matching("signals.value == -2 && kind == pdo"), ["pdo"]);
    assert_eq!(matching("signals.value > 199 && kind == pdo"), ["pdo"; 2]);
    assert_eq!(matching("signals.name == speed && kind == pdo"), ["pdo"; 2]);
    assert_eq!(matching("can.id in {0x600..0x67F}"), ["sdo-transfer"; 6]);
}

#[test]
fn values_of_all_types() {
    assert_eq!(
        matching("object == 0x1017:00"),
        ["object-change", "object-change", "sdo-transfer", "sdo-transfer", "sdo-transfer", "sdo-transfer"]
    );
    assert_eq!(matching("object >= 1017h:00h && object <= 1017:FF && name"), ["sdo-transfer"; 3]);
    assert_eq!(matching("canopen.sdo.main_idx == 0x1008"), ["sdo-transfer"]);
    assert_eq!(matching("abort.code == 0x06020000 && abort.by == client"), ["sdo-transfer"]);
    assert_eq!(matching("canopen.sdo.abort_code in {0x06020000..0x0602FFFF}"), ["sdo-transfer"; 3]);
    assert_eq!(matching("vendor_data contains 02:03"), ["emcy"]);
    assert_eq!(matching("data == c8fe"), ["pdo"]);
    assert_eq!(matching("data contains \"BC\""), ["sdo-transfer"]);
    assert_eq!(matching("value == 1000"), ["sdo-transfer"]);
    assert_eq!(matching("value matches abc"), ["sdo-transfer"]);
    assert!(matching("value matches \"(?-i)abc\"").is_empty());
    assert_eq!(matching("gap > 2.5 && kind == node-lost"), ["node-lost"]);
    assert_eq!(matching("gap == 2"), ["bus-silent"]);
    assert_eq!(matching("step < 0"), ["clock-step"]);
    assert_eq!(matching("step == -0.001"), ["clock-step"]);
    assert_eq!(matching("remote == true && fd != false"), ["frame"]);
    assert_eq!(matching("id == 0x18FECA00"), ["frame"]);
    assert_eq!(matching("time >= \"2024-01-01\""), ["time"]);
    assert_eq!(matching("t == 1.5 && kind == note"), ["note"]);
    assert_eq!(matching("node_name == ABCD").len(), events::all().len());
}

/// The only SYNC has counter 5, the only silence is 2 s long, and only object 1017:00 changes.
#[test]
fn comparisons_on_both_sides_of_a_value() {
    let cases = [
        ("counter", ["4", "5", "6"], "sync"),
        ("gap", ["1.999", "2", "2.001"], "bus-silent"),
        ("object", ["1016:FF", "1017:00", "1017:01"], "object-change"),
    ];
    for (field, [below, equal, above], kind) in cases {
        let is_found = |operator: &str, value: &str| {
            !matching(&format!("kind == {kind} && {field} {operator} {value}")).is_empty()
        };
        let found = |operator: &str| [below, equal, above].map(|value| is_found(operator, value));
        assert_eq!(found("<"), [false, false, true], "{field}");
        assert_eq!(found("<="), [false, true, true], "{field}");
        assert_eq!(found(">"), [true, false, false], "{field}");
        assert_eq!(found(">="), [true, true, false], "{field}");
        assert_eq!(found("=="), [false, true, false], "{field}");
        assert_eq!(found("!="), [true, false, true], "{field}");
        let range = |from: &str, to: &str| is_found("in", &format!("{{{from}..{to}}}"));
        assert!(range(below, equal) && range(equal, above) && range(equal, equal), "{field}");
        assert!(!range(below, below) && !range(above, above), "{field}");
    }
}

#[test]
fn a_key_of_several_meanings_goes_by_the_value() {
    assert_eq!(matching("from == 1"), ["node-id-change"]);
    assert_eq!(matching("from == E803"), ["object-change"]);
    assert_eq!(matching("from == pre-operational"), ["nmt-command", "nmt-state"]);
    assert_eq!(matching("mode == configuration"), ["lss"]);
    assert_eq!(matching("mode == 9"), ["lss"]);
    assert_eq!(matching("mode == block"), ["sdo-transfer"; 5]);
}

#[test]
fn a_filter_knows_its_kinds() {
    let kinds = |text| filter(text).kinds().names().collect::<Vec<_>>();
    assert_eq!(kinds("kind == emcy"), ["emcy"]);
    assert_eq!(kinds("abort.code == 0x06020000"), ["sdo-transfer", "j1939-transfer"]);
    assert_eq!(kinds("mode == block"), ["sdo-transfer"]);
    assert_eq!(kinds("counter == 1 || register == 1"), ["sync", "emcy"]);
    assert_eq!(kinds("node == 1 && !(kind != pdo)"), ["pdo"]);
    assert_eq!(filter("node == 1").kinds(), KindSet::ALL);
    assert_eq!(filter("!counter").kinds(), KindSet::ALL);
    assert_eq!(filter("counter && kind == emcy").kinds(), KindSet::NONE);
}

#[test]
fn the_capture_is_a_field() {
    let bus = events::bus();
    let event = events::event(EventKind::GuardRequest);
    assert!(filter("capture contains a").matches_event(&event, &bus, Some("a.log")));
    assert!(!filter("capture").matches_event(&event, &bus, None));
}

#[test]
fn errors_show_the_place_and_the_way_out() {
    let cases = [
        ("nod == 4", "unknown field 'nod'; did you mean node?\n  nod == 4\n  ^^^"),
        (
            "node == 4 && kind == sdo",
            "unknown kind 'sdo'; did you mean sdo-transfer?\n  node == 4 && kind == sdo\n                       ^^^",
        ),
        (
            "code == 8130",
            "'8130' is ambiguous; write 0x8130, or 0x1FC2 for decimal 8130\n  code == 8130\n          ^^^^",
        ),
        ("kind < emcy", "kind has no order; use == or !=\n  kind < emcy\n  ^^^^"),
        ("node matches 4", "matches requires text; node is a number\n  node matches 4\n  ^^^^"),
        (
            "node contains 4",
            "contains requires text or bytes; node is a number\n  node contains 4\n                ^",
        ),
        (
            "object == 0x1018",
            "sub-index missing; write 0x1018:00, or use .index for all sub-indexes\n  object == 0x1018\n            ^^^^^^",
        ),
        (
            "last_state == operationl",
            "unknown last_state 'operationl'; did you mean operational?\n  last_state == operationl\n                ^^^^^^^^^^",
        ),
        ("bus matches \"(\"", "not a valid regular expression: "),
        ("bus matches \"(x{1000}){1000}\"", "not a valid regular expression: "),
    ];
    for (text, expected) in cases {
        let refusal = refusal(text);
        assert!(refusal.starts_with(expected), "{text}: {refusal}");
    }
}

#[test]
fn questions_are_limited() {
    let many = |count: usize| vec!["node"; count].join("||");
    assert!(many(MAX_TESTS).parse::<Filter>().is_ok());
    assert!(refusal(&many(MAX_TESTS + 1)).starts_with("too many tests in the filter (max 256)"));
    let mut last = vec!["step"; MAX_TESTS];
    *last.last_mut().unwrap() = "counter";
    assert_eq!(matching(&last.join("||")), ["procedure", "sync", "clock-step"]);
}

/// Whether an event has a top-level key: checks the filter's own search.
struct Tells {
    key: &'static str,
    depth: usize,
    reported: bool,
}

impl FieldConsumer for Tells {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        self.reported |= self.depth == 0 && key == self.key && value != FieldValue::Null;
    }
    fn open_group(&mut self, _: &'static str) {
        self.depth += 1;
    }
    fn close_group(&mut self) {
        self.depth -= 1;
    }
    fn open_list(&mut self, _: &'static str) {
        self.depth += 1;
    }
    fn close_list(&mut self) {
        self.depth -= 1;
    }
}

fn tells(event: &Event, key: &'static str) -> bool {
    let mut tells = Tells { key, depth: 0, reported: false };
    visit_event(event, &events::bus(), None, &mut tells);
    tells.reported
}

#[test]
fn presence_is_what_a_visit_tells() {
    for key in ["code", "object", "data", "text", "name", "from", "to", "unit", "cut", "presumed"] {
        let filter = filter(key);
        for event in events::all() {
            let event = Event { presumed: false, ..event };
            let expected = tells(&event, key);
            assert_eq!(filter.matches_event(&event, &events::bus(), None), expected, "{key} {event:?}");
        }
    }
}

fn operand() -> impl Strategy<Value = String> {
    prop_oneof![
        "-?[0-9]{1,12}(\\.[0-9]{1,12})?",
        "0x[0-9A-F]{1,8}",
        "[0-9]{4}:[0-9]{2}",
        "[a-z-]{1,12}",
        any::<String>().prop_map(|text| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))),
    ]
}

fn test() -> impl Strategy<Value = String> {
    let text = prop_oneof![Just("bus"), Just("node_name"), Just("signals.name"), Just("capture")];
    let number = prop_oneof![Just("node"), Just("t"), Just("canopen.node_id"), Just("frames")];
    let relation = prop_oneof![Just("=="), Just("!="), Just("lt"), Just(">="), Just("contains")];
    prop_oneof![
        number.clone().prop_map(str::to_owned),
        (text, relation, operand())
            .prop_map(|(field, relation, value)| format!("{field} {relation} {value}")),
        (number, -5..999, 0..9_999).prop_map(|(field, from, to)| format!("{field} in {{{from}..{to}, 0x7}}")),
    ]
}

fn expression() -> impl Strategy<Value = String> {
    test().prop_recursive(4, 24, 3, |inner| {
        prop_oneof![
            (inner.clone(), inner.clone()).prop_map(|(left, right)| format!("({left}) && ({right})")),
            (inner.clone(), inner.clone()).prop_map(|(left, right)| format!("{left} or {right}")),
            (inner.clone(), inner.clone()).prop_map(|(left, right)| format!("{left} and {right}")),
            inner.prop_map(|inner| format!("not {inner}")),
        ]
    })
}

/// Text that is similar to a filter.
fn nearly() -> impl Strategy<Value = String> {
    let piece = prop_oneof![
        "[ ()!{}.,<>=&|\"\\\\r]{1,3}",
        Just(" and ".to_owned()),
        Just(" in ".to_owned()),
        Just(" matches ".to_owned()),
        test(),
        operand(),
    ];
    prop::collection::vec(piece, 0..12).prop_map(|pieces| pieces.concat())
}

proptest! {
    #[test]
    fn any_text_is_understood_or_refused(text in prop_oneof![any::<String>(), nearly()]) {
        match text.parse::<Filter>() {
            Ok(filter) => prop_assert_eq!(&filter.to_string().parse::<Filter>().unwrap(), &filter),
            Err(error) => prop_assert!(error.to_string().lines().count() == 3),
        }
    }

    #[test]
    fn a_printed_filter_is_the_same_filter(text in expression()) {
        let filter = text.parse::<Filter>().unwrap();
        let again = filter.to_string().parse::<Filter>().unwrap();
        prop_assert_eq!(&again, &filter);
        prop_assert_eq!(again.to_string(), filter.to_string());
        let bus = events::bus();
        for event in events::all() {
            let answer = filter.matches_event(&event, &bus, None);
            prop_assert_eq!(again.matches_event(&event, &bus, None), answer);
            prop_assert!(!answer || filter.kinds().contains(&event.kind));
        }
    }
}
