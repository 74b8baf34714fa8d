//! Several captures on one line of time.

use anyhow::ensure;
use cobscope_decoder::frame::Timestamp;

/// Stamps before this many seconds since 1970 count from the capture's beginning, not from 1970.
const FIRST_EPOCH_SECOND: i64 = 100_000_000;

/// How a capture stands beside the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arranged {
    /// Captures of one group are parts of one recording.
    pub group: usize,
    /// Nanoseconds added to its stamps.
    pub shift: i64,
}

/// Puts captures side by side, by their names and the times of their first frames. With `align` all begin with the one
/// that begins last.
///
/// # Errors
/// When some have dates and some do not.
pub fn arrange(names: &[String], firsts: &[Option<Timestamp>], align: bool) -> anyhow::Result<Vec<Arranged>> {
    let times: Vec<Timestamp> = firsts.iter().flatten().copied().collect();
    let latest = times.iter().copied().max().unwrap_or_default();
    if !align && names.len() > 1 {
        let has_date = |time: &Timestamp| time.0 / 1_000_000_000 >= FIRST_EPOCH_SECOND;
        let dated = times.iter().filter(|time| has_date(time)).count();
        ensure!(
            dated == 0 || dated == firsts.len(),
            "some of these captures have dates and some count from their beginning, so they have no common \
             line of time; open them one by one, or let them begin together with --align"
        );
    }
    let arranged = names.iter().zip(firsts).map(|(name, first)| {
        let stem = recording(name);
        let group = names.iter().position(|other| recording(other) == stem).unwrap_or(0);
        let shift = first.filter(|_| align).map_or(0, |first| latest.since(first));
        Arranged { group, shift }
    });
    Ok(arranged.collect())
}

/// A capture's name without digits: parts of one recording differ in them. The first one may have no number, as in
/// `run.log` and `run-0002.log`.
fn recording(name: &str) -> String {
    let name: String = name.chars().filter(|character| !character.is_ascii_digit()).collect();
    name.replace("-.", ".")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_one_recording_and_clocks_are_not_mixed() {
        let names = ["run.log", "run-0002.log", "other.log"].map(str::to_owned);
        let at = |seconds: i64| Some(Timestamp(seconds * 1_000_000_000));
        let groups = |arranged: Vec<Arranged>| arranged.iter().map(|one| one.group).collect::<Vec<_>>();
        assert_eq!(groups(arrange(&names, &[at(1), at(2), at(3)], false).unwrap()), [0, 0, 2]);
        let shifts = arrange(&names, &[at(1), None, at(3)], true).unwrap();
        assert_eq!(shifts.iter().map(|one| one.shift).collect::<Vec<_>>(), [2_000_000_000, 0, 0]);
        assert!(arrange(&names, &[at(1), at(2), at(1_700_000_000)], false).is_err());
        assert!(arrange(&names[..1], &[None], false).is_ok());
    }

    #[test]
    fn parts_of_a_recording_are_called_alike() {
        let of = |names: &[&str]| names.iter().map(|name| recording(name)).collect::<Vec<_>>();
        assert_eq!(of(&["a/run.log", "a/run-0002.log", "a/run-0013.log"]), ["a/run.log"; 3]);
        let usual = ["candump-2026-11-22_073051.log", "candump-2026-11-22_073051-0002.log"];
        assert_eq!(of(&usual), ["candump---_.log"; 2]);
        assert_ne!(recording("run.log"), recording("run.pcapng"));
        assert_ne!(recording("front.log"), recording("front-left.log"));
    }
}
