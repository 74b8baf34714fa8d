//! Times as text, and the source of the timestamps.

use jiff::tz::TimeZone;

use super::model::CaptureFacts;
use crate::frame::Timestamp;
use crate::statistics::{CaptureQuality, format_span};

/// `2023-11-14 22:13:27.204 UTC`.
pub(super) fn format_date(time: Timestamp) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(time.0)).map_or_else(
        |_| format!("{} s", time.0 / 1_000_000_000),
        |time| time.to_zoned(TimeZone::UTC).strftime("%Y-%m-%d %H:%M:%S.%3f UTC").to_string(),
    )
}

/// Source, zone and steps of the timestamps.
pub(super) fn clock_statements(capture: &CaptureFacts, quality: &CaptureQuality) -> Vec<String> {
    let mut all = Vec::new();
    let stamps = quality.first.zip(quality.last).map(|(first, last)| (Timestamp(first), Timestamp(last)));
    match stamps {
        None => {
            all.push(format!("{}: no timestamps; positions are numbers of frames", capture.format));
            return all;
        }
        Some((first, last)) if first.has_date() => {
            all.push(format!("source: clock of the recorder, as stored in the capture ({})", capture.format));
            all.push(if quality.is_zone_unknown {
                "zone: local time, zone unknown; read as UTC, so all dates may be shifted equally".to_owned()
            } else {
                "zone: UTC".to_owned()
            });
            all.push(format!("first frame {}; last frame {}", format_date(first), format_date(last)));
        }
        Some(_) => {
            all.push(format!("source: clock of the recorder, as stored in the capture ({})", capture.format));
            all.push("zone: none; times count from the start of the capture, the date is unknown".to_owned());
        }
    }
    all.push("seconds on this page count from the first frame".to_owned());
    if let Some(step) = quality.granularity() {
        all.push(format!("timestamps in steps of {}", format_span(step)));
    }
    if !quality.is_timed() {
        all.push("the timestamps are not measured: times and intervals prove nothing".to_owned());
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_have_a_zone() {
        assert_eq!(format_date(Timestamp(1_700_000_007_204_000_000)), "2023-11-14 22:13:27.204 UTC");
    }
}
