//! Compares UDS responses with the values of a sample.

use super::{SampleRun, quote_text, value_words};
use crate::event::UdsExchange;
use crate::profile::{DecodedValue, uds_names};

impl SampleRun<'_> {
    pub(super) fn check_exchange(&mut self, exchange: &UdsExchange) {
        let sample = self.sample;
        let shown = |identifier: Option<u16>| identifier.map_or("none".into(), |id| format!("{id:04X}"));
        if sample.uds.is_some() && sample.uds != exchange.identifier {
            return self.report_value("identifier", shown(exchange.identifier), shown(sample.uds));
        }
        if sample.nrc.is_some() || exchange.nrc.is_some() {
            return self.check_negative(exchange);
        }
        if sample.value.is_none() && sample.text.is_none() {
            self.report_difference("no value of the identifier to compare; expected value, text or nrc");
        }
        let meaning = exchange.meaning.as_deref();
        let value = exchange.decoded_value();
        let value =
            value.unwrap_or_else(|| DecodedValue::Bytes(exchange.value().unwrap_or_default().to_vec()));
        if let Some(wanted) = &sample.value {
            self.check_quantity("value", meaning, &value, wanted);
        }
        if let Some(wanted) = &sample.text {
            self.check_text(&value_words(meaning, &value), wanted);
        }
    }

    fn check_negative(&mut self, exchange: &UdsExchange) {
        let shown = |code: Option<u8>| code.map_or("none".into(), |code| format!("{code:02X}"));
        if exchange.nrc != self.sample.nrc {
            return self.report_value("negative response", shown(exchange.nrc), shown(self.sample.nrc));
        }
        let (Some(wanted), Some(code)) = (&self.sample.text, exchange.nrc) else { return };
        let own = self.device.uds.response_code_entry(code, exchange.service, exchange.identifier);
        let standard = uds_names().code_entry(code).map_or("", |code| code.text.as_str());
        let found = own.map_or(standard, |own| own.text.as_str());
        if found != wanted.as_str() {
            self.report_value("text", quote_text(found), quote_text(wanted));
        }
    }
}
