//! Table `[diff]`: tolerances for the comparison of two captures.

use std::collections::BTreeMap;

use toml::Spanned;

use super::written::TextProblem;

/// Tolerances of a comparison. Percentages refer to the smaller of two values.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct DiffTolerances {
    /// Median of periods, in percent.
    pub period: f64,
    /// 99th percentile of the intervals of a periodic message, in percent.
    pub gap: f64,
    /// Longest interval of a periodic message, in percent.
    pub longest_gap: f64,
    /// Median and 99th percentile of latencies and reaction times, in percent.
    pub latency: f64,
    /// Rates of counted events, in percent.
    pub count: f64,
    /// Bus load, in percent.
    pub load: f64,
    /// Smallest and largest value of a set point, in percent of its range.
    pub set_point: f64,
    /// Differences of times that are never reported, in ms.
    pub time_ms: f64,
}

impl Default for DiffTolerances {
    fn default() -> Self {
        Self {
            period: 5.0,
            gap: 20.0,
            longest_gap: 100.0,
            latency: 100.0,
            count: 100.0,
            load: 20.0,
            set_point: 20.0,
            time_ms: 5.0,
        }
    }
}

/// Keys of the table, in the order of [`DiffTolerances`].
const KEYS: &str = "period-percent, gap-percent, longest-gap-percent, latency-percent, count-percent, \
                    load-percent, set-point-percent or time-ms";

/// Table as parsed.
pub(super) type Table = BTreeMap<Spanned<String>, Spanned<f64>>;

/// Checks the table; returns the first problem.
pub(super) fn check_tolerances(table: Table) -> Result<DiffTolerances, TextProblem> {
    let mut tolerances = DiffTolerances::default();
    for (key, value) in table {
        let place = match key.get_ref().as_str() {
            "period-percent" => &mut tolerances.period,
            "gap-percent" => &mut tolerances.gap,
            "longest-gap-percent" => &mut tolerances.longest_gap,
            "latency-percent" => &mut tolerances.latency,
            "count-percent" => &mut tolerances.count,
            "load-percent" => &mut tolerances.load,
            "set-point-percent" => &mut tolerances.set_point,
            "time-ms" => &mut tolerances.time_ms,
            other => return Err((key.span(), format!("unknown tolerance {other}; expected {KEYS}"))),
        };
        let number = *value.get_ref();
        if !number.is_finite() || number < 0.0 {
            return Err((value.span(), "invalid tolerance; expected a number ≥ 0".into()));
        }
        *place = number;
    }
    Ok(tolerances)
}

#[cfg(test)]
mod tests {
    use super::super::BusFile;

    #[test]
    fn the_table_overrides_single_tolerances() {
        let file = BusFile::parse("[diff]\nperiod-percent = 1\ntime-ms = 0.5\n").unwrap();
        assert_eq!((file.diff.period, file.diff.time_ms, file.diff.gap), (1.0, 0.5, 20.0));
        for wrong in ["[diff]\nperiod = 1\n", "[diff]\ngap-percent = -1\n", "[diff]\ngap-percent = nan\n"] {
            BusFile::parse(wrong).unwrap_err();
        }
    }
}
