//! Names of the parts of a capture: `run.log run-0002.log`, `00000001.MF4`, `00000003-60FE43B2.MF4`, `xaa xab`,
//! `log.aa log.ab`.

use std::borrow::Cow;

/// Largest number of letters that `split` appends.
const LETTERS: usize = 3;
/// Largest step between two parts that are numbered by letters; `log` and `trc` are not counters.
const LARGEST_STEP: u32 = 26;

/// Number of hex digits of a time in a name: seconds since 1970, as CANedge appends them.
const STAMP_DIGITS: usize = 8;

/// The name with decimal numbers in place of words of eight hex digits, of which one is decimal: `60FE43B2`.
fn without_stamps(name: &str) -> Cow<'_, str> {
    let is_stamp = |word: &str| {
        let has = |test: fn(&u8) -> bool| word.as_bytes().iter().any(test);
        word.len() == STAMP_DIGITS
            && word.bytes().all(|byte| byte.is_ascii_hexdigit())
            && has(u8::is_ascii_digit)
            && has(u8::is_ascii_alphabetic)
    };
    let is_mark = |character: char| !character.is_ascii_alphanumeric();
    if !name.split(is_mark).any(is_stamp) {
        return name.into();
    }
    let decimal = |word: &str| match u32::from_str_radix(word, 16) {
        // Ten digits, so that the names keep their order.
        Ok(number) if is_stamp(word) => format!("{number:010}"),
        _ => word.to_owned(),
    };
    let words = name.split_inclusive(is_mark).map(|piece| {
        let word = piece.trim_end_matches(is_mark);
        format!("{}{}", decimal(word), piece.get(word.len()..).unwrap_or_default())
    });
    words.collect::<String>().into()
}

/// The name without digits: parts of one capture differ only in digits. The first part may have no number, as
/// in `run.log` and `run-0002.log`.
pub(super) fn name_pattern(name: &str) -> String {
    let name = without_stamps(name);
    let name: String = name.chars().filter(|character| !character.is_ascii_digit()).collect();
    name.replace("-.", ".")
}

/// Sort key of a name: parts of a capture are neighbours, in the order of their numbers or letters.
pub(super) fn order_in_series(name: &str) -> (String, Vec<u128>, String) {
    let counted = without_stamps(name);
    let numbers =
        counted.split(|character: char| !character.is_ascii_digit()).filter(|digits| !digits.is_empty());
    // More than 38 digits do not form a counter.
    let numbers = numbers.map(|digits| digits.parse().unwrap_or(u128::MAX)).collect();
    (name_pattern(name), numbers, name.to_owned())
}

/// Minimum number of digits of a counter; shorter numbers are versions, nodes or dates.
const COUNTER_DIGITS: usize = 3;

/// Minimum number of further parts that are worth a note.
const FEWEST_SIBLINGS: usize = 2;

/// Number of `others` that are parts of the same recording by their names; 0 unless one of them is the next or the
/// previous part, or if there are fewer than two.
pub fn count_siblings<'a>(name: &str, others: impl IntoIterator<Item = &'a str>) -> usize {
    let has_counter = without_stamps(name)
        .split(|character: char| !character.is_ascii_digit())
        .any(|digits| digits.len() >= COUNTER_DIGITS);
    if !has_counter {
        return 0;
    }
    let (pattern, numbers, _) = order_in_series(name);
    let (mut count, mut is_consecutive) = (0, false);
    for other in others.into_iter().filter(|other| *other != name) {
        let (other_pattern, other_numbers, _) = order_in_series(other);
        if other_pattern == pattern && other_numbers.len() == numbers.len() {
            count += 1;
            let pairs = || numbers.iter().zip(&other_numbers);
            let first = pairs().find(|(number, other)| number != other);
            is_consecutive |= first.is_some_and(|(number, other)| number.abs_diff(*other) == 1);
        }
    }
    if is_consecutive && count >= FEWEST_SIBLINGS { count } else { 0 }
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
    fn times_in_hex_are_counters() {
        let names = ["00000001-60FE3F04.MF4", "00000002-60FE415D.MF4", "00000010-A0FEB585.MF4"];
        assert_eq!(names.map(name_pattern), ["-.MF4"; 3].map(|_| name_pattern("00000001-12345678.MF4")));
        let mut sorted = names;
        sorted.reverse();
        sorted.sort_by_key(|name| order_in_series(name));
        assert_eq!(sorted, names);
        assert!(is_numbered_like(names[0], names[1]));
        // The later session has a smaller name by its letters, but a larger number.
        assert!(order_in_series("log-9FFFFFFF.csv") < order_in_series("log-A0000000.csv"));
        assert_eq!(name_pattern("deadbeef.log"), "deadbeef.log", "a word without a digit");
        assert_eq!(name_pattern("run-60FE43B.log"), "run-FEB.log", "seven digits");
    }

    #[test]
    fn siblings_are_consecutive_parts() {
        let parts = ["00000001-60FE3F04.MF4", "00000002-60FE415D.MF4", "00000003-60FE43B2.MF4", "notes.txt"];
        assert_eq!(count_siblings(parts[0], parts), 2);
        assert_eq!(count_siblings("00000009-60FE43B2.MF4", parts), 0, "no neighbour");
        assert_eq!(count_siblings("run-001.log", ["run-002.log"]), 0, "a single one");
        assert_eq!(count_siblings("run-1.log", ["run-2.log", "run-3.log"]), 0, "no counter");
        assert_eq!(count_siblings("issue_1256.asc", ["issue_1299.asc", "issue_1905.asc"]), 0);
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
