//! Samples of signals over time: lowest, highest and last value per interval.
//!
//! ```text
//! mark ──decode──▶ │ from │▂▂│▃▅│▅▅│▂ │ … │ to │      a few more buckets than a screen can show
//!   └ value before the range
//! ```
//!
//! Without a known end the buckets start short and double whenever there are too many.

use std::sync::Arc;

use super::signal::{SignalKey, carried_layout, is_assumed};
use super::{PlacedEvent, ReplayState};
use crate::frame::{BusIndex, CanId};
use crate::profile::PayloadLayout;

/// Maximum number of buckets per signal.
pub const MOST_BUCKETS: i64 = 4_096;

/// Initial length of a bucket if the end is unknown, in ns.
const FIRST_WIDTH: i64 = 10_000;

/// Values of a time interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleBucket {
    /// Start, in ns.
    pub t: i64,
    /// Lowest value.
    pub min: f64,
    /// Highest value.
    pub max: f64,
    /// Last value; it applies until the next bucket.
    pub last: f64,
}

impl SampleBucket {
    /// Lowest and highest value; None if all are NaN.
    pub fn bounds(&self) -> Option<(f64, f64)> {
        // `min` and `max` ignore a NaN.
        let (low, high) = (self.min.min(self.max).min(self.last), self.max.max(self.min).max(self.last));
        (!low.is_nan()).then_some((low, high))
    }
}

/// Samples of one signal so far.
#[derive(Clone)]
pub struct SignalPoints {
    /// Values in time order; the first one may precede the range.
    pub buckets: Arc<Vec<SampleBucket>>,
    /// Length of a bucket, in ns.
    pub width: i64,
    /// No bucket contains more than one value.
    pub is_exact: bool,
    /// At least one value is presumed.
    pub is_assumed: bool,
}

/// Signals while they are sampled over a range of times.
pub struct SignalSampler {
    tracks: Vec<SampledSignal>,
    /// One bit per identifier modulo 64, to skip most other events.
    identifiers: u64,
}

impl SignalSampler {
    /// Samples from `from` to `to`, in ns; without `to` up to the end of the capture.
    pub fn new(signals: &[SignalKey], from: i64, to: Option<i64>) -> Self {
        let identifiers = signals.iter().fold(0, |bits, signal| bits | identifier_bit(signal.id));
        let track = |signal: &SignalKey| SampledSignal {
            signal: signal.clone(),
            layout: None,
            place: None,
            buckets: SignalBuckets::new(from, to),
            is_assumed: false,
        };
        Self { tracks: signals.iter().map(track).collect(), identifiers }
    }

    /// Takes the values of an event.
    #[inline]
    pub fn take_event(&mut self, reported: &PlacedEvent<'_>) {
        let Some((id, layout, payload)) = carried_layout(reported.event) else { return };
        if self.identifiers & identifier_bit(id) == 0 {
            return;
        }
        if let Some(time) = reported.event.time {
            self.take_payload(reported.event.bus, id, layout, payload, time.0);
        }
    }

    /// Takes the last values of each identifier.
    pub fn take_world(&mut self, world: &ReplayState) {
        for row in world.identifiers().rows().iter().filter(|row| !row.is_remote) {
            if let (Some(layout), Some(time)) = (&row.layout, row.last_time) {
                self.take_payload(row.bus, row.id, layout, row.payload(), time.0);
            }
        }
    }

    fn take_payload(
        &mut self,
        bus: BusIndex,
        id: CanId,
        layout: &Arc<PayloadLayout>,
        payload: &[u8],
        time: i64,
    ) {
        for track in &mut self.tracks {
            if track.signal.id == id && track.signal.bus == bus {
                track.take_payload(layout, payload, time);
            }
        }
    }

    /// Samples of each signal so far, in the order of the signals.
    pub fn sampled_points(&self) -> Vec<SignalPoints> {
        self.tracks.iter().map(SampledSignal::signal_points).collect()
    }
}

fn identifier_bit(id: CanId) -> u64 {
    1 << (id.number() % 64)
}

/// One signal while it is sampled.
struct SampledSignal {
    signal: SignalKey,
    /// The current layout, and the index of the signal in it.
    layout: Option<Arc<PayloadLayout>>,
    place: Option<usize>,
    buckets: SignalBuckets,
    is_assumed: bool,
}

impl SampledSignal {
    fn take_payload(&mut self, layout: &Arc<PayloadLayout>, payload: &[u8], time: i64) {
        if !self.layout.as_ref().is_some_and(|known| Arc::ptr_eq(known, layout)) {
            let found = self.signal.field_in(layout);
            self.is_assumed |= found.is_some_and(|(_, field)| is_assumed(layout, field));
            self.place = found.map(|(place, _)| place);
            self.layout = Some(Arc::clone(layout));
        }
        // The identifier no longer carries the signal: the line ends.
        let Some(place) = self.place else { return self.buckets.add_value(time, f64::NAN) };
        // In another branch of a multiplexed message the previous value still applies.
        if let Some(signal) = layout.decode_signal(place, payload) {
            self.buckets.add_value(time, signal.field.plot_number(&signal.value).unwrap_or(f64::NAN));
        }
    }

    fn signal_points(&self) -> SignalPoints {
        let SignalBuckets { before, slots, width, is_exact, .. } = &self.buckets;
        let buckets = before.iter().chain(slots.iter().flatten()).copied().collect();
        SignalPoints {
            buckets: Arc::new(buckets),
            width: *width,
            is_exact: *is_exact,
            is_assumed: self.is_assumed,
        }
    }
}

/// Buckets of one signal.
struct SignalBuckets {
    from: i64,
    to: Option<i64>,
    width: i64,
    /// The last value before the range.
    before: Option<SampleBucket>,
    slots: Vec<Option<SampleBucket>>,
    is_exact: bool,
}

impl SignalBuckets {
    fn new(from: i64, to: Option<i64>) -> Self {
        let width = to.map_or(FIRST_WIDTH, |to| to.saturating_sub(from) / MOST_BUCKETS + 1);
        Self { from, to, width: width.max(1), before: None, slots: Vec::new(), is_exact: true }
    }

    fn add_value(&mut self, time: i64, value: f64) {
        let new = SampleBucket { t: time, min: value, max: value, last: value };
        if time < self.from {
            self.before = Some(new);
            return;
        }
        if self.to.is_some_and(|to| time > to) {
            return;
        }
        let since = time.saturating_sub(self.from);
        while since / self.width >= MOST_BUCKETS {
            self.merge_pairs();
        }
        let Ok(place) = usize::try_from(since / self.width) else { return };
        if self.slots.len() <= place {
            self.slots.resize(place + 1, None);
        }
        if let Some(slot) = self.slots.get_mut(place) {
            self.is_exact &= slot.is_none();
            *slot = merge_buckets(*slot, Some(new));
        }
    }

    fn merge_pairs(&mut self) {
        self.width = self.width.saturating_mul(2);
        let mut is_exact = self.is_exact;
        let pair = |pair: &[Option<SampleBucket>]| {
            let (first, second) = (pair.first().copied().flatten(), pair.get(1).copied().flatten());
            is_exact &= first.is_none() || second.is_none();
            merge_buckets(first, second)
        };
        self.slots = self.slots.chunks(2).map(pair).collect();
        self.is_exact = is_exact;
    }
}

/// Merges two buckets; NaN does not affect minimum and maximum.
fn merge_buckets(first: Option<SampleBucket>, second: Option<SampleBucket>) -> Option<SampleBucket> {
    match (first, second) {
        (Some(first), Some(second)) => Some(SampleBucket {
            t: first.t.min(second.t),
            min: first.min.min(second.min),
            max: first.max.max(second.max),
            last: second.last,
        }),
        (first, second) => first.or(second),
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::{DataType, ObjectMeaning, RawConversion, SignalField};
    use crate::wire::canopen::ObjectAddress;

    use super::*;

    fn kept(buckets: &SignalBuckets) -> Vec<SampleBucket> {
        buckets.slots.iter().flatten().copied().collect()
    }

    #[test]
    fn without_an_end_pieces_become_longer_and_nothing_is_lost() {
        let mut buckets = SignalBuckets::new(0, None);
        for millisecond in 0..10_000 {
            let value = if millisecond == 5_003 { -7.0 } else { f64::from(millisecond % 10) };
            buckets.add_value(i64::from(millisecond) * 1_000_000, value);
        }
        // 10 s in at most 4,096 buckets: 2.56 ms, which is 10 µs doubled eight times.
        assert_eq!((buckets.width, buckets.is_exact), (2_560_000, false));
        let kept = kept(&buckets);
        assert!((2_048..=4_096).contains(&kept.len()));
        assert_eq!(kept.iter().map(|bucket| bucket.min).reduce(f64::min), Some(-7.0));
        assert_eq!(kept.iter().map(|bucket| bucket.max).reduce(f64::max), Some(9.0));
        // 0, 1 and 2 ms.
        assert_eq!(kept.first(), Some(&SampleBucket { t: 0, min: 0.0, max: 2.0, last: 2.0 }));
    }

    #[test]
    fn before_a_range_only_the_last_value_counts_and_behind_it_none() {
        let mut buckets = SignalBuckets::new(100, Some(200));
        for (time, value) in [(10, 1.0), (90, 2.0), (100, 3.0), (200, 4.0), (201, 5.0)] {
            buckets.add_value(time, value);
        }
        assert_eq!(buckets.before.map(|bucket| bucket.last), Some(2.0));
        assert_eq!(kept(&buckets).iter().map(|bucket| bucket.last).collect::<Vec<_>>(), [3.0, 4.0]);
        assert!(buckets.is_exact);
    }

    /// A layout of one-byte fields by object, unit and factor.
    fn layout(fields: &[(u16, &str, f64)]) -> Arc<PayloadLayout> {
        let field = |(at, (index, unit, factor)): (u16, &(u16, &str, f64))| {
            let scale =
                Some(RawConversion { factor: *factor, offset: 0.0, full_scale: None, is_reciprocal: false });
            let object = ObjectAddress::new(*index, 0);
            let meaning = ObjectMeaning { unit: (*unit).into(), scale, ..ObjectMeaning::default() };
            let field = SignalField::of_object(object, at * 8, 8, DataType::Unsigned8);
            SignalField { meaning: Some(Arc::new(meaning)), ..field }
        };
        Arc::new(PayloadLayout { fields: (0..).zip(fields).map(field).collect(), ..PayloadLayout::default() })
    }

    #[test]
    fn a_signal_is_found_in_each_layout_by_what_it_is() {
        let first = layout(&[(0x6000, "bar", 1.0), (0x6001, "%", 0.5)]);
        let signal = SignalKey::new(BusIndex(0), CanId::from_standard(0x181), &first, 0).unwrap();
        let rescaled = layout(&[(0x6001, "%", 0.5), (0x6000, "bar", 2.0)]);
        let of_mode = layout(&[(0x6000, "l/min", 0.1), (0x6001, "%", 0.5)]);
        let without = layout(&[(0x6001, "%", 0.5)]);
        let mut sampler = SignalSampler::new(std::slice::from_ref(&signal), 0, None);
        // The last payload is too short for the field, so the previous value still applies.
        let payloads: [(&Arc<PayloadLayout>, &[u8]); 6] = [
            (&first, &[10, 20]),
            (&rescaled, &[20, 10]),
            (&of_mode, &[10, 20]),
            (&rescaled, &[20, 11]),
            (&without, &[20]),
            (&first, &[]),
        ];
        for (second, (layout, payload)) in (0..).zip(payloads) {
            sampler.take_payload(BusIndex(0), signal.id, layout, payload, second * 1_000_000_000);
        }
        // Values of other signals are ignored.
        sampler.take_payload(BusIndex(1), signal.id, &first, &[99, 99], 9_000_000_000);
        let points = sampler.sampled_points().remove(0);
        let values: Vec<_> = points.buckets.iter().map(|bucket| bucket.last).collect();
        assert_eq!(format!("{values:?}"), "[10.0, 20.0, NaN, 22.0, NaN]");
        assert_eq!(SignalKey::new(signal.bus, signal.id, &rescaled, 1).as_ref(), Some(&signal));
        assert_ne!(SignalKey::new(signal.bus, signal.id, &of_mode, 0).unwrap(), signal);
    }

    #[test]
    fn what_is_no_number_ends_the_line_and_has_no_part_in_the_range() {
        let mut buckets = SignalBuckets::new(0, Some(4_095 * 10));
        for (time, value) in [(0, 1.0), (1, f64::NAN), (2, 3.0), (100, f64::NAN)] {
            buckets.add_value(time, value);
        }
        let kept = kept(&buckets);
        assert_eq!(kept.first(), Some(&SampleBucket { t: 0, min: 1.0, max: 3.0, last: 3.0 }));
        assert!(kept.get(1).is_some_and(|bucket| bucket.last.is_nan()));
    }
}
