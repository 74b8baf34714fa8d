//! Names of the parts of a capture: `run.log run-0002.log`, `00000001.MF4`, `xaa xab`, `log.aa log.ab`.

/// Largest number of letters that `split` appends.
const LETTERS: usize = 3;
/// Largest step between two parts that are numbered by letters; `log` and `trc` are not counters.
const LARGEST_STEP: u32 = 26;

/// The name without digits: parts of one capture differ only in digits. The first part may have no number, as
/// in `run.log` and `run-0002.log`.
pub(super) fn name_pattern(name: &str) -> String {
    let name: String = name.chars().filter(|character| !character.is_ascii_digit()).collect();
    name.replace("-.", ".")
}

/// Sort key of a name: parts of a capture are neighbours, in the order of their numbers or letters.
pub(super) fn order_in_series(name: &str) -> (String, Vec<u128>, String) {
    let numbers =
        name.split(|character: char| !character.is_ascii_digit()).filter(|digits| !digits.is_empty());
    // More than 38 digits do not form a counter.
    let numbers = numbers.map(|digits| digits.parse().unwrap_or(u128::MAX)).collect();
    (name_pattern(name), numbers, name.to_owned())
}

/// Whether two names differ only in a counter: in digits, or in the letters of `split`.
pub(super) fn is_numbered_like(one: &str, other: &str) -> bool {
    if one == other {
        return false;
    }
    if name_pattern(one) == name_pattern(other) {
        return true;
    }
    let (one, other) = match (one.rsplit_once('.'), other.rsplit_once('.')) {
        (Some((stem, suffix)), Some((other, same))) if suffix == same => (stem, other),
        _ => (one, other),
    };
    let differs = one.bytes().zip(other.bytes()).position(|(one, other)| one != other);
    let Some(at) = differs.filter(|_| one.len() == other.len()) else { return false };
    match (letters_as_number(one, at), letters_as_number(other, at)) {
        (Some(one), Some(other)) => one.abs_diff(other) <= LARGEST_STEP,
        _ => false,
    }
}

/// The letters from `at` to the end as a number to the base 26, as `split` counts.
fn letters_as_number(name: &str, at: usize) -> Option<u32> {
    let tail = name.as_bytes().get(at..).filter(|tail| tail.len() <= LETTERS)?;
    tail.iter().try_fold(0_u32, |number, letter| {
        let digit = letter.is_ascii_lowercase().then(|| u32::from(letter.saturating_sub(b'a')))?;
        Some(number.saturating_mul(26).saturating_add(digit))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_recording_are_called_alike() {
        let of = |names: &[&str]| names.iter().map(|name| name_pattern(name)).collect::<Vec<_>>();
        assert_eq!(of(&["a/run.log", "a/run-0002.log", "a/run-0013.log"]), ["a/run.log"; 3]);
        let usual = ["candump-2026-11-22_073051.log", "candump-2026-11-22_073051-0002.log"];
        assert_eq!(of(&usual), ["candump---_.log"; 2]);
        assert_ne!(name_pattern("run.log"), name_pattern("run.pcapng"));
        assert_ne!(name_pattern("front.log"), name_pattern("front-left.log"));
    }

    #[test]
    fn counters_are_digits_or_a_few_letters_at_the_end() {
        for (one, other) in [
            ("00000001.MF4", "00000002.MF4"),
            ("run.log", "run-0002.log"),
            ("xaa", "xab"),
            ("log.az", "log.ba"),
            ("part_aa.log", "part_ab.log"),
        ] {
            assert!(is_numbered_like(one, other), "{one} {other}");
        }
        for (one, other) in
            [("front.log", "right.log"), ("run.log", "run.trc"), ("xaa", "xaa"), ("can.log", "can_b.log")]
        {
            assert!(!is_numbered_like(one, other), "{one} {other}");
        }
    }

    #[test]
    fn parts_are_ordered_by_their_numbers() {
        let mut names = ["run-0010.log", "run-0002.log", "run.log", "run-9.log", "other.log"];
        names.sort_by_key(|name| order_in_series(name));
        assert_eq!(names, ["other.log", "run.log", "run-0002.log", "run-9.log", "run-0010.log"]);
    }
}
