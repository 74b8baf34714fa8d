//! Combines equal consecutive objects to one repeated object.

use crate::profile::entry::ObjectEntry;
use crate::profile::object::{EntryRepetition, ONCE};

/// Max numbers in a name that are tried as repeat number.
const MOST_NUMBERS: usize = 4;

/// Combines equal objects with consecutive indexes. The closure returns all properties of an object but its
/// index; a number in their names that increases with the index becomes `{n}`.
pub(super) fn combine_objects(
    objects: &[ObjectEntry],
    says: impl Fn(&ObjectEntry) -> String,
) -> Vec<ObjectEntry> {
    let mut all = Vec::new();
    let mut rest = objects;
    while let Some(first) = rest.first() {
        let (count, found) = longest_run(rest, &says);
        all.push(found.unwrap_or_else(|| first.clone()));
        rest = rest.get(count..).unwrap_or_default();
    }
    all
}

/// Number of objects at the start that can be combined, and the combined object.
fn longest_run(
    objects: &[ObjectEntry],
    says: &impl Fn(&ObjectEntry) -> String,
) -> (usize, Option<ObjectEntry>) {
    let Some(first) = objects.first() else { return (0, None) };
    let mut best = (run_length(objects, says, |object, _| object.clone()), None);
    for number in numbers_in(&first.name) {
        let length = run_length(objects, says, |object, nth| set_number(object, number.saturating_add(nth)));
        if length > best.0 {
            best = (length, Some(number));
        }
    }
    let (length, number) = best;
    let Ok(count @ 2..) = u16::try_from(length) else { return (1, None) };
    let object = number.map_or_else(|| first.clone(), |number| set_number(first, number));
    let repeat = EntryRepetition { count, stride: 1, first: number.unwrap_or(ONCE.first), ..ONCE };
    (length, Some(ObjectEntry { repeat, ..object }))
}

/// Number of objects at the start that are equal after conversion with `as_nth`.
fn run_length(
    objects: &[ObjectEntry],
    says: &impl Fn(&ObjectEntry) -> String,
    as_nth: impl Fn(&ObjectEntry, u16) -> ObjectEntry,
) -> usize {
    let Some(first) = objects.first() else { return 0 };
    let wanted = says(&as_nth(first, 0));
    let follows = |(nth, object): &(u16, &ObjectEntry)| {
        object.index.checked_sub(first.index) == Some(*nth) && says(&as_nth(object, *nth)) == wanted
    };
    (0..).zip(objects).take_while(follows).count()
}

/// Decimal numbers in a name that can be a repeat number.
fn numbers_in(name: &str) -> Vec<u16> {
    let digits = name.split(|c: char| !c.is_ascii_digit());
    let counting = digits.filter(|digits| !digits.starts_with('0')).filter_map(|digits| digits.parse().ok());
    counting.take(MOST_NUMBERS).collect()
}

/// Copy of the object with a number in its names replaced by `{n}`.
fn set_number(object: &ObjectEntry, number: u16) -> ObjectEntry {
    let mut object = object.clone();
    object.name = replace_number(&object.name, number);
    for entry in &mut object.entries {
        if let Some(name) = &mut entry.look.name {
            *name = replace_number(name, number);
        }
    }
    object
}

/// Replaces whole numbers only, not the 1 in 12.
fn replace_number(name: &str, number: u16) -> String {
    let number = number.to_string();
    let mut text = String::new();
    let mut rest = name;
    while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
        let (before, digits) = rest.split_at(at);
        let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        let (digits, behind) = digits.split_at(end);
        text.push_str(before);
        text.push_str(if digits == number { "{n}" } else { digits });
        rest = behind;
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::device::ProfileFile;

    fn together_of(names: &[(u16, &str)]) -> Vec<(u16, String, EntryRepetition)> {
        let object = |(index, name): &(u16, &str)| {
            format!("[[object]]\nindex = {index}\nname = \"{name}\"\ntype = \"UNSIGNED8\"\n")
        };
        let file = ProfileFile::parse(&names.iter().map(object).collect::<String>()).unwrap();
        let all = combine_objects(file.objects(), |object| object.name.clone());
        all.into_iter().map(|object| (object.index, object.name, object.repeat)).collect()
    }

    fn repeat(count: u16, first: u16) -> EntryRepetition {
        EntryRepetition { count, stride: u16::from(count > 1), first, channel: false }
    }

    #[test]
    fn equal_objects_in_a_row_are_one() {
        let found = together_of(&[(1, "a"), (2, "a"), (3, "b"), (5, "b"), (6, "b")]);
        let expected = [(1, "a", repeat(2, 1)), (3, "b", repeat(1, 1)), (5, "b", repeat(2, 1))];
        assert_eq!(found, expected.map(|(index, name, repeat)| (index, name.to_owned(), repeat)));
    }

    #[test]
    fn a_number_that_counts_is_the_number_of_the_repeat() {
        let found = together_of(&[(1, "RPDO 9 of 10"), (2, "RPDO 10 of 10"), (3, "RPDO 11 of 10")]);
        // The second name contains 10 twice, so its repeat number is ambiguous.
        assert_eq!(found[0], (1, "RPDO 9 of 10".to_owned(), repeat(1, 1)));
        let found = together_of(&[(1, "Input 3 of 8"), (2, "Input 4 of 8"), (3, "Input 6 of 8")]);
        assert_eq!(found[0], (1, "Input {n} of 8".to_owned(), repeat(2, 3)));
        assert_eq!(found[1].1, "Input 6 of 8");
        assert_eq!(replace_number("12 of 1, 1", 1), "12 of {n}, {n}");
    }
}
