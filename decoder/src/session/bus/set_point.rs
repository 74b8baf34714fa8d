//! Set points of a device: value, quantity, and whether they act.

use std::sync::Arc;

use super::moment::Moment;
use crate::event::{Effective, Quantity, SetPoint};
use crate::profile::{Carrier, Meaning, Value};
use crate::wire::canopen::ObjectAddress;

/// A set point as gates see it.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct Subject<'a> {
    pub(in crate::session) object: ObjectAddress,
    pub(in crate::session) channel: Option<u8>,
    pub(in crate::session) carrier: &'a Carrier,
}

/// One set point of a node.
#[derive(Debug, Clone)]
pub(in crate::session) struct SetPointState {
    pub(in crate::session) carrier: Carrier,
    pub(in crate::session) meaning: Arc<Meaning>,
    /// Value that was told last, and the quantity it was.
    pub(in crate::session) told: Option<(Value, Quantity)>,
    pub(in crate::session) effective: Option<Effective>,
    pub(in crate::session) gates: Vec<String>,
    /// Value that waits for SYNC, and when it came.
    pub(in crate::session) waiting: Option<(Value, Moment<()>)>,
    /// It was told before its SYNC, which did not come in time.
    pub(in crate::session) late: bool,
    /// The layout of its PDO is a default, or may have changed unseen.
    pub(in crate::session) assumed: bool,
}

/// A set point as it was told last.
#[derive(Debug, Clone, Copy)]
pub struct StandingPoint<'a> {
    /// What it is.
    pub meaning: &'a Meaning,
    /// PDO or message it came by.
    pub carrier: &'a Carrier,
    /// Its value.
    pub quantity: &'a Quantity,
    /// Rests on an assumption.
    pub is_assumed: bool,
    /// Whether it acts.
    pub effective: Effective,
    /// Names of the gates that are closed, or of those nothing is known of.
    pub gates: &'a [String],
}

impl SetPointState {
    pub(in crate::session) fn subject(&self) -> Subject<'_> {
        Subject { object: self.meaning.object, channel: self.meaning.channel, carrier: &self.carrier }
    }

    /// All traffic stopped for so long: the time does not count.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        if let Some((_, came)) = &mut self.waiting {
            came.time = came.time.saturating_add(delay);
        }
    }

    pub(in crate::session) fn title(&self) -> &str {
        &self.meaning.name
    }

    /// As it was told last.
    pub(in crate::session) fn standing(&self) -> Option<StandingPoint<'_>> {
        let (_, quantity) = self.told.as_ref()?;
        Some(StandingPoint {
            meaning: &self.meaning,
            carrier: &self.carrier,
            quantity,
            is_assumed: self.assumed || self.meaning.assumed,
            effective: self.effective.unwrap_or(Effective::Unknown),
            gates: &self.gates,
        })
    }
}

impl SetPointState {
    /// Whether a value says nothing new: the same number may be another quantity under another mode.
    pub(in crate::session) fn is_told(&self, value: &Value) -> bool {
        self.told.as_ref().is_some_and(|(told, quantity)| {
            told == value && (quantity.number == self.quantity(value).number || !self.by_message())
        })
    }

    /// A message may decide itself how its set points are read.
    pub(in crate::session) const fn by_message(&self) -> bool {
        matches!(self.carrier, Carrier::Message(_))
    }

    pub(in crate::session) fn quantity(&self, value: &Value) -> Quantity {
        Quantity {
            number: self.meaning.scaled(value).or_else(|| plain(&self.meaning, value)),
            text: self.meaning.signed(value),
        }
    }

    pub(in crate::session) fn event(
        &self,
        value: &Value,
        effective: Effective,
        gates: &[String],
    ) -> SetPoint {
        SetPoint {
            object: self.meaning.object,
            signal: self.meaning.name.clone(),
            short: self.meaning.short.clone(),
            channel: self.meaning.channel,
            carrier: self.carrier.clone(),
            from: self.told.as_ref().map(|(_, quantity)| quantity.clone()),
            to: self.quantity(value),
            unit: self.meaning.unit.clone(),
            assumed: self.assumed || self.meaning.assumed,
            effective,
            gates: gates.to_vec(),
            sync_after: None,
        }
    }
}

/// A number without scale is its own quantity, unless it has a name.
pub(in crate::session) fn plain(meaning: &Meaning, value: &Value) -> Option<f64> {
    if meaning.scale.is_some() || meaning.label(value).is_some() {
        return None;
    }
    #[expect(clippy::cast_precision_loss, reason = "values are for reading; data is the truth")]
    crate::profile::integer(value).map(|number| number as f64)
}
