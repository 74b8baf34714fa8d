//! Deviation of measured values from set points that the device acts on.
//!
//! ```text
//! set point ──────┐ held ≥ 0.5 s ┌────── the last measured value before the change gives one deviation
//! measured  ───╱‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾
//! ```

use std::collections::BTreeMap;

use crate::event::{DecodedPdo, EffectiveState, SetPoint};
use crate::wire::canopen::ObjectAddress;

/// Minimum time in ns for which a set point must be held.
const HELD: i64 = 500_000_000;

/// Maximum number of set points per node.
const MOST_TARGETS: usize = 256;

/// Set points of one node with their measured values.
#[derive(Debug, Clone, Default)]
pub(super) struct SetPointFollowing {
    targets: BTreeMap<ObjectAddress, PresentSetPoint>,
}

/// Present set point, and the last deviation from it.
#[derive(Debug, Clone, Default)]
struct PresentSetPoint {
    value: Option<f64>,
    since: i64,
    /// Deviation and its time.
    last: Option<(f64, i64)>,
}

impl PresentSetPoint {
    /// Deviation after the set point was held.
    fn settled_deviation(&self) -> Option<f64> {
        self.last.filter(|(_, time)| time.saturating_sub(self.since) >= HELD).map(|(deviation, _)| deviation)
    }
}

impl SetPointFollowing {
    /// Takes a set point at a time in ns; returns the deviation from the previous one.
    pub(super) fn set_point(&mut self, point: &SetPoint, time: i64) -> Option<f64> {
        if self.targets.len() >= MOST_TARGETS && !self.targets.contains_key(&point.object) {
            return None;
        }
        let target = self.targets.entry(point.object).or_default();
        let settled = target.settled_deviation();
        let value = point.to.number.filter(|_| point.effective == EffectiveState::Yes);
        *target = PresentSetPoint { value, since: time, last: None };
        settled
    }

    /// Takes the measured values of a TPDO; returns whether it has any.
    pub(super) fn on_measured(&mut self, pdo: &DecodedPdo, time: i64) -> bool {
        let Some(layout) = &pdo.layout else { return false };
        let mut has_any = false;
        for field in &layout.fields {
            let Some((meaning, of)) =
                field.meaning.as_deref().and_then(|meaning| Some((meaning, meaning.of?)))
            else {
                continue;
            };
            has_any = true;
            let Some(target) = self.targets.get_mut(&of) else { continue };
            let actual = field
                .extract_bits(pdo.payload())
                .and_then(|raw| meaning.scaled_value(&field.convert_raw(raw)));
            if let (Some(value), Some(actual)) = (target.value, actual) {
                target.last = Some(((actual - value).abs(), time));
            }
        }
        has_any
    }

    /// Deviations from the present set points, at the end of the capture.
    pub(super) fn settled_deviations(&self) -> impl Iterator<Item = (ObjectAddress, f64)> {
        self.targets.iter().filter_map(|(object, target)| Some((*object, target.settled_deviation()?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(value: f64) -> PresentSetPoint {
        PresentSetPoint { value: Some(value), since: 1_000, last: None }
    }

    #[test]
    fn a_set_point_counts_after_it_was_held() {
        let short = PresentSetPoint { last: Some((4.0, 1_000 + HELD - 1)), ..target(50.0) };
        let held = PresentSetPoint { last: Some((1.5, 1_000 + HELD)), ..target(50.0) };
        assert_eq!(
            (target(50.0).settled_deviation(), short.settled_deviation(), held.settled_deviation()),
            (None, None, Some(1.5))
        );
        let object = ObjectAddress::new(0x6300, 1);
        let following = SetPointFollowing { targets: BTreeMap::from([(object, held)]) };
        assert_eq!(following.settled_deviations().collect::<Vec<_>>(), [(object, 1.5)]);
    }
}
