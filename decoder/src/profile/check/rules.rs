//! Checks of device rules.

use std::ops::Range;

use super::objects::fits_type;
use super::{ProfileCheck, is_kebab};
use crate::profile::device::{DeviceCondition, DeviceRule, ProfileTrigger, RuleKind};
use crate::profile::lookup::lss_names;
use crate::profile::object::NumberList;

/// States of the trigger `reports`.
const REPORTED: [&str; 5] = ["initialising", "pre-operational", "operational", "stopped", "undefined"];

impl ProfileCheck<'_> {
    pub(super) fn check_rules(&mut self) {
        let device = self.device;
        let rules = || device.rules.iter().zip(&device.places.rules);
        for (rule, span) in rules() {
            self.check_rule(rule, span);
            // Repeats of one rule have the same position.
            if rules().any(|(other, place)| other.name == rule.name && place.start < span.start) {
                self.report_problem(span, format!("duplicate rule '{}'", rule.name));
            }
        }
        for gate in device.gates.iter().zip(&device.places.gates) {
            gate.0.open.0.iter().for_each(|open| self.not_of_rules(open, gate.1));
        }
        for (procedure, span) in device.procedures.iter().zip(&device.places.procedures) {
            procedure.needs.iter().for_each(|need| self.not_of_rules(need, span));
            for trigger in procedure.all_triggers().filter(|trigger| trigger.is_of_rules()) {
                self.report_problem(span, format!("trigger {trigger:?} is valid in rules only"));
            }
        }
    }

    fn check_rule(&mut self, rule: &DeviceRule, span: &Range<usize>) {
        for name in
            rule.takes_in.iter().chain(&rule.follows).chain([&rule.name]).filter(|name| !is_kebab(name))
        {
            self.report_problem(span, format!("invalid rule name '{name}'; expected a-z, 0-9 and hyphens"));
        }
        if rule.bus.is_some() || rule.node.is_some() {
            self.report_problem(span, "bus and node are valid in bus files only");
        }
        if rule.takes_in.contains(&rule.name) {
            self.report_problem(span, "takes_in contains the rule itself");
        }
        if let Some(missing) = rule.missing_keys() {
            self.report_problem(span, format!("a rule of this kind requires {missing}"));
        }
        let lists = [&rule.on, &rule.then, &rule.before, &rule.since, &rule.until, &rule.after];
        for trigger in lists.into_iter().chain(&rule.steps).flat_map(|it| &it.0) {
            self.check_trigger(trigger, span);
            self.trigger_of_rules(trigger, span);
        }
        rule.needs.0.iter().chain(&rule.during.0).for_each(|need| self.check_condition(need, span));
        rule.ms_of.iter().for_each(|of| self.check_known(*of, span, "ms_of"));
        rule.within.iter().for_each(|of| self.check_known(*of, span, "within"));
        self.check_rule_values(rule, span);
        self.check_ascending(rule.range, rule.limits, span);
    }

    fn check_rule_values(&mut self, rule: &DeviceRule, span: &Range<usize>) {
        let listed = match &rule.values {
            Some(NumberList::One(one)) => std::slice::from_ref(one),
            Some(NumberList::Any(any)) => any,
            None => &[],
        };
        let chosen = matches!(rule.kind, RuleKind::Limit | RuleKind::Forbidden | RuleKind::Permitted);
        for object in rule.rule_objects() {
            self.check_known(object, span, "object");
            let Some(data_type) = self.device.dictionary.data_type(object.object) else { continue };
            let outside =
                listed.iter().chain(rule.range.iter().flatten()).find(|it| !fits_type(**it, data_type));
            if let Some(outside) = outside.filter(|_| chosen) {
                self.report_problem(span, format!("{outside} does not fit {}", object.object));
            }
        }
    }

    fn trigger_of_rules(&mut self, trigger: &ProfileTrigger, span: &Range<usize>) {
        match trigger {
            ProfileTrigger::Set(set) => self.check_known(set.object, span, "set"),
            ProfileTrigger::Shows(set) => self.check_known(set.object, span, "shows"),
            ProfileTrigger::Reports(states) => {
                for state in states.iter().filter(|state| !REPORTED.contains(&state.as_str())) {
                    self.report_problem(span, format!("unknown NMT state '{state}'"));
                }
            }
            ProfileTrigger::Message(message) if message.times != 1 || !message.when.0.is_empty() => {
                self.report_problem(span, "times and when of a message are valid in procedures only");
            }
            ProfileTrigger::Lss(service) if !lss_names().has_service(&service.service) => {
                self.report_problem(span, format!("unknown LSS service '{}'", service.service));
            }
            _ => {}
        }
    }

    fn not_of_rules(&mut self, condition: &DeviceCondition, span: &Range<usize>) {
        if matches!(condition, DeviceCondition::Other(_) | DeviceCondition::Alone) {
            self.report_problem(span, "conditions on other nodes are valid in rules only");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::errors;

    fn check_rule(keys: &str) -> Vec<String> {
        errors(&format!("[[rule]]\nname = \"r\"\nseverity = \"note\"\ntext = \"t\"\n{keys}\n"))
    }

    #[test]
    fn rules_have_the_keys_of_their_kind() {
        assert_eq!(
            check_rule("kind = \"limit\"\nobject = \"1001:00\""),
            ["2: a rule of this kind requires object, and range, limits or within"]
        );
        assert_eq!(check_rule("kind = \"never\""), ["2: a rule of this kind requires on"]);
        let counted = "kind = \"max-count\"\non = { guard = true }\ncount = 2\nper = \"while\"";
        assert_eq!(
            check_rule(counted),
            ["2: a rule of this kind requires on, count and per, and while with per = \"while\""]
        );
        assert_eq!(check_rule(&format!("{counted}\nwhile = {{ alone = true }}")), [""; 0]);
        let order = "kind = \"order\"\non = [{ nmt = \"start\" }, { set = \"1017:00\", not = 0 }]\n\
                     before = { lss = \"store-configuration\", answer = true, equals = 0 }\nsince = { boot = true }";
        assert_eq!(check_rule(order), [""; 0]);
        assert_eq!(check_rule("kind = \"node-id\""), ["2: a rule of this kind requires range"]);
        let requested = "kind = \"on-request\"\ngroups = [65227]";
        assert_eq!(check_rule(requested), ["2: a rule of this kind requires groups, and ms or ms_of"]);
        let constant = "kind = \"constant\"\non = { sync = true }";
        assert_eq!(check_rule(constant), ["2: a rule of this kind requires on with PDOs only"]);
        let length = "kind = \"message-length\"\non = { pdo = \"RPDO1\" }\nbytes = 8";
        assert_eq!(check_rule(length), ["2: a rule of this kind requires on with messages only, and bytes"]);
        assert_eq!(check_rule("kind = \"expedited\"\nexcept = [\"1008:00..100A:00\"]"), [""; 0]);
    }

    #[test]
    fn what_limits_begins_before_it_ends() {
        let limit = |keys: &str| check_rule(&format!("kind = \"limit\"\nobject = \"1001:00\"\n{keys}"));
        assert_eq!(limit("limits = [0, 280]"), [""; 0]);
        assert_eq!(limit("limits = [280, 0]"), ["2: limits 280 to 0; expected the minimum first"]);
        assert_eq!(limit("range = [9, 0]"), ["2: range 9 to 0; expected the minimum first"]);
    }

    #[test]
    fn rules_name_what_there_is() {
        assert_eq!(
            check_rule("kind = \"permitted\"\nobject = \"1001:00\"\nvalues = [1, 256]"),
            ["2: 256 does not fit 1001:00"]
        );
        assert_eq!(
            check_rule("kind = \"never\"\non = { set = \"2000:00\" }"),
            ["2: set: unknown object 2000:00"]
        );
        assert_eq!(
            check_rule("kind = \"never\"\non = { lss = \"store\" }"),
            ["2: unknown LSS service 'store'"]
        );
        assert_eq!(
            check_rule("kind = \"never\"\non = { guard = true }\ntakes_in = [\"r\", \"Other\"]"),
            [
                "2: invalid rule name 'Other'; expected a-z, 0-9 and hyphens",
                "2: takes_in contains the rule itself"
            ]
        );
        assert_eq!(
            check_rule("kind = \"never\"\non = { shows = \"2000:00\", mask = 1, not = 0 }"),
            ["2: shows: unknown object 2000:00"]
        );
        assert_eq!(
            check_rule("kind = \"never\"\non = { reports = [\"stopped\", \"lost\"] }"),
            ["2: unknown NMT state 'lost'"]
        );
        let one = "[[rule]]\nname = \"r\"\nseverity = \"note\"\ntext = \"t\"\nkind = \"remote-length\"\n";
        assert_eq!(errors(&format!("{one}{one}")), ["7: duplicate rule 'r'"]);
    }

    #[test]
    fn gates_and_procedures_leave_rules_what_is_theirs() {
        let gate = "[[gate]]\nname = \"g\"\nopen = { other = { nmt = \"operational\" } }\n";
        assert_eq!(errors(gate), ["2: conditions on other nodes are valid in rules only"]);
        let procedure = "[[procedure]]\nname = \"p\"\nstart = { guard = true }\n";
        assert_eq!(errors(procedure), ["2: trigger Guard is valid in rules only"]);
    }
}
