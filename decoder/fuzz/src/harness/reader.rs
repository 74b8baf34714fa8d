//! Readers: the contract of `capture::Parser`, and independence of the sizes of the pieces received.

use cobscope_decoder::capture::{
    Batch, CaptureFormat, FORMATS, FormatParser, MAX_BUSES, Notice, ReadOptions,
};
use cobscope_decoder::frame::{Frame, FrameFlags, MAX_DATA};

/// Complete output of a parser.
#[derive(Debug, Default, PartialEq)]
pub struct Content {
    /// Frames in order.
    pub frames: Vec<Frame>,
    /// Notices, each with the number of frames before it.
    pub notices: Vec<(usize, Notice)>,
    /// Names of the buses.
    pub buses: Vec<String>,
    /// Error that ended it early, if any.
    pub error: Option<String>,
}

/// The format with this name.
pub fn format(name: &str) -> &'static CaptureFormat {
    FORMATS.iter().find(|format| format.name == name).unwrap()
}

/// Parses `data` at once and in pieces, and checks both against the contract and against each other.
pub fn holds_its_contract(name: &str, data: &[u8]) {
    let format = format(name);
    // Detection must not panic, with any result.
    let _ = (format.detect)(data);
    let whole = parse(&mut *(format.parser)(&ReadOptions::default()), data, || usize::MAX);
    let mut random = Random::new(data);
    let pieces = parse(&mut *(format.parser)(&ReadOptions::default()), data, || random.up_to(97));
    assert_eq!(whole, pieces, "in one piece and in several");
}

/// Passes `data` to a parser, with the next `piece` bytes added at each request for more input.
pub fn parse(parser: &mut dyn FormatParser, data: &[u8], mut piece: impl FnMut() -> usize) -> Content {
    let mut content = Content::default();
    let mut batch = Batch::new();
    let (mut start, mut end, mut at_end) = (0, 0, false);
    loop {
        let input = &data[start..end];
        batch.clear();
        let taken = match parser.parse(input, at_end, &mut batch) {
            Ok(taken) => taken,
            Err(error) => {
                add(&mut content, &batch);
                content.error = Some(error.to_string());
                break;
            }
        };
        assert!(taken <= input.len(), "used {taken} of {}", input.len());
        if batch.is_empty() && !input.is_empty() && (at_end || input.len() >= parser.largest_input()) {
            assert!(taken > 0, "used none of {} bytes, end: {at_end}", input.len());
        }
        add(&mut content, &batch);
        start += taken;
        if taken == 0 && batch.is_empty() {
            if at_end {
                break;
            }
            at_end = end == data.len();
            end = end.saturating_add(piece().max(1)).min(data.len());
        }
    }
    content.buses = parser.buses().names().to_vec();
    check(&content);
    content
}

fn add(content: &mut Content, batch: &Batch) {
    let before = content.frames.len();
    content.notices.extend(batch.notices().iter().map(|(at, notice)| (before + at, notice.clone())));
    content.frames.extend_from_slice(batch.frames());
}

fn check(content: &Content) {
    assert!(content.buses.len() <= MAX_BUSES);
    assert!(content.notices.is_sorted_by_key(|(at, _)| *at));
    for (index, frame) in content.frames.iter().enumerate() {
        assert_eq!(frame.number, index as u64 + 1, "frame numbers rise by one");
        assert!(usize::from(frame.bus.0) < content.buses.len(), "{frame:?} on a bus without a name");
        assert!(usize::from(frame.length) <= MAX_DATA);
        assert!(frame.length <= 8 || frame.flags.contains(FrameFlags::FD), "{frame:?} is not FD");
        assert!(matches!(frame.raw_dlc, 0 | 9..=15), "{frame:?}");
    }
}

/// Pseudo-random numbers that depend on the input only, so that failures are reproducible.
pub struct Random(u64);

impl Random {
    /// Creates a generator seeded by `data`.
    pub fn new(data: &[u8]) -> Self {
        let seed = data.iter().fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3)
        });
        Self(seed | 1)
    }

    /// A number in 1..=`most`.
    pub fn up_to(&mut self, most: u64) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 % most).unwrap() + 1
    }
}
