//! Evaluation of conditions, and the facts it requires.

use crate::profile::device::condition::{DeviceCondition, DeviceConditions};
use crate::profile::resolve::DecidingNumber;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Max age of the last SYNC for it to count as present, in ns.
pub(crate) const SYNC_AGE: i64 = 1_000_000_000;

/// Result of a condition, or of a gate with several conditions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GateStatus {
    /// The set point can take effect.
    Open,
    /// The set point cannot take effect.
    Closed,
    /// No evidence on the bus.
    Unknown,
    /// Never visible on the bus; ignored.
    Invisible,
}

impl GateStatus {
    /// Name in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Closed => "closed",
            Self::Unknown => "unknown",
            Self::Invisible => "not on the bus",
        }
    }

    const fn from_truth(holds: bool) -> Self {
        if holds { Self::Open } else { Self::Closed }
    }

    /// An assumed value can open a gate, but not close one.
    const fn of_number(holds: bool, number: DecidingNumber) -> Self {
        if number.assumed && !holds { Self::Unknown } else { Self::from_truth(holds) }
    }

    /// Result of two conditions that must both hold.
    pub(crate) const fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Closed, _) | (_, Self::Closed) => Self::Closed,
            (Self::Unknown, _) | (_, Self::Unknown) => Self::Unknown,
            (Self::Invisible, _) | (_, Self::Invisible) => Self::Invisible,
            (Self::Open, Self::Open) => Self::Open,
        }
    }
}

/// Facts about one node at one time; `None` if not known with the certainty that the caller requires.
pub(crate) trait DeviceFacts: Sized {
    /// NMT state of the node.
    fn nmt_state(&self) -> Option<NmtState>;

    /// Raw number of an object.
    fn object_number(&self, object: ObjectAddress) -> Option<DecidingNumber>;

    /// State reported by the machine of a channel.
    fn reported_state(&self, channel: Option<u8>) -> Option<&str>;

    /// Whether the control word leads the machine from its reported state to one of `states`.
    fn is_commanded(&self, channel: Option<u8>, states: &[String]) -> bool;

    /// Time since the last SYNC with the identifier configured in the node, in ns; `None` before the first
    /// one.
    fn sync_age(&self) -> Option<i64>;

    /// Whether an error or trouble code is active.
    fn has_error(&self) -> bool;

    /// Whether a running procedure takes over the set points.
    fn is_taken_over(&self) -> bool;

    /// Whether the message that carries the set point is overdue.
    fn is_overdue(&self) -> bool;

    /// Other nodes with the same profile; `None` if only one node is evaluated.
    fn other_nodes(&self) -> Option<impl Iterator<Item = Self>>;

    /// Whether the node is the only CANopen node on its bus.
    fn is_alone(&self) -> Option<bool>;
}

impl DeviceCondition {
    /// Object that the condition depends on.
    pub(crate) fn object(&self) -> Option<ObjectAddress> {
        match self {
            Self::Object { object, .. } | Self::Inside { object, .. } | Self::Known(object) => {
                Some(object.object)
            }
            Self::Nmt(_)
            | Self::State(_)
            | Self::Sync
            | Self::NoError
            | Self::NoProcedure
            | Self::Younger(_)
            | Self::Invisible
            | Self::Other(_)
            | Self::Alone => None,
        }
    }

    /// Evaluates the condition for an output of the device: `Open` if it holds.
    pub(crate) fn evaluate_condition(&self, facts: &impl DeviceFacts, channel: Option<u8>) -> GateStatus {
        match self {
            Self::Nmt(wanted) => facts
                .nmt_state()
                .map_or(GateStatus::Unknown, |state| GateStatus::from_truth(state == wanted.state())),
            Self::Object { object, mask, values, negated } => {
                facts.object_number(object.object).map_or(GateStatus::Unknown, |number| {
                    let holds = values.contains(mask_number(number.raw, *mask)) != *negated;
                    GateStatus::of_number(holds, number)
                })
            }
            Self::Inside { object, range: [least, most] } => {
                facts.object_number(object.object).map_or(GateStatus::Unknown, |number| {
                    GateStatus::of_number((*least..=*most).contains(&number.raw), number)
                })
            }
            Self::Known(object) => match facts.object_number(object.object) {
                Some(number) if !number.assumed => GateStatus::Open,
                _ => GateStatus::Invisible,
            },
            Self::State(states) => match facts.reported_state(channel) {
                None => GateStatus::Unknown,
                Some(state) if states.iter().any(|wanted| wanted == state) => GateStatus::Open,
                Some(_) if facts.is_commanded(channel, states) => GateStatus::Unknown,
                Some(_) => GateStatus::Closed,
            },
            Self::Sync => GateStatus::from_truth(facts.sync_age().is_some_and(|age| age <= SYNC_AGE)),
            Self::NoError => GateStatus::from_truth(!facts.has_error()),
            Self::NoProcedure => GateStatus::from_truth(!facts.is_taken_over()),
            // A PDO is evaluated when it arrives; for messages, the session tracks the overdue ones.
            Self::Younger(_) => GateStatus::from_truth(!facts.is_overdue()),
            Self::Invisible => GateStatus::Invisible,
            Self::Other(conditions) => is_met_by_other(conditions, facts),
            Self::Alone => facts.is_alone().map_or(GateStatus::Unknown, GateStatus::from_truth),
        }
    }
}

/// Evaluates conditions that must all hold for an output of the device: `Open` if there are none.
pub(crate) fn evaluate_all<'c>(
    conditions: impl IntoIterator<Item = &'c DeviceCondition>,
    facts: &impl DeviceFacts,
    channel: Option<u8>,
) -> GateStatus {
    let mut all = GateStatus::Open;
    for condition in conditions {
        all = all.and(condition.evaluate_condition(facts, channel));
        if all == GateStatus::Closed {
            break;
        }
    }
    all
}

/// Raw number reduced by a mask.
pub(super) fn mask_number(raw: i64, mask: u64) -> i64 {
    (raw.cast_unsigned() & mask).cast_signed()
}

/// Whether at least one other node meets all conditions.
fn is_met_by_other(conditions: &DeviceConditions, facts: &impl DeviceFacts) -> GateStatus {
    let Some(others) = facts.other_nodes() else { return GateStatus::Unknown };
    let mut any = GateStatus::Closed;
    for node in others {
        match evaluate_all(&conditions.0, &node, None) {
            GateStatus::Open => return GateStatus::Open,
            GateStatus::Closed => {}
            GateStatus::Unknown | GateStatus::Invisible => any = GateStatus::Unknown,
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use GateStatus::{Closed, Invisible, Open, Unknown};

    use super::*;

    /// Facts that are unknown unless a test sets them.
    #[derive(Debug, Clone, Default)]
    struct TestFacts {
        nmt_state: Option<NmtState>,
        numbers: Vec<(&'static str, i64, bool)>,
        states: Vec<(u8, &'static str)>,
        commanded: Vec<(u8, &'static str)>,
        sync_age: Option<i64>,
        has_error: bool,
        is_taken_over: bool,
        is_overdue: bool,
        others: Option<Vec<TestFacts>>,
        is_alone: Option<bool>,
    }

    impl DeviceFacts for TestFacts {
        fn nmt_state(&self) -> Option<NmtState> {
            self.nmt_state
        }

        fn object_number(&self, object: ObjectAddress) -> Option<DecidingNumber> {
            let known = self.numbers.iter().find(|(name, ..)| object.to_string() == *name);
            known.map(|(_, raw, assumed)| DecidingNumber { raw: *raw, assumed: *assumed })
        }

        fn reported_state(&self, channel: Option<u8>) -> Option<&str> {
            let mut states = self.states.iter();
            states.find(|(of, _)| channel.is_none_or(|channel| channel == *of)).map(|(_, state)| *state)
        }

        fn is_commanded(&self, channel: Option<u8>, states: &[String]) -> bool {
            self.commanded.iter().any(|(of, to)| Some(*of) == channel && states.iter().any(|it| it == to))
        }

        fn sync_age(&self) -> Option<i64> {
            self.sync_age
        }

        fn has_error(&self) -> bool {
            self.has_error
        }

        fn is_taken_over(&self) -> bool {
            self.is_taken_over
        }

        fn is_overdue(&self) -> bool {
            self.is_overdue
        }

        fn other_nodes(&self) -> Option<impl Iterator<Item = Self>> {
            self.others.clone().map(Vec::into_iter)
        }

        fn is_alone(&self) -> Option<bool> {
            self.is_alone
        }
    }

    fn condition(text: &str) -> DeviceCondition {
        toml::from_str(text).unwrap()
    }

    fn evaluate_condition(text: &str, facts: &TestFacts) -> GateStatus {
        condition(text).evaluate_condition(facts, Some(1))
    }

    /// Facts with a raw number in object 2000:00.
    fn holding(raw: i64, assumed: bool) -> TestFacts {
        TestFacts { numbers: vec![("2000:00", raw, assumed)], ..TestFacts::default() }
    }

    #[test]
    fn nmt_compares_the_state() {
        let in_state = |nmt_state| TestFacts { nmt_state, ..TestFacts::default() };
        let wanted = "nmt = \"operational\"";
        assert_eq!(evaluate_condition(wanted, &in_state(Some(NmtState::Operational))), Open);
        assert_eq!(evaluate_condition(wanted, &in_state(Some(NmtState::PreOperational))), Closed);
        assert_eq!(evaluate_condition(wanted, &in_state(None)), Unknown);
    }

    #[test]
    fn equals_is_met_by_any_of_its_values() {
        let wanted = "object = \"2000:00\"\nequals = [1, -3]";
        assert_eq!(evaluate_condition(wanted, &holding(1, false)), Open);
        assert_eq!(evaluate_condition(wanted, &holding(-3, false)), Open);
        assert_eq!(evaluate_condition(wanted, &holding(2, false)), Closed);
        assert_eq!(evaluate_condition(wanted, &TestFacts::default()), Unknown);
    }

    #[test]
    fn not_is_met_by_all_other_values() {
        let wanted = "object = \"2000:00\"\nnot = [1, -3]";
        assert_eq!(evaluate_condition(wanted, &holding(2, false)), Open);
        assert_eq!(evaluate_condition(wanted, &holding(-3, false)), Closed);
        assert_eq!(evaluate_condition(wanted, &TestFacts::default()), Unknown);
    }

    #[test]
    fn mask_selects_the_bits_that_are_compared() {
        let wanted = "object = \"2000:00\"\nmask = 0x0C\nequals = 0x08";
        assert_eq!(evaluate_condition(wanted, &holding(0x1B, false)), Open);
        assert_eq!(evaluate_condition(wanted, &holding(0x0C, false)), Closed);
        // The mask also applies to the sign bit.
        assert_eq!(
            evaluate_condition("object = \"2000:00\"\nmask = 0x80\nnot = 0", &holding(-1, false)),
            Open
        );
    }

    #[test]
    fn range_includes_both_ends() {
        let wanted = "object = \"2000:00\"\nrange = [-2, 5]";
        let at = |raw| evaluate_condition(wanted, &holding(raw, false));
        assert_eq!([-3, -2, 0, 5, 6].map(at), [Closed, Open, Open, Open, Closed]);
        assert_eq!(evaluate_condition(wanted, &TestFacts::default()), Unknown);
    }

    #[test]
    fn an_assumed_value_opens_but_never_closes() {
        for wanted in ["equals = 1", "not = 2", "range = [0, 1]"] {
            let wanted = format!("object = \"2000:00\"\n{wanted}");
            assert_eq!(evaluate_condition(&wanted, &holding(1, true)), Open, "{wanted}");
            assert_eq!(evaluate_condition(&wanted, &holding(2, true)), Unknown, "{wanted}");
        }
    }

    #[test]
    fn state_is_that_of_the_channel_and_unknown_on_its_way() {
        let mut facts = TestFacts { states: vec![(1, "HOLD"), (2, "ACTIVE")], ..TestFacts::default() };
        let wanted = condition("state = [\"ACTIVE\", \"READY\"]");
        assert_eq!(wanted.evaluate_condition(&facts, Some(1)), Closed);
        assert_eq!(wanted.evaluate_condition(&facts, Some(2)), Open);
        assert_eq!(wanted.evaluate_condition(&facts, Some(3)), Unknown);
        facts.commanded = vec![(1, "READY")];
        assert_eq!(wanted.evaluate_condition(&facts, Some(1)), Unknown);
        facts.commanded = vec![(1, "OFF")];
        assert_eq!(wanted.evaluate_condition(&facts, Some(1)), Closed);
    }

    #[test]
    fn sync_is_present_for_one_second() {
        let after =
            |sync_age| evaluate_condition("sync = true", &TestFacts { sync_age, ..TestFacts::default() });
        assert_eq!(after(Some(1_000_000_000)), Open);
        assert_eq!(after(Some(1_000_000_001)), Closed);
        assert_eq!(after(None), Closed);
    }

    #[test]
    fn errors_procedures_and_overdue_messages_close() {
        let idle = TestFacts::default();
        for wanted in ["no_error = true", "no_procedure = true", "younger = 100"] {
            assert_eq!(evaluate_condition(wanted, &idle), Open, "{wanted}");
        }
        let error = TestFacts { has_error: true, ..TestFacts::default() };
        assert_eq!(evaluate_condition("no_error = true", &error), Closed);
        let procedure = TestFacts { is_taken_over: true, ..TestFacts::default() };
        assert_eq!(evaluate_condition("no_procedure = true", &procedure), Closed);
        let overdue = TestFacts { is_overdue: true, ..TestFacts::default() };
        assert_eq!(evaluate_condition("younger = 100", &overdue), Closed);
    }

    #[test]
    fn invisible_is_neither_open_nor_closed() {
        assert_eq!(evaluate_condition("visible = false", &TestFacts::default()), Invisible);
    }

    #[test]
    fn one_other_node_is_enough() {
        let wanted = "other = { object = \"2000:00\", equals = 1 }";
        let among = |others: &[TestFacts]| {
            evaluate_condition(wanted, &TestFacts { others: Some(others.to_vec()), ..TestFacts::default() })
        };
        let (met, unmet, unknown) = (holding(1, false), holding(2, false), TestFacts::default());
        assert_eq!(among(&[]), Closed);
        assert_eq!(among(std::slice::from_ref(&unmet)), Closed);
        assert_eq!(among(&[unknown.clone(), unmet.clone()]), Unknown);
        assert_eq!(among(&[unmet, unknown, met]), Open);
        assert_eq!(evaluate_condition(wanted, &TestFacts::default()), Unknown);
    }

    #[test]
    fn one_other_node_must_meet_all() {
        let wanted = "other = [{ object = \"2000:00\", equals = 1 }, { no_error = true }]";
        let failed = TestFacts { has_error: true, ..holding(1, false) };
        let facts = |others: Vec<TestFacts>| TestFacts { others: Some(others), ..TestFacts::default() };
        assert_eq!(evaluate_condition(wanted, &facts(vec![failed.clone(), holding(2, false)])), Closed);
        assert_eq!(evaluate_condition(wanted, &facts(vec![failed, holding(1, false)])), Open);
    }

    #[test]
    fn alone_is_a_fact() {
        let facts = |is_alone| TestFacts { is_alone, ..TestFacts::default() };
        assert_eq!(evaluate_condition("alone = true", &facts(Some(true))), Open);
        assert_eq!(evaluate_condition("alone = true", &facts(Some(false))), Closed);
        assert_eq!(evaluate_condition("alone = true", &facts(None)), Unknown);
    }

    #[test]
    fn of_several_conditions_the_worst_counts() {
        let (open, closed) = ("no_error = true", "no_procedure = true");
        let (unknown, invisible) = ("nmt = \"stopped\"", "visible = false");
        let facts = TestFacts { is_taken_over: true, ..TestFacts::default() };
        let all = |texts: &[&str]| {
            let conditions: Vec<DeviceCondition> = texts.iter().map(|text| condition(text)).collect();
            evaluate_all(&conditions, &facts, None)
        };
        assert_eq!(all(&[]), Open);
        assert_eq!(all(&[open, invisible]), Invisible);
        assert_eq!(all(&[open, invisible, unknown]), Unknown);
        assert_eq!(all(&[unknown, closed, open]), Closed);
    }
}
