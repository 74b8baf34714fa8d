//! What is wrong with the rules of a device.

use std::ops::Range;

use super::objects::fits;
use super::{Check, is_kebab};
use crate::profile::device::{Condition, DeviceRule, RuleKind, Trigger};
use crate::profile::lookup::lss;
use crate::profile::object::Numbers;

impl Check<'_> {
    pub(super) fn rules(&mut self) {
        let device = self.device;
        let rules = || device.rules.iter().zip(&device.places.rules);
        for (rule, span) in rules() {
            self.rule(rule, span);
            // Repeats of one rule stand at one place.
            if rules().any(|(other, place)| other.name == rule.name && place.start < span.start) {
                self.say(span, format!("there are two rules '{}'", rule.name));
            }
        }
        for gate in device.gates.iter().zip(&device.places.gates) {
            gate.0.open.0.iter().for_each(|open| self.not_of_rules(open, gate.1));
        }
        for (procedure, span) in device.procedures.iter().zip(&device.places.procedures) {
            procedure.needs.iter().for_each(|need| self.not_of_rules(need, span));
            for trigger in procedure.triggers().filter(|trigger| trigger.is_of_rules()) {
                self.say(span, format!("only rules know this trigger: {trigger:?}"));
            }
        }
    }

    fn rule(&mut self, rule: &DeviceRule, span: &Range<usize>) {
        for name in rule.takes_in.iter().chain([&rule.name]).filter(|name| !is_kebab(name)) {
            self.say(span, format!("'{name}' is no name of a rule: small letters, digits and hyphens"));
        }
        if rule.takes_in.contains(&rule.name) {
            self.say(span, "a rule does not take itself in");
        }
        if let Some(missing) = rule.missing() {
            self.say(span, format!("a rule of this kind needs {missing}"));
        }
        for trigger in
            [&rule.on, &rule.then, &rule.before, &rule.since, &rule.after].into_iter().flat_map(|it| &it.0)
        {
            self.trigger(trigger, span);
            self.trigger_of_rules(trigger, span);
        }
        rule.needs.0.iter().chain(&rule.during.0).for_each(|need| self.condition(need, span));
        rule.ms_of.iter().for_each(|of| self.known(*of, span, "ms_of"));
        self.values(rule, span);
        self.ascends(rule.range, rule.limits, span);
    }

    fn values(&mut self, rule: &DeviceRule, span: &Range<usize>) {
        let listed = match &rule.values {
            Some(Numbers::One(one)) => std::slice::from_ref(one),
            Some(Numbers::Any(any)) => any,
            None => &[],
        };
        let chosen = matches!(rule.kind, RuleKind::Limit | RuleKind::Forbidden | RuleKind::Permitted);
        for object in rule.subjects() {
            self.known(object, span, "object");
            let Some(data_type) = self.device.dictionary.data_type(object.object) else { continue };
            let outside = listed.iter().chain(rule.range.iter().flatten()).find(|it| !fits(**it, data_type));
            if let Some(outside) = outside.filter(|_| chosen) {
                self.say(span, format!("{outside} does not fit {}", object.object));
            }
        }
    }

    fn trigger_of_rules(&mut self, trigger: &Trigger, span: &Range<usize>) {
        match trigger {
            Trigger::Set(set) => self.known(set.object, span, "set"),
            Trigger::Message(message) if message.times != 1 || !message.when.0.is_empty() => {
                self.say(span, "times and when of a message go with procedures");
            }
            Trigger::Lss(service) if !lss().has(&service.service) => {
                self.say(span, format!("there is no LSS service '{}'", service.service));
            }
            _ => {}
        }
    }

    fn not_of_rules(&mut self, condition: &Condition, span: &Range<usize>) {
        if matches!(condition, Condition::Other(_) | Condition::Alone) {
            self.say(span, "only rules look at other nodes");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::errors;

    fn rule(keys: &str) -> Vec<String> {
        errors(&format!("[[rule]]\nname = \"r\"\nseverity = \"note\"\ntext = \"t\"\n{keys}\n"))
    }

    #[test]
    fn rules_have_the_keys_of_their_kind() {
        assert_eq!(
            rule("kind = \"limit\"\nobject = \"1001:00\""),
            ["2: a rule of this kind needs object, and range or limits"]
        );
        assert_eq!(rule("kind = \"never\""), ["2: a rule of this kind needs on"]);
        let counted = "kind = \"max-count\"\non = { guard = true }\ncount = 2\nper = \"while\"";
        assert_eq!(rule(counted), ["2: a rule of this kind needs on, count, per and its while"]);
        assert_eq!(rule(&format!("{counted}\nwhile = {{ alone = true }}")), [""; 0]);
        let order = "kind = \"order\"\non = [{ nmt = \"start\" }, { set = \"1017:00\", not = 0 }]\n\
                     before = { lss = \"store-configuration\", answer = true, equals = 0 }\nsince = { boot = true }";
        assert_eq!(rule(order), [""; 0]);
        assert_eq!(rule("kind = \"expedited\"\nexcept = [\"1008:00..100A:00\"]"), [""; 0]);
    }

    #[test]
    fn what_limits_begins_before_it_ends() {
        let limit = |keys: &str| rule(&format!("kind = \"limit\"\nobject = \"1001:00\"\n{keys}"));
        assert_eq!(limit("limits = [0, 280]"), [""; 0]);
        assert_eq!(limit("limits = [280, 0]"), ["2: limits 280 to 0 end before they begin"]);
        assert_eq!(limit("range = [9, 0]"), ["2: range 9 to 0 ends before it begins"]);
    }

    #[test]
    fn rules_name_what_there_is() {
        assert_eq!(
            rule("kind = \"permitted\"\nobject = \"1001:00\"\nvalues = [1, 256]"),
            ["2: 256 does not fit 1001:00"]
        );
        assert_eq!(
            rule("kind = \"never\"\non = { set = \"2000:00\" }"),
            ["2: set: 2000:00 is no object of this profile"]
        );
        assert_eq!(
            rule("kind = \"never\"\non = { lss = \"store\" }"),
            ["2: there is no LSS service 'store'"]
        );
        assert_eq!(
            rule("kind = \"never\"\non = { guard = true }\ntakes_in = [\"r\", \"Other\"]"),
            [
                "2: 'Other' is no name of a rule: small letters, digits and hyphens",
                "2: a rule does not take itself in"
            ]
        );
        let one = "[[rule]]\nname = \"r\"\nseverity = \"note\"\ntext = \"t\"\nkind = \"remote-length\"\n";
        assert_eq!(errors(&format!("{one}{one}")), ["7: there are two rules 'r'"]);
    }

    #[test]
    fn gates_and_procedures_leave_rules_what_is_theirs() {
        let gate = "[[gate]]\nname = \"g\"\nopen = { other = { nmt = \"operational\" } }\n";
        assert_eq!(errors(gate), ["2: only rules look at other nodes"]);
        let procedure = "[[procedure]]\nname = \"p\"\nstart = { guard = true }\n";
        assert_eq!(errors(procedure), ["2: only rules know this trigger: Guard"]);
    }
}
