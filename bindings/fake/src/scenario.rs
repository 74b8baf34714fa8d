//! Items that the simulated adapter plays.

/// Treatment of listen-only mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ListenBehaviour {
    /// It works.
    Obey,
    /// Setting it fails.
    Refuse,
    /// Setting it succeeds without effect.
    Ignore,
    /// It is cancelled when the channel joins the bus.
    Cancel,
}

/// A scenario.
#[derive(Debug, Clone)]
pub(crate) struct Scenario {
    /// Number of frames.
    pub(crate) frames: u64,
    /// Number of frames after which the queue is empty once.
    pub(crate) burst: u64,
    /// Time of the first frame in µs.
    pub(crate) start: u64,
    /// A stuff error before each frame whose number is a multiple of this.
    error_every: Option<u64>,
    /// An overrun before this frame.
    overrun_at: Option<u64>,
    /// Bus off from this frame on.
    pub(crate) bus_off_at: Option<u64>,
    /// Unplugged before this frame.
    pub(crate) unplug_at: Option<u64>,
    /// A message with an impossible length and identifier before this frame.
    invalid_at: Option<u64>,
    /// Treatment of listen-only mode.
    pub(crate) listen: ListenBehaviour,
    /// Another program uses the channel.
    pub(crate) is_in_use: bool,
    /// No adapter is plugged in.
    pub(crate) is_absent: bool,
    /// The number of channels is absurd.
    pub(crate) is_hostile: bool,
    /// The device has no listen-only mode.
    pub(crate) is_light: bool,
}

/// An item of the receive queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum QueueItem {
    /// A frame with its number.
    Frame(u64),
    /// A stuff error before the frame.
    Error(u64),
    /// Frames were lost.
    Overrun,
    /// A message with impossible values.
    Invalid,
    /// Nothing at present.
    Empty,
    /// The adapter is unplugged.
    Unplugged,
}

impl Scenario {
    /// Parses `frames=100000,error_every=1000,listen=refuse,in_use`; unknown words are ignored.
    pub(crate) fn parse(text: &str) -> Self {
        let mut scenario = Self {
            frames: 0,
            burst: 1_000,
            start: 5_000_000,
            error_every: None,
            overrun_at: None,
            bus_off_at: None,
            unplug_at: None,
            invalid_at: None,
            listen: ListenBehaviour::Obey,
            is_in_use: false,
            is_absent: false,
            is_hostile: false,
            is_light: false,
        };
        for word in text.split(',') {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            let number = value.parse::<u64>().ok();
            match key {
                "frames" => scenario.frames = number.unwrap_or(0),
                "burst" => scenario.burst = number.unwrap_or(1),
                "start" => scenario.start = number.unwrap_or(0),
                "error_every" => scenario.error_every = number,
                "overrun_at" => scenario.overrun_at = number,
                "bus_off_at" => scenario.bus_off_at = number,
                "unplug_at" => scenario.unplug_at = number,
                "invalid_at" => scenario.invalid_at = number,
                "in_use" => scenario.is_in_use = true,
                "absent" => scenario.is_absent = true,
                "hostile" => scenario.is_hostile = true,
                "light" => scenario.is_light = true,
                "listen" => {
                    scenario.listen = match value {
                        "refuse" => ListenBehaviour::Refuse,
                        "ignore" => ListenBehaviour::Ignore,
                        "cancel" => ListenBehaviour::Cancel,
                        _ => ListenBehaviour::Obey,
                    }
                }
                _ => {}
            }
        }
        scenario
    }

    /// Item other than a frame that precedes the frame.
    pub(crate) fn special_before(&self, number: u64) -> Option<QueueItem> {
        if self.overrun_at == Some(number) {
            return Some(QueueItem::Overrun);
        }
        if self.invalid_at == Some(number) {
            return Some(QueueItem::Invalid);
        }
        self.error_every
            .filter(|every| number > 0 && number.is_multiple_of(*every))
            .map(|_| QueueItem::Error(number))
    }
}
