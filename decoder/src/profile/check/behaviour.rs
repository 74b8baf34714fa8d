//! Checks of state machines, gates and procedures, with the references of their conditions and triggers.

use std::ops::Range;

use super::ProfileCheck;
use crate::profile::data_type::DataType;
use crate::profile::device::{DeviceCondition, ExpectedValue, ProfileTrigger, StateMachine};

/// Max machines, gates, procedures or rules of a device, including repeats.
const MOST_REPEATS: usize = 512;

impl ProfileCheck<'_> {
    /// Limits the repeats, because each one is stored separately.
    fn check_repeats(&mut self) {
        let places = &self.device.places;
        let lists = [&places.machines, &places.gates, &places.procedures, &places.rules];
        for span in lists.into_iter().filter_map(|list| list.get(MOST_REPEATS).cloned()) {
            self.report_problem(
                &span,
                format!("more than {MOST_REPEATS} machines, gates, procedures or rules, including repeats"),
            );
        }
    }

    pub(super) fn check_behaviour(&mut self) {
        self.check_repeats();
        let device = self.device;
        for (machine, span) in device.machines.iter().zip(&device.places.machines) {
            self.check_machine(machine, span);
        }
        for (gate, span) in device.gates.iter().zip(&device.places.gates) {
            gate.of.iter().chain(&gate.closes).for_each(|of| self.check_known(*of, span, "for"));
            gate.open.0.iter().for_each(|open| self.check_condition(open, span));
        }
        for (procedure, span) in device.procedures.iter().zip(&device.places.procedures) {
            procedure.all_triggers().for_each(|trigger| self.check_trigger(trigger, span));
            if let Some(status) = &procedure.status {
                self.check_known(status.object, span, "status");
                if !device.codes.contains_key(&status.codes) {
                    self.report_problem(span, format!("unknown table [codes.{}]", status.codes));
                }
            }
            procedure.needs.iter().for_each(|need| self.check_condition(need, span));
        }
    }

    fn check_machine(&mut self, machine: &StateMachine, span: &Range<usize>) {
        self.check_known(machine.status.object, span, "status");
        self.check_known(machine.control.object, span, "control");
        let named = |name: &String| machine.states.iter().any(|state| state.name == *name);
        let transitions = machine.transitions.iter().flat_map(|it| it.from.0.iter().chain([&it.to]));
        let forced = machine.forced.iter().flat_map(|it| it.from.0.iter().chain([&it.to]));
        let unknown: Vec<_> = transitions.chain(forced).filter(|name| !named(name)).cloned().collect();
        for name in unknown {
            self.report_problem(span, format!("machine {} has no state '{name}'", machine.name));
        }
    }

    pub(super) fn check_condition(&mut self, condition: &DeviceCondition, span: &Range<usize>) {
        match condition {
            DeviceCondition::Object { object, .. }
            | DeviceCondition::Inside { object, .. }
            | DeviceCondition::Known(object) => {
                self.check_known(*object, span, "condition");
            }
            DeviceCondition::Other(all) => all.0.iter().for_each(|one| self.check_condition(one, span)),
            DeviceCondition::State(states) => self.check_states(states, span),
            _ => {}
        }
    }

    pub(super) fn check_trigger(&mut self, trigger: &ProfileTrigger, span: &Range<usize>) {
        match trigger {
            ProfileTrigger::Write(object, wanted) | ProfileTrigger::Read(object, wanted) => {
                self.check_known(*object, span, "trigger");
                let data_type = self.device.dictionary.data_type(object.object);
                if let (Some(ExpectedValue::Text(text)), Some(known)) =
                    (wanted, data_type.and_then(DataType::bits))
                    && text.len() * 8 != usize::from(known)
                {
                    self.report_problem(span, format!("'{text}' does not fit {}", object.object));
                }
            }
            ProfileTrigger::Bit(bit, _) => self.check_known(bit.object, span, "bit"),
            ProfileTrigger::State(states) => self.check_states(states, span),
            ProfileTrigger::Message(message) => {
                if !self.device.messages.iter().any(|spec| spec.name == message.name) {
                    self.report_problem(span, format!("unknown message '{}'", message.name));
                }
                message.when.0.iter().for_each(|when| self.check_condition(when, span));
            }
            ProfileTrigger::Dtc(Some((parameter, fmi)))
                if self.device.trouble_code_entry(*parameter, *fmi).is_none() =>
            {
                self.report_problem(span, format!("unknown fault {parameter}/{fmi}"));
            }
            _ => {}
        }
    }

    fn check_states(&mut self, states: &[String], span: &Range<usize>) {
        let named = |name: &String| {
            self.device.machines.iter().any(|machine| machine.states.iter().any(|state| state.name == *name))
        };
        let unknown: Vec<_> = states.iter().filter(|name| !named(name)).cloned().collect();
        for name in unknown {
            self.report_problem(span, format!("unknown state '{name}'; no machine defines it"));
        }
    }
}
