//! Captures compared with a filter of all frames, and hostile input.

use proptest::prelude::*;

use super::*;

/// A frame: time since the one before in ms, and for a trigger how many frames earlier its first frame is.
type FrameStep = (i64, Option<u32>);

/// Frames of each capture by a filter of all frames.
fn expected_files(steps: &[FrameStep], before: i64, after: i64) -> Vec<Vec<u32>> {
    let times: Vec<i64> = steps
        .iter()
        .scan(0, |time, (step, _)| {
            *time += step;
            Some(*time)
        })
        .collect();
    let mut windows: Vec<(i64, i64)> = Vec::new();
    for (place, (_, trigger)) in steps.iter().enumerate() {
        let Some(earlier) = trigger else { continue };
        let first = place.saturating_sub(*earlier as usize);
        let (begin, end) = (times[first] - before, times[place] + after);
        let earlier_time = place.checked_sub(1).map_or(0, |place| times[place]);
        match windows.last_mut() {
            Some(last) if begin <= last.1 && earlier_time <= last.1 + before => {
                *last = (last.0.min(begin), last.1.max(end));
            }
            _ => windows.push((begin, end)),
        }
    }
    let within = |&(begin, end): &(i64, i64)| {
        (1..)
            .zip(&times)
            .filter(|(_, time)| (begin..=end).contains(*time))
            .map(|(number, _)| number)
            .collect()
    };
    windows.iter().map(within).collect()
}

/// Frames of each capture as written, in order of the captures.
fn written_files(steps: &[FrameStep], options: CutOptions) -> Vec<Vec<u32>> {
    let mut bench = Bench::new(options);
    let mut time = 0;
    for (step, trigger) in steps {
        time += step;
        if let Some(earlier) = trigger {
            let first = (bench.frames + 1).saturating_sub(*earlier).max(1);
            bench.trigger(time, first);
        }
        bench.frame(time);
    }
    bench.finish();
    let complete = bench.complete();
    complete.iter().map(|cut| bench.file(cut.paths[0].to_str().unwrap())).collect()
}

fn steps(longest: i64, most: usize) -> impl Strategy<Value = Vec<FrameStep>> {
    let trigger = prop_oneof![8 => Just(None), 1 => Just(Some(0)), 1 => (0_u32..20).prop_map(Some)];
    prop::collection::vec((0..longest, trigger), 1..most)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// With causes up to 20 frames earlier, within the reach of the ring.
    #[test]
    fn captures_are_a_filter_of_all_frames(
        steps in steps(300, 150), before in 0_u64..3_000, after in 0_u64..3_000,
    ) {
        let expected = expected_files(&steps, before.cast_signed(), after.cast_signed());
        prop_assert_eq!(written_files(&steps, options(before, after)), expected);
    }

    /// Over hours, while the ring loses its oldest frames.
    #[test]
    fn captures_of_long_runs_are_a_filter_of_all_frames(
        steps in steps(100_000, 150), before in 0_u64..100_000, after in 0_u64..100_000,
    ) {
        let own: Vec<FrameStep> = steps.iter().map(|(step, trigger)| (*step, trigger.map(|_| 0))).collect();
        let expected = expected_files(&own, before.cast_signed(), after.cast_signed());
        prop_assert_eq!(written_files(&own, options(before, after)), expected);
    }

    /// With a ring in memory that is too small, and a cause before it.
    #[test]
    fn captures_from_files_are_a_filter_of_all_frames(
        steps in steps(100_000, 150), before in 0_u64..500_000, after in 0_u64..100_000,
    ) {
        let own: Vec<FrameStep> = steps.iter().map(|(step, trigger)| (*step, trigger.map(|_| 0))).collect();
        let expected = expected_files(&own, before.cast_signed(), after.cast_signed());
        let small = CutOptions { ring_files: Some(1 << 20), ring_bytes: 1, ..options(before, after) };
        prop_assert_eq!(written_files(&own, small), expected);
    }

    /// Clocks that are set, hostile times, notices and triggers in any order.
    #[test]
    fn any_input_gives_files_without_duplicates(
        input in prop::collection::vec((0_u8..8, any_time(), 0_u64..200), 1..200),
        (before, after, ring) in (0_u64..5_000, 0_u64..5_000, any::<bool>()),
    ) {
        let ring_files = ring.then_some(1 << 20);
        let mut bench = Bench::new(CutOptions { ring_files, ring_bytes: 1 << 14, ..options(before, after) });
        for (kind, time, first) in input {
            let time = Timestamp(time);
            match kind {
                0 => bench.take(RecordItem::Notice(Notice::Quiet(time))),
                1 => bench.take(RecordItem::Notice(Notice::ClockSet { bus: BusIndex(0), time, step: time.0 / 2 })),
                2 => bench.take(RecordItem::Trigger(Box::new(CaptureTrigger {
                    bus: String::new(),
                    subject: String::new(),
                    node: None,
                    cause: "any".to_owned(),
                    text: String::new(),
                    time: Some(time),
                    first_frame: first,
                    last_frame: first,
                }))),
                _ => {
                    bench.frames += 1;
                    let frame = Frame::data_frame(CanId::from_standard(0x185), &bench.frames.to_le_bytes());
                    bench.take(RecordItem::Frame(Frame {
                        number: bench.frames.into(),
                        time: Some(time),
                        ..frame
                    }));
                }
            }
        }
        bench.finish();
        for numbers in bench.files() {
            prop_assert!(numbers.is_sorted_by(|one, next| one < next), "{:?}", numbers);
        }
    }
}

/// Times of one minute, or any.
fn any_time() -> impl Strategy<Value = i64> {
    prop_oneof![9 => (0_i64..60_000).prop_map(|milliseconds| at(milliseconds).0), 1 => any::<i64>()]
}
