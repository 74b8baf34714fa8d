//! Signals: their values at a position, their curves, and their extremes over a range.

mod range;

use serde::Serialize;

use super::numbers::to_seconds;
use crate::escape::escape;
use crate::frame::Timestamp;
use crate::replay::signal::{SignalKey, value_text};
use crate::replay::{SampleBucket, SignalPoints};
use crate::session::Bus;
use crate::statistics::IdentifierRow;
use crate::wire::NodeId;
pub use range::{RangeSample, RangeSignal};

/// The last value of a signal.
#[derive(Debug, Clone, Serialize)]
pub struct SignalState {
    /// Index of the bus.
    pub bus: u8,
    /// Name of the bus, escaped.
    pub bus_name: String,
    /// Place of the field in its message.
    pub field: usize,
    /// Meaning of the identifier, escaped.
    pub from: String,
    /// Identifier.
    pub id: String,
    /// Name of the signal.
    pub name: String,
    /// Node.
    pub node: Option<String>,
    /// Unit.
    pub unit: String,
    /// Value with its unit; null if it is not available.
    pub value: Option<String>,
}

/// A signal over time.
#[derive(Debug, Clone, Serialize)]
pub struct SignalCurve {
    /// No sample stands for several values.
    pub exact: bool,
    /// Last value of each sample; null for a value that is not a number.
    pub last: Vec<Option<f64>>,
    /// Highest value of each sample.
    pub max: Vec<Option<f64>>,
    /// Lowest value of each sample.
    pub min: Vec<Option<f64>>,
    /// Name of the signal.
    pub name: String,
    /// A value is presumed.
    pub presumed: bool,
    /// Seconds from the first frame to each sample.
    pub times: Vec<f64>,
    /// Unit.
    pub unit: String,
}

impl SignalState {
    /// All signals of an identifier.
    pub fn signals_of<'a>(bus: &'a Bus, row: &'a IdentifierRow) -> impl Iterator<Item = Self> + 'a {
        let layouts = row.layout.iter().filter(|_| !row.is_remote);
        layouts.flat_map(move |layout| {
            let keys = SignalKey::signals_of(row.bus, row.id, layout);
            keys.filter_map(move |key| {
                let value = layout.decode_signal(key.field, row.payload());
                let field = layout.fields.get(key.field)?;
                Some(Self {
                    bus: row.bus.0,
                    bus_name: escape(bus.name()).into_owned(),
                    field: key.field,
                    from: escape(&bus.describe_id(row.id)).into_owned(),
                    id: row.id.to_string(),
                    name: key.name,
                    node: row.node.map(NodeId::label),
                    unit: key.unit,
                    value: value.as_ref().map(|value| value_text(layout, field, &value.value)),
                })
            })
        })
    }
}

impl SignalCurve {
    /// The samples of a signal; `zero` is the time of the first frame.
    pub fn new(signal: &SignalKey, points: &SignalPoints, zero: Timestamp) -> Self {
        let column = |value: fn(&SampleBucket) -> f64| {
            let values = points.buckets.iter().map(value);
            values.map(|value| Some(value).filter(|value| value.is_finite())).collect()
        };
        let times = points.buckets.iter().map(|bucket| to_seconds(Timestamp(bucket.t).since(zero)));
        Self {
            exact: points.is_exact,
            last: column(|bucket| bucket.last),
            max: column(|bucket| bucket.max),
            min: column(|bucket| bucket.min),
            name: signal.name.clone(),
            presumed: points.is_assumed,
            times: times.collect(),
            unit: signal.unit.clone(),
        }
    }
}
