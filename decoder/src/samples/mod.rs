//! Samples of profiles: frames that are decoded, and the expected result of the last frame.
//!
//! `profiles/README.md` defines the contents of a sample. Expected values never originate from this program.

mod run;
mod uds;

use std::fmt::Display;
use std::ops::Range;
use std::sync::Arc;

use toml::Spanned;

use crate::event::{
    DecodedPdo, DeviceState, Dtc, EffectiveState, Emergency, EventKind, J1939Message, SdoOutcome, SdoTransfer,
};
use crate::profile::device::ProfileSample;
use crate::profile::{
    DecodedValue, DeviceProfile, ObjectMeaning, PayloadLayout, TextError, as_integer, as_word, emcy_codes,
};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;
use run::SampleOutcomes;

/// Runs all samples of one device variant; `text` is the text of its profile.
pub fn check_samples(text: &str, device: &Arc<DeviceProfile>) -> Vec<TextError> {
    let mut wrong = Vec::new();
    for (span, sample) in &device.samples {
        let mut run = SampleRun { text, span, sample, device, wrong: Vec::new() };
        run.check_sample();
        wrong.append(&mut run.wrong);
    }
    wrong
}

struct SampleRun<'a> {
    text: &'a str,
    span: &'a Range<usize>,
    sample: &'a ProfileSample,
    device: &'a Arc<DeviceProfile>,
    wrong: Vec<TextError>,
}

impl SampleRun<'_> {
    fn report_difference(&mut self, message: impl Display) {
        self.report_at(self.span.clone(), message);
    }

    fn report_at(&mut self, span: Range<usize>, message: impl Display) {
        let about = &self.sample.about;
        let about = if about.is_empty() { String::new() } else { format!("{about}: ") };
        let message = format!("{}: sample: {about}{message}", self.device.full_id);
        self.wrong.push(TextError::at_place(self.text, span, message));
    }

    fn report_value(&mut self, what: impl Display, found: impl Display, expected: impl Display) {
        self.report_difference(format!("{what}: found {found}, expected {expected}"));
    }

    fn check_sample(&mut self) {
        let outcomes = match SampleOutcomes::decode_sample(self.sample, self.device) {
            Ok(outcomes) => outcomes,
            Err(message) => return self.report_difference(message),
        };
        let sample = self.sample;
        if let Some(name) = sample.pdo {
            let pdo = outcomes.find_event(|kind| match kind {
                EventKind::Pdo(pdo) if pdo.name == name => Some(pdo),
                _ => None,
            });
            let what = name.to_string();
            self.check_found(pdo, name, &outcomes, |it, pdo: &DecodedPdo| {
                it.check_values(&what, pdo.layout.as_deref(), pdo.payload());
            });
        } else if let Some(name) = &sample.message {
            let message = outcomes.find_event(|kind| match kind {
                EventKind::J1939Message(message) if self.is_message(message, name) => Some(message),
                _ => None,
            });
            self.check_found(message, name, &outcomes, |it, message: &J1939Message| {
                it.check_values(name, message.layout.as_deref(), message.payload());
            });
        } else if let Some(wanted) = &sample.dtc {
            let named = |dtc: &Dtc| format!("{}/{}", dtc.spn, dtc.fmi) == *wanted;
            let dtc = outcomes.find_event(|kind| match kind {
                EventKind::Dtc(dtc) if named(dtc) => Some(&**dtc),
                _ => None,
            });
            self.check_found(dtc, format!("fault {wanted}"), &outcomes, Self::check_dtc);
        } else if sample.emcy.is_some() {
            let emcy = outcomes.find_event(|kind| match kind {
                EventKind::Emcy(emcy) => Some(emcy),
                _ => None,
            });
            self.check_found(emcy, "an EMCY", &outcomes, Self::check_emcy);
        } else if sample.uds.is_some() || sample.nrc.is_some() {
            let exchange = outcomes.find_event(|kind| match kind {
                EventKind::UdsExchange(exchange) => Some(&**exchange),
                _ => None,
            });
            self.check_found(exchange, "the response to a UDS request", &outcomes, Self::check_exchange);
        } else if sample.object.is_some() || sample.abort.is_some() {
            let transfer = outcomes.find_event(|kind| match kind {
                EventKind::SdoTransfer(transfer) => Some(&**transfer),
                _ => None,
            });
            self.check_found(transfer, "the end of an SDO transfer", &outcomes, Self::check_transfer);
        } else if let Some(state) = &sample.state {
            self.check_state(state, &outcomes);
        } else if let Some(procedure) = &sample.procedure {
            self.check_procedure(procedure, &outcomes);
        } else if let Some(gate) = &sample.gate {
            self.check_gate(gate, &outcomes);
        } else {
            self.report_difference(
                "nothing to compare; expected pdo, message, emcy, dtc, object, abort, uds, nrc, state, procedure or gate",
            );
        }
    }

    fn check_found<T>(
        &mut self,
        it: Option<T>,
        what: impl Display,
        outcomes: &SampleOutcomes,
        compare: impl Fn(&mut Self, T),
    ) {
        match it {
            Some(it) => compare(self, it),
            None => self.report_value("the last frame", outcomes.kind_names(), what),
        }
    }

    /// Whether the profile defines this message under `name`.
    fn is_message(&self, message: &J1939Message, name: &str) -> bool {
        let spec = self.device.messages.iter().find(|spec| spec.name == name);
        spec.is_some_and(|spec| spec.number_of(message.id.pgn).is_some())
    }

    fn check_dtc(&mut self, dtc: &Dtc) {
        let own = self.device.trouble_code_entry(dtc.spn, dtc.fmi).map_or("", |own| own.text.as_str());
        if let Some(wanted) = &self.sample.text {
            self.check_text(own, wanted);
        }
    }

    /// Compares the values of a PDO or message.
    fn check_values(&mut self, what: &str, layout: Option<&PayloadLayout>, payload: &[u8]) {
        let sample = self.sample;
        if sample.signals.is_empty() && sample.texts.is_empty() {
            self.report_difference(format!("no values of {what} to compare; expected signals or texts"));
        }
        let read = |object: &str| -> Result<(Option<Arc<ObjectMeaning>>, DecodedValue), String> {
            let object: ObjectAddress = object.parse().map_err(|error| format!("{object}: {error}"))?;
            let layout = layout.ok_or_else(|| format!("{what} has no layout"))?;
            let mut signals = layout.decode_signals(payload);
            let signal = signals.find(|signal| signal.field.object() == Some(object));
            let signal = signal.ok_or_else(|| format!("{object} is not in {what}"))?;
            Ok((signal.field.meaning.clone(), signal.value))
        };
        for (object, wanted) in &sample.signals {
            match read(object) {
                Ok((meaning, value)) => self.check_quantity(object, meaning.as_deref(), &value, wanted),
                Err(message) => self.report_at(wanted.span(), message),
            }
        }
        for (object, wanted) in &sample.texts {
            match read(object) {
                Ok((meaning, value)) => {
                    let found = value_words(meaning.as_deref(), &value);
                    if found != *wanted {
                        self.report_value(object, quote_text(&found), quote_text(wanted));
                    }
                }
                Err(message) => self.report_difference(message),
            }
        }
    }

    /// Compares a number with a tolerance of half its last written digit.
    fn check_quantity(
        &mut self,
        what: &str,
        meaning: Option<&ObjectMeaning>,
        value: &DecodedValue,
        wanted: &Spanned<f64>,
    ) {
        let written = self.text.get(wanted.span()).unwrap_or_default();
        let behind = written.split_once('.').map_or("", |(_, behind)| behind);
        let digits = behind.bytes().take_while(u8::is_ascii_digit).count();
        let half = 0.5 / 10_f64.powi(i32::try_from(digits).unwrap_or(i32::MAX));
        let wanted_number = *wanted.get_ref();
        let found = value_number(meaning, value);
        // Allows for floating-point rounding errors.
        let slack = half * 1e-6;
        let fits = found.is_some_and(|found| (found - wanted_number).abs() <= half + slack);
        if !fits {
            // No device resolves less than a millionth.
            let shown = |found: f64| ((found * 1e6).round() / 1e6).to_string();
            let found = found.map_or_else(|| quote_text(&value_words(meaning, value)), shown);
            self.report_at(wanted.span(), format!("{what}: found {found}, expected {written}"));
        }
    }

    fn check_emcy(&mut self, emcy: &Emergency) {
        let shown = |code: Option<u16>| code.map_or("none".into(), |code| format!("{code:04X}"));
        if emcy.code != self.sample.emcy {
            self.report_value("code", shown(emcy.code), shown(self.sample.emcy));
        }
        let Some(wanted) = &self.sample.text else { return };
        let code = emcy.code.unwrap_or_default();
        let own = self.device.error_entry(code).map(|error| error.text.as_str());
        self.check_text(own.unwrap_or_else(|| emcy_codes().code_text(u32::from(code))), wanted);
    }

    fn check_text(&mut self, found: &str, wanted: &str) {
        if found != wanted {
            self.report_value("text", quote_text(found), quote_text(wanted));
        }
    }

    fn check_transfer(&mut self, transfer: &SdoTransfer) {
        let sample = self.sample;
        if let Some(code) = sample.abort {
            return self.check_abort(transfer, code);
        }
        if transfer.outcome != SdoOutcome::Complete {
            return self.report_value("the transfer", transfer.outcome.name(), SdoOutcome::Complete.name());
        }
        let wanted = sample.object.as_deref().unwrap_or_default();
        match wanted.parse::<ObjectAddress>() {
            Ok(object) if transfer.object == Some(object) => {}
            Ok(object) => {
                let found = transfer.object.map_or("none".into(), |found| found.to_string());
                return self.report_value("object", found, object);
            }
            Err(error) => return self.report_difference(format!("{wanted}: {error}")),
        }
        if sample.value.is_none() && sample.text.is_none() {
            self.report_difference("no value of the object to compare; expected value or text");
        }
        let meaning = transfer.meaning.as_deref();
        let value = meaning
            .map_or_else(|| DecodedValue::Bytes(transfer.data.clone()), |it| it.decode(&transfer.data));
        if let Some(wanted) = &sample.value {
            self.check_quantity("value", meaning, &value, wanted);
        }
        if let Some(wanted) = &sample.text {
            self.check_text(&value_words(meaning, &value), wanted);
        }
        let unit = meaning.map_or("", |meaning| meaning.unit.as_str());
        match &sample.unit {
            Some(wanted) if wanted != unit => self.report_value("unit", quote_text(unit), quote_text(wanted)),
            _ => {}
        }
    }

    fn check_abort(&mut self, transfer: &SdoTransfer, code: u32) {
        let found = transfer.abort.map(|abort| abort.code);
        if found != Some(code) {
            let found = found.map_or("none".into(), |found| format!("{found:08X}"));
            return self.report_value("abort", found, format!("{code:08X}"));
        }
        if let Some(wanted) = &self.sample.text {
            let own = self.device.abort_entry(code, transfer.object);
            self.check_text(own.map_or("", |own| own.text.as_str()), wanted);
        }
    }

    fn check_state(&mut self, wanted: &str, outcomes: &SampleOutcomes) {
        let sample = self.sample;
        let bus = outcomes.decoder.buses().first();
        let node = bus.and_then(|bus| bus.node(sample.node));
        let mut states = node.into_iter().flat_map(Node::device_states);
        let state = states.find(|(channel, _)| sample.channel.is_none() || *channel == sample.channel);
        match state {
            Some((_, state)) if state.name == wanted => {}
            Some((_, state)) => return self.report_value("state", &state.name, wanted),
            None => return self.report_value("state", "none reported", wanted),
        }
        let Some(wanted) = &sample.cause else { return };
        let is_meant = |state: &DeviceState| sample.channel.is_none() || state.channel == sample.channel;
        let change = outcomes.find_event(|kind| match kind {
            EventKind::DeviceState(state) if is_meant(state) => Some(state),
            _ => None,
        });
        let found = change.map_or("no change", |state| state.cause.name());
        if found != wanted {
            self.report_value("cause", found, wanted);
        }
    }

    fn check_procedure(&mut self, wanted: &str, outcomes: &SampleOutcomes) {
        let mut found = Vec::new();
        for kind in &outcomes.events {
            let EventKind::Procedure(event) = kind else { continue };
            let status = self.sample.status.as_deref();
            let fits =
                status.is_none_or(|status| event.status.name() == status || event.phase.name() == status);
            if event.procedure == wanted && fits {
                return;
            }
            found.push(format!("{} {} {}", event.procedure, event.phase.name(), event.status.name()));
        }
        let found = if found.is_empty() { outcomes.kind_names() } else { found.join(", ") };
        let status = self.sample.status.as_deref().unwrap_or_default();
        self.report_value("procedure", found, format!("{wanted} {status}"));
    }

    fn check_gate(&mut self, wanted: &str, outcomes: &SampleOutcomes) {
        let mut found = Vec::new();
        for kind in &outcomes.events {
            let EventKind::SetPoint(point) = kind else { continue };
            if point.effective == EffectiveState::No && point.gates.iter().any(|gate| gate == wanted) {
                return;
            }
            let gates = point.gates.join(", ");
            found.push(format!("{} effective {} ({gates})", point.signal, point.effective.name()));
        }
        let found = if found.is_empty() { outcomes.kind_names() } else { found.join("; ") };
        self.report_value("gate", found, format!("closed: {wanted}"));
    }
}

fn quote_text(text: &str) -> String {
    format!("'{text}'")
}

/// Value in its unit, or the raw number of an object without a scale.
fn value_number(meaning: Option<&ObjectMeaning>, value: &DecodedValue) -> Option<f64> {
    match meaning.and_then(|meaning| meaning.scale) {
        Some(_) => meaning?.scaled_value(value),
        #[expect(clippy::cast_precision_loss, reason = "compared with numbers that have few digits")]
        None => match value {
            DecodedValue::Real(number) => Some(*number),
            DecodedValue::Unsigned(number) => Some(*number as f64),
            _ => as_integer(value).map(|number| number as f64),
        },
    }
}

/// Name of a value, names of the set bits, or the text itself.
fn value_words(meaning: Option<&ObjectMeaning>, value: &DecodedValue) -> String {
    if let DecodedValue::Text(text) = value {
        return text.clone();
    }
    let Some(meaning) = meaning else { return value.to_string() };
    if let Some(label) = meaning.value_label(value) {
        return label.to_owned();
    }
    let (Some(bits), Some(word)) = (meaning.bits.as_deref(), as_word(value)) else {
        return meaning.format_value(value);
    };
    let named = bits.list.iter().filter(|bit| !bit.reserved);
    let set = named.filter_map(|bit| match (bit.bits_of(word), bit.width) {
        (0, _) => None,
        (_, 1) => Some(bit.name.clone()),
        (number, _) => Some(format!("{} {number}", bit.name)),
    });
    set.collect::<Vec<_>>().join(", ")
}
