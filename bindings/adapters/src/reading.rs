//! Data of an adapter, in the same types for all vendors.

/// Max number of readings per call of [`read`](crate::ChannelListener::read): a queue that fills faster than it is read must not
/// use unlimited memory.
pub(crate) const MAX_READINGS: usize = 8_192;

/// A classic CAN frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReceivedFrame {
    /// Identifier: up to 0x7FF, or up to `0x1FFF_FFFF` if `is_extended`.
    pub id: u32,
    /// The identifier has 29 bits.
    pub is_extended: bool,
    /// A remote frame, which has a length but no data.
    pub is_remote: bool,
    /// Number of data bytes, 0 to 8.
    pub length: u8,
    /// Data; only the first `length` bytes are valid.
    pub data: [u8; 8],
    /// Time of reception by the clock of the adapter in µs; it continues with 0 after `u32::MAX`.
    pub stamp: u32,
}

/// Kind of a protocol violation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViolationKind {
    /// Bit error.
    Bit,
    /// Form error.
    Form,
    /// Stuff error.
    Stuff,
    /// CRC error.
    Checksum,
    /// Another violation, or kind unknown.
    Other,
}

/// Error counters of the CAN controller in the adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ErrorCounters {
    /// Receive error counter; 255 if above.
    pub receive: u8,
    /// Transmit error counter; 255 if above.
    pub transmit: u8,
}

/// A bus error that the adapter detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusError {
    /// Kind; `None` if only the counters changed.
    pub violation: Option<ViolationKind>,
    /// The adapter was transmitting. In listen-only mode it never is.
    pub is_transmitting: bool,
    /// Position in the frame as segment code of the SJA1000; 0 if unknown.
    pub place: u8,
    /// Error counters after it, if the driver states them.
    pub counters: Option<ErrorCounters>,
    /// Time by the clock of the adapter in µs, as [`ReceivedFrame::stamp`].
    pub stamp: u32,
}

/// An error frame that the adapter reports in the layout of SocketCAN (linux/can/error.h).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AdapterErrorFrame {
    /// Error classes: the identifier without flags.
    pub class: u32,
    /// Data.
    pub data: [u8; 8],
    /// The state of the controller, if the frame reports it.
    pub confinement: Option<FaultConfinement>,
    /// Time by the clock of the adapter in µs, as [`ReceivedFrame::stamp`].
    pub stamp: u32,
}

/// An item from the receive queue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ReceivedItem {
    /// A frame.
    Frame(ReceivedFrame),
    /// A bus error.
    Error(BusError),
    /// An error frame.
    ErrorFrame(AdapterErrorFrame),
    /// The controller or the queue of the driver was read too late: at least one frame is lost.
    Lost,
    /// Data of the driver that cannot be valid: found and expected value.
    Invalid(String),
}

/// Fault confinement state (ISO 11898-1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultConfinement {
    /// Both error counters are below the warning limit.
    Active,
    /// An error counter reached the warning limit.
    Warning,
    /// An error counter is 128 or more.
    Passive,
    /// Bus off.
    BusOff,
}

/// State of the CAN controller in the adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ControllerStatus {
    /// Fault confinement state.
    pub confinement: FaultConfinement,
    /// Error counters, if the driver states them.
    pub counters: Option<ErrorCounters>,
}

/// Identifiers of 11 and of 29 bits.
const MAX_STANDARD: u32 = 0x7FF;
const MAX_EXTENDED: u32 = 0x1FFF_FFFF;

impl ReceivedFrame {
    /// The frame, or a reading that states which value is not valid.
    pub(crate) fn check_frame(self) -> ReceivedItem {
        let max = if self.is_extended { MAX_EXTENDED } else { MAX_STANDARD };
        if self.id > max {
            return ReceivedItem::Invalid(format!(
                "identifier {:X} from the driver; expected 0 to {max:X}",
                self.id
            ));
        }
        if self.length > 8 {
            return ReceivedItem::Invalid(format!("length {} from the driver; expected 0 to 8", self.length));
        }
        ReceivedItem::Frame(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_no_frame_can_have_are_reported() {
        let frame = ReceivedFrame {
            id: 0x7FF,
            is_extended: false,
            is_remote: false,
            length: 8,
            data: [0; 8],
            stamp: 0,
        };
        assert_eq!(frame.check_frame(), ReceivedItem::Frame(frame));
        let extended = ReceivedFrame { id: 0x1FFF_FFFF, is_extended: true, ..frame };
        assert_eq!(extended.check_frame(), ReceivedItem::Frame(extended));
        let invalid = |frame: ReceivedFrame, text: &str| {
            assert_eq!(frame.check_frame(), ReceivedItem::Invalid(text.into()));
        };
        invalid(ReceivedFrame { id: 0x800, ..frame }, "identifier 800 from the driver; expected 0 to 7FF");
        invalid(
            ReceivedFrame { id: 0x2000_0000, ..extended },
            "identifier 20000000 from the driver; expected 0 to 1FFFFFFF",
        );
        invalid(ReceivedFrame { length: 9, ..frame }, "length 9 from the driver; expected 0 to 8");
    }
}
