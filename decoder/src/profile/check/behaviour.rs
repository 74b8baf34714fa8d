//! Checks of state machines, gates and procedures, with the references of their conditions and triggers.

use std::ops::Range;

use super::Check;
use crate::profile::data_type::DataType;
use crate::profile::device::{Condition, ExpectedValue, Machine, Trigger};

/// Max machines, gates, procedures or rules of a device, including repeats.
const MOST_REPEATS: usize = 512;

impl Check<'_> {
    /// Limits the repeats, because each one is stored separately.
    fn repeats(&mut self) {
        let places = &self.device.places;
        let lists = [&places.machines, &places.gates, &places.procedures, &places.rules];
        for span in lists.into_iter().filter_map(|list| list.get(MOST_REPEATS).cloned()) {
            self.report(
                &span,
                format!("more than {MOST_REPEATS} machines, gates, procedures or rules, including repeats"),
            );
        }
    }

    pub(super) fn behaviour(&mut self) {
        self.repeats();
        let device = self.device;
        for (machine, span) in device.machines.iter().zip(&device.places.machines) {
            self.machine(machine, span);
        }
        for (gate, span) in device.gates.iter().zip(&device.places.gates) {
            gate.of.iter().chain(&gate.closes).for_each(|of| self.known(*of, span, "for"));
            gate.open.0.iter().for_each(|open| self.condition(open, span));
        }
        for (procedure, span) in device.procedures.iter().zip(&device.places.procedures) {
            procedure.triggers().for_each(|trigger| self.trigger(trigger, span));
            if let Some(status) = &procedure.status {
                self.known(status.object, span, "status");
                if !device.codes.contains_key(&status.codes) {
                    self.report(span, format!("unknown table [codes.{}]", status.codes));
                }
            }
            procedure.needs.iter().for_each(|need| self.condition(need, span));
        }
    }

    fn machine(&mut self, machine: &Machine, span: &Range<usize>) {
        self.known(machine.status.object, span, "status");
        self.known(machine.control.object, span, "control");
        let named = |name: &String| machine.states.iter().any(|state| state.name == *name);
        let transitions = machine.transitions.iter().flat_map(|it| it.from.0.iter().chain([&it.to]));
        let forced = machine.forced.iter().flat_map(|it| it.from.0.iter().chain([&it.to]));
        let unknown: Vec<_> = transitions.chain(forced).filter(|name| !named(name)).cloned().collect();
        for name in unknown {
            self.report(span, format!("machine {} has no state '{name}'", machine.name));
        }
    }

    pub(super) fn condition(&mut self, condition: &Condition, span: &Range<usize>) {
        match condition {
            Condition::Object { object, .. } | Condition::Inside { object, .. } => {
                self.known(*object, span, "condition");
            }
            Condition::Other(all) => all.0.iter().for_each(|one| self.condition(one, span)),
            Condition::State(states) => self.states(states, span),
            _ => {}
        }
    }

    pub(super) fn trigger(&mut self, trigger: &Trigger, span: &Range<usize>) {
        match trigger {
            Trigger::Write(object, wanted) | Trigger::Read(object, wanted) => {
                self.known(*object, span, "trigger");
                let data_type = self.device.dictionary.data_type(object.object);
                if let (Some(ExpectedValue::Text(text)), Some(known)) =
                    (wanted, data_type.and_then(DataType::bits))
                    && text.len() * 8 != usize::from(known)
                {
                    self.report(span, format!("'{text}' does not fit {}", object.object));
                }
            }
            Trigger::Bit(bit, _) => self.known(bit.object, span, "bit"),
            Trigger::State(states) => self.states(states, span),
            Trigger::Message(message) => {
                if !self.device.messages.iter().any(|spec| spec.name == message.name) {
                    self.report(span, format!("unknown message '{}'", message.name));
                }
                message.when.0.iter().for_each(|when| self.condition(when, span));
            }
            Trigger::Dtc(Some((parameter, fmi))) if self.device.dtc(*parameter, *fmi).is_none() => {
                self.report(span, format!("unknown fault {parameter}/{fmi}"));
            }
            _ => {}
        }
    }

    fn states(&mut self, states: &[String], span: &Range<usize>) {
        let named = |name: &String| {
            self.device.machines.iter().any(|machine| machine.states.iter().any(|state| state.name == *name))
        };
        let unknown: Vec<_> = states.iter().filter(|name| !named(name)).cloned().collect();
        for name in unknown {
            self.report(span, format!("unknown state '{name}'; no machine defines it"));
        }
    }
}
