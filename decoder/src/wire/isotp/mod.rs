//! ISO-TP (ISO 15765-2): messages longer than one frame, over a pair of identifiers.
//!
//! ```text
//! byte 0       bytes 1..
//! 0L           L bytes, 1..=7                            single frame
//! 00 LL        LL bytes, 8 and more (CAN FD only)        single frame, escape
//! 1L LL        size of 12 bits, the first bytes          first frame
//! 10 00        size of 32 bits, the first bytes          first frame, escape
//! 2N           the next bytes; N counts 1..=15, 0, 1 …   consecutive frame
//! 3S BS ST     S: 0 continue, 1 wait, 2 overflow         flow control, from the receiver
//! ```
//!
//! With extended or mixed addressing an address byte precedes byte 0; the caller removes it.

mod address;

pub use address::{AddressScheme, IsoTpAddresses};

use nom::Parser;
use nom::bytes::complete::take;
use nom::combinator::success;
use nom::number::complete::{be_u32, u8 as byte};

use super::MalformedPayload;
use super::parser::{Parsed, bit_field, field_group, parse_message, remaining_bytes};

/// One ISO-TP frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IsoTpFrame<'a> {
    /// A complete message in one frame.
    Single {
        /// The message without padding.
        data: &'a [u8],
    },
    /// First frame of a message.
    First {
        /// Size of the complete message in bytes.
        size: u32,
        /// First bytes of the message.
        data: &'a [u8],
    },
    /// Further bytes of a message.
    Consecutive {
        /// Sequence number 0..=15; 1 in the first consecutive frame.
        sequence: u8,
        /// Next bytes of the message; the last frame may end with padding.
        data: &'a [u8],
    },
    /// Flow control from the receiver.
    FlowControl(FlowControl),
    /// A protocol control byte that the standard does not define, or a reserved size.
    Unknown {
        /// Protocol control byte.
        control: u8,
    },
}

/// Flow control of the receiver (§9.6.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlowControl {
    /// Instruction to the sender.
    pub status: FlowStatus,
    /// Max consecutive frames until the next flow control; 0 = no limit.
    pub block_size: u8,
    /// Min separation time as sent; [`FlowControl::separation_time`] converts it.
    pub separation_time: u8,
}

impl FlowControl {
    /// Min separation of consecutive frames in ns (§9.6.5.4): 0..=127 ms, or F1..=F9 for 100 to 900 µs. A
    /// reserved value is treated as 127 ms.
    pub const fn separation_time(self) -> i64 {
        match self.separation_time {
            milliseconds @ 0..=0x7F => milliseconds as i64 * 1_000_000,
            tenths @ 0xF1..=0xF9 => (tenths & 0x0F) as i64 * 100_000,
            _ => 127_000_000,
        }
    }
}

/// Instruction of the receiver to the sender (§9.6.5.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlowStatus {
    /// Send the next consecutive frames.
    Continue,
    /// Wait for another flow control.
    Wait,
    /// The message is too long for the receiver; the receiver rejects it.
    Overflow,
}

/// Max frame length of classical CAN; in longer frames byte 1 is the size of a single frame.
const CLASSICAL: usize = 8;

/// Reads one frame. `data` starts with the protocol control byte; `length` is the length of the whole
/// frame, including an address before the control byte.
///
/// # Errors
/// If the frame is shorter than its control bytes, or shorter than the message of a single frame.
pub fn parse(data: &[u8], length: usize) -> Result<IsoTpFrame<'_>, MalformedPayload> {
    parse_message("isotp", data, |data| parse_frame(data, length > CLASSICAL))
}

fn parse_frame(data: &[u8], is_fd: bool) -> Parsed<'_, IsoTpFrame<'_>> {
    let (rest, control) = byte(data)?;
    match bit_field(control, 4, 4) {
        0_u8 => parse_single(control, rest, is_fd),
        1 => parse_first(control, rest),
        2 => {
            let sequence = bit_field(control, 0, 4);
            remaining_bytes.map(|data| IsoTpFrame::Consecutive { sequence, data }).parse(rest)
        }
        3 => flow_control(control, rest),
        _ => Ok((rest, IsoTpFrame::Unknown { control })),
    }
}

fn parse_single(control: u8, rest: &[u8], is_fd: bool) -> Parsed<'_, IsoTpFrame<'_>> {
    // §9.6.2.1: in a frame of more than eight bytes the size is in byte 1, otherwise in byte 0.
    let (rest, size) = match (is_fd, control) {
        (false, size) => (rest, size),
        (true, 0) => byte.or(success(0)).parse(rest)?,
        (true, _) => (rest, 0),
    };
    if size == 0 {
        return Ok((rest, IsoTpFrame::Unknown { control }));
    }
    field_group(take(size)).map(|data| IsoTpFrame::Single { data }).parse(rest)
}

fn parse_first(control: u8, rest: &[u8]) -> Parsed<'_, IsoTpFrame<'_>> {
    let (rest, low) = byte(rest)?;
    // §9.6.3.1: 0 means that a 32-bit size follows.
    let (rest, size) = match u16::from_be_bytes([bit_field(control, 0, 4), low]) {
        0 => field_group(be_u32).parse(rest)?,
        size => (rest, u32::from(size)),
    };
    let (rest, data) = remaining_bytes(rest)?;
    // A message that fits into one frame is never sent in two (§9.6.3.1).
    if usize::try_from(size).is_ok_and(|size| size <= data.len()) {
        return Ok((rest, IsoTpFrame::Unknown { control }));
    }
    Ok((rest, IsoTpFrame::First { size, data }))
}

fn flow_control(control: u8, rest: &[u8]) -> Parsed<'_, IsoTpFrame<'_>> {
    let status = match bit_field(control, 0, 4) {
        0_u8 => FlowStatus::Continue,
        1 => FlowStatus::Wait,
        2 => FlowStatus::Overflow,
        _ => return Ok((rest, IsoTpFrame::Unknown { control })),
    };
    field_group((byte, byte))
        .map(|(block_size, separation_time)| {
            IsoTpFrame::FlowControl(FlowControl { status, block_size, separation_time })
        })
        .parse(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(data: &[u8]) -> Result<IsoTpFrame<'_>, MalformedPayload> {
        parse(data, data.len())
    }

    #[test]
    fn a_single_frame_leaves_its_padding_out() {
        // ISO 15765-2 §9.6.2: 03 is a single frame of three bytes.
        let data = [0x03, 0x22, 0xF1, 0x90, 0xCC, 0xCC, 0xCC, 0xCC];
        assert_eq!(read(&data), Ok(IsoTpFrame::Single { data: &[0x22, 0xF1, 0x90] }));
        let error = read(&[0x03, 0x22, 0xF1]).unwrap_err();
        assert_eq!((error.layer, error.offset, error.needed, error.available), ("isotp", 1, 3, 2));
        // Size 0, and sizes above 7 in a frame of eight bytes.
        assert_eq!(read(&[0x00, 1, 2]), Ok(IsoTpFrame::Unknown { control: 0 }));
        assert_eq!(read(&[0x08, 1, 2, 3, 4, 5, 6, 7]).unwrap_err().needed, 8);
        assert_eq!(read(&[]).unwrap_err().needed, 1);
    }

    #[test]
    fn a_single_frame_of_can_fd_says_its_size_in_the_second_byte() {
        let mut data = [0xCC; 12];
        data[0] = 0;
        data[1] = 9;
        assert_eq!(read(&data), Ok(IsoTpFrame::Single { data: &[0xCC; 9] }));
        data[1] = 11;
        let error = read(&data).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (2, 11, 10));
        data[1] = 0;
        assert_eq!(read(&data), Ok(IsoTpFrame::Unknown { control: 0 }));
        data[0] = 5;
        assert_eq!(read(&data), Ok(IsoTpFrame::Unknown { control: 5 }));
        // Eight bytes after an address form a frame of nine.
        assert_eq!(parse(&[0, 1, 2, 3, 4, 5, 6, 7], 9), Ok(IsoTpFrame::Single { data: &[2] }));
    }

    #[test]
    fn a_first_frame_has_one_of_two_sizes() {
        let data = [0x10, 0x14, 0x62, 0xF1, 0x90, 0x57, 0x30, 0x4C];
        assert_eq!(
            read(&data),
            Ok(IsoTpFrame::First { size: 20, data: &[0x62, 0xF1, 0x90, 0x57, 0x30, 0x4C] })
        );
        assert_eq!(
            read(&[0x1F, 0xFF, 1, 2, 3, 4, 5, 6]),
            Ok(IsoTpFrame::First { size: 4095, data: &[1, 2, 3, 4, 5, 6] })
        );
        assert_eq!(
            read(&[0x10, 0x00, 0x00, 0x01, 0x00, 0x00, 0xAA, 0xBB]),
            Ok(IsoTpFrame::First { size: 65_536, data: &[0xAA, 0xBB] })
        );
        assert_eq!(
            read(&[0x10, 0x00, 0xFF, 0xFF, 0xFF, 0xFF, 0xAA, 0xBB]),
            Ok(IsoTpFrame::First { size: u32::MAX, data: &[0xAA, 0xBB] })
        );
    }

    #[test]
    fn a_first_frame_that_is_too_short_or_needless() {
        let error = read(&[0x10, 0x00, 1, 2]).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (2, 4, 2));
        assert_eq!(read(&[0x10]).unwrap_err().offset, 1);
        assert_eq!(read(&[0x10, 0x20]).unwrap_err().offset, 2);
        assert_eq!(read(&[0x10, 6, 1, 2, 3, 4, 5, 6]), Ok(IsoTpFrame::Unknown { control: 0x10 }));
    }

    #[test]
    fn consecutive_frames_count_from_0_to_15() {
        assert_eq!(read(&[0x21, 1, 2]), Ok(IsoTpFrame::Consecutive { sequence: 1, data: &[1, 2] }));
        assert_eq!(read(&[0x20, 1]), Ok(IsoTpFrame::Consecutive { sequence: 0, data: &[1] }));
        assert_eq!(read(&[0x2F]).unwrap_err().offset, 1);
    }

    #[test]
    fn flow_control_and_its_pause() {
        let Ok(IsoTpFrame::FlowControl(control)) = read(&[0x30, 0x08, 0x14, 0, 0, 0, 0, 0]) else {
            panic!("expected flow control")
        };
        assert_eq!((control.status, control.block_size), (FlowStatus::Continue, 8));
        // §9.6.5.4: 0x14 is 20 ms, 0xF3 is 300 µs, 0x80 is reserved and treated as 127 ms.
        assert_eq!(control.separation_time(), 20_000_000);
        assert_eq!(FlowControl { separation_time: 0xF3, ..control }.separation_time(), 300_000);
        assert_eq!(FlowControl { separation_time: 0x80, ..control }.separation_time(), 127_000_000);
        for (byte, status) in [(0x31, FlowStatus::Wait), (0x32, FlowStatus::Overflow)] {
            let expected = FlowControl { status, block_size: 0, separation_time: 0 };
            assert_eq!(read(&[byte, 0, 0]), Ok(IsoTpFrame::FlowControl(expected)));
        }
        assert_eq!(read(&[0x33, 0, 0]), Ok(IsoTpFrame::Unknown { control: 0x33 }));
        let error = read(&[0x30, 0]).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (1, 2, 1));
        assert_eq!(read(&[0x42, 0]), Ok(IsoTpFrame::Unknown { control: 0x42 }));
    }
}
