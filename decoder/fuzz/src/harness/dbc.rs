//! DBC reader and its JSON variant: every problem must have a line of the file, every signal must be within
//! its message, a byte order mark must not change the result, and with any payload each signal must be
//! present, missing or not selected.

use cobscope_decoder::profile::dbc::{
    Database, DatabaseFile, DatabaseMessage, LONGEST_MESSAGE, MOST_MESSAGES, MOST_PROBLEMS, MOST_RANGES,
    MOST_SIGNALS, parse_database,
};

/// Fuzzes the DBC reader.
pub fn dbc(data: &[u8]) {
    let file = parse_database(data);
    if let Ok(text) = std::str::from_utf8(data)
        && !text.starts_with('\u{FEFF}')
    {
        let marked = parse_database(&[b"\xEF\xBB\xBF", data].concat());
        assert_eq!(file, marked, "with and without byte order mark");
    }
    let lines = data.iter().filter(|byte| matches!(byte, b'\n' | b'\r')).count() + 1;
    let problems = match &file {
        Ok(file) => file.problems.as_slice(),
        Err(problem) => std::slice::from_ref(problem),
    };
    assert!(problems.len() <= MOST_PROBLEMS + 1);
    for problem in problems {
        assert!(problem.line <= lines, "{problem:?} of {lines} lines");
        assert!(!problem.reason.is_empty() && !problem.reason.contains(char::is_control), "{problem:?}");
    }
    if let Ok(file) = file {
        content(file, data);
    }
}

fn content(file: DatabaseFile, data: &[u8]) {
    assert!(file.len() <= MOST_MESSAGES);
    let ids: Vec<_> = file.messages().filter_map(|(id, _)| id).collect();
    for (_, known) in file.messages() {
        message(known, data);
    }
    let mut database = Database::default();
    let is_empty = file.is_empty();
    database.add_file(file);
    assert_eq!(database.is_empty(), is_empty);
    assert!(ids.iter().all(|id| database.message_by_id(*id).is_some()));
}

fn message(message: &DatabaseMessage, data: &[u8]) {
    let layout = &*message.layout;
    let length = message.length.unwrap_or(u16::MAX / 8);
    assert!(layout.fields.len() <= MOST_SIGNALS && message.length.is_none_or(|it| it <= LONGEST_MESSAGE));
    for field in &layout.fields {
        assert!((1..=64).contains(&field.bits) && field.end().unwrap() <= layout.bits, "{field:?}");
        if let Some(selector) = &field.present {
            assert!(
                selector.field < layout.fields.len() && selector.values.len() <= MOST_RANGES,
                "{field:?}"
            );
        }
    }
    assert!(layout.bits <= length * 8);
    let whole = vec![0x5A; usize::from(length)];
    assert_eq!(layout.missing_fields(&whole).count(), 0);
    for payload in [&whole[..], data.get(..64).unwrap_or(data), &[]] {
        let seen = layout.decode_signals(payload).count() + layout.missing_fields(payload).count();
        assert!(seen <= layout.fields.len());
        for signal in layout.decode_signals(payload) {
            let meaning = signal.field.meaning.as_deref().unwrap();
            assert!(!meaning.format_value(&signal.value).is_empty());
            assert!(signal.field.bits == 64 || signal.raw < 1 << signal.field.bits);
        }
    }
}
