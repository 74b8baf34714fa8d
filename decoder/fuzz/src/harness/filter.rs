//! Filters: any text must be accepted, or rejected with a position. An accepted filter must have the same
//! result when it is printed and parsed again, put in brackets, or negated twice.

use cobscope_decoder::capture::{Batch, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::query::Filter;
use cobscope_decoder::session::{Bus, SessionOptions};

/// Captures to filter, of several protocols.
const CAPTURES: [&str; 2] = [
    include_str!("../../../../fixtures/j1939/mixed.log"),
    include_str!("../../../../fixtures/canopen/pdo_mapping.log"),
];

/// Fuzzes a filter.
pub fn filter(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let filter = match text.parse::<Filter>() {
        Ok(filter) => filter,
        Err(error) => {
            assert!(!error.reason().is_empty() && text.get(error.at()).is_some(), "{:?}", error.at());
            let printed = error.to_string();
            assert!(!printed.chars().any(|letter| letter.is_control() && letter != '\n'), "{printed:?}");
            return;
        }
    };
    // Variants that exceed the maximum length or depth are ignored.
    let printed = filter.to_string();
    let others = [printed.clone(), format!("({printed})"), format!("!(!({printed}))")];
    let others: Vec<Filter> = others.iter().filter_map(|text| text.parse().ok()).collect();
    each_event(|event, bus| {
        let matches = filter.matches_event(event, bus, Some("a.log"));
        assert!(!matches || filter.kinds().contains(&event.kind), "{printed}: {event:?}");
        for other in &others {
            assert_eq!(
                other.matches_event(event, bus, Some("a.log")),
                matches,
                "{printed} | {other}: {event:?}"
            );
        }
    });
}

fn each_event(mut see: impl FnMut(&Event, &Bus)) {
    for capture in CAPTURES {
        let mut reader = CaptureReader::open(capture.as_bytes(), &ReadOptions::default()).unwrap();
        let mut decoder = Decoder::new(SessionOptions::default());
        let mut batch = Batch::new();
        while reader.read(&mut batch).unwrap() {
            for frame in batch.frames() {
                decoder.push(frame, reader.buses(), &mut see);
            }
        }
        decoder.finish_capture(reader.buses(), &mut see);
    }
}
