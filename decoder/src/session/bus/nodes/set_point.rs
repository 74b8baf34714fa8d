//! Set points of a device: value, quantity and effectiveness.

use std::sync::Arc;

use crate::event::{EffectiveState, Quantity, SetPoint};
use crate::frame::CanId;
use crate::profile::{DecodedValue, ObjectMeaning, ValueCarrier};
use crate::session::bus::time::FrameMoment;
use crate::wire::canopen::ObjectAddress;

/// Set point for which gates are evaluated.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct GatedSetPoint<'a> {
    pub(in crate::session) object: ObjectAddress,
    pub(in crate::session) channel: Option<u8>,
    pub(in crate::session) carrier: &'a ValueCarrier,
    /// Identifier on which its PDO arrives, and a frame with it.
    pub(in crate::session) id: Option<(CanId, u64)>,
    /// No SYNC came after its synchronous PDO.
    pub(in crate::session) late: bool,
    /// Its PDO has less data than the mapping.
    pub(in crate::session) short: Option<ShortPayload>,
}

/// An RPDO with less data than its mapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct ShortPayload {
    /// Bytes received.
    pub(in crate::session) bytes: u8,
    /// Bytes of the mapping.
    pub(in crate::session) needed: u16,
    /// The mapping is a default.
    pub(in crate::session) assumed: bool,
}

/// Result of all gates of a set point.
pub(in crate::session) struct GateVerdict {
    pub(in crate::session) effective: EffectiveState,
    /// Names of the closed gates; if none is closed, of the unknown ones.
    pub(in crate::session) gates: Vec<String>,
    /// Names of the gates without evidence on the bus.
    pub(in crate::session) invisible: Vec<String>,
}

/// State of one set point of a node.
#[derive(Debug, Clone)]
pub(in crate::session) struct SetPointState {
    pub(in crate::session) carrier: ValueCarrier,
    /// Identifier of the last PDO or message with it.
    pub(in crate::session) id: Option<CanId>,
    /// First frame with that identifier since the COB-ID may have changed.
    pub(in crate::session) arrived: u64,
    pub(in crate::session) meaning: Arc<ObjectMeaning>,
    /// Value emitted last, and its quantity.
    pub(in crate::session) reported: Option<(DecodedValue, Quantity)>,
    pub(in crate::session) effective: Option<EffectiveState>,
    pub(in crate::session) gates: Vec<String>,
    /// Value that waits for SYNC, and the time of its reception.
    pub(in crate::session) waiting: Option<(DecodedValue, FrameMoment<()>)>,
    /// Emitted without SYNC, because the SYNC did not arrive in time.
    pub(in crate::session) late: bool,
    /// Emitted from a PDO with less data than its mapping.
    pub(in crate::session) short: Option<ShortPayload>,
    /// The layout of its PDO is a default, or may have changed unnoticed.
    pub(in crate::session) assumed: bool,
}

/// A set point as emitted last.
#[derive(Debug, Clone, Copy)]
pub struct EmittedSetPoint<'a> {
    /// Meaning of the object.
    pub meaning: &'a ObjectMeaning,
    /// PDO or message with the set point.
    pub carrier: &'a ValueCarrier,
    /// Present value.
    pub quantity: &'a Quantity,
    /// Whether the value depends on an assumption.
    pub is_assumed: bool,
    /// Whether it takes effect.
    pub effective: EffectiveState,
    /// Names of the closed gates; if none is closed, of the unknown ones.
    pub gates: &'a [String],
}

impl SetPointState {
    pub(in crate::session) fn gated_subject(&self) -> GatedSetPoint<'_> {
        GatedSetPoint {
            object: self.meaning.object,
            channel: self.meaning.channel,
            carrier: &self.carrier,
            id: self.id.map(|id| (id, self.arrived)),
            late: self.late,
            short: self.short,
        }
    }

    /// Moves a waiting value by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_value(&mut self, delay: i64) {
        if let Some((_, incoming)) = &mut self.waiting {
            incoming.time = incoming.time.saturating_add(delay);
        }
    }

    pub(in crate::session) fn object_title(&self) -> &str {
        &self.meaning.name
    }

    /// Set point as emitted last; `None` before the first event.
    pub(in crate::session) fn emitted_set_point(&self) -> Option<EmittedSetPoint<'_>> {
        let (_, quantity) = self.reported.as_ref()?;
        Some(EmittedSetPoint {
            meaning: &self.meaning,
            carrier: &self.carrier,
            quantity,
            is_assumed: self.assumed || self.meaning.assumed,
            effective: self.effective.unwrap_or(EffectiveState::Unknown),
            gates: &self.gates,
        })
    }
}

impl SetPointState {
    /// Whether a value was already emitted. An equal number may be another quantity in another mode.
    pub(in crate::session) fn is_unchanged(&self, value: &DecodedValue) -> bool {
        self.reported.as_ref().is_some_and(|(reported, quantity)| {
            reported == value && (quantity.number == self.value_quantity(value).number || !self.by_message())
        })
    }

    /// Whether a message carries it; fields of a message may decide how the set point is decoded.
    pub(in crate::session) const fn by_message(&self) -> bool {
        matches!(self.carrier, ValueCarrier::Message(_))
    }

    pub(in crate::session) fn value_quantity(&self, value: &DecodedValue) -> Quantity {
        Quantity {
            number: self.meaning.scaled_value(value).or_else(|| plain_quantity(&self.meaning, value)),
            text: self.meaning.format_signed(value),
        }
    }

    pub(in crate::session) fn set_point_event(
        &self,
        value: &DecodedValue,
        verdict: &GateVerdict,
    ) -> SetPoint {
        SetPoint {
            object: self.meaning.object,
            signal: self.meaning.name.clone(),
            short: self.meaning.short.clone(),
            channel: self.meaning.channel,
            carrier: self.carrier.clone(),
            from: self.reported.as_ref().map(|(_, quantity)| quantity.clone()),
            to: self.value_quantity(value),
            unit: self.meaning.unit.clone(),
            assumed: self.assumed || self.meaning.assumed,
            effective: verdict.effective,
            gates: verdict.gates.clone(),
            invisible: verdict.invisible.clone(),
            sync_after: None,
        }
    }
}

/// Quantity of a number without scale; `None` if the value has a scale or a name.
pub(in crate::session) fn plain_quantity(meaning: &ObjectMeaning, value: &DecodedValue) -> Option<f64> {
    if meaning.scale.is_some() || meaning.value_label(value).is_some() {
        return None;
    }
    #[expect(clippy::cast_precision_loss, reason = "values are for reading; data is the truth")]
    crate::profile::as_integer(value).map(|number| number as f64)
}
