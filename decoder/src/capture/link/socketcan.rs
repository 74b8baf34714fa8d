//! The CAN frame in the layout of SocketCAN (linux/can.h) and link type 227.
//!
//! ```text
//! 0 identifier and flags (4)   0x8000_0000 29 bit, 0x4000_0000 remote, 0x2000_0000 error
//! 4 length (1)   5 FD flags (1): 1 bit rate switched, 2 sender error passive, 4 CAN FD
//! 6 reserved (1) 7 DLC if above the length (1, classic only)   8 data
//! ```
//! A frame is CAN FD if its link layer or its flag marks it, if it fills the 72 bytes of the kernel's
//! structure (older recorders never set the flag), or if it is longer than eight bytes.
//!
//! The identifier is big-endian with link type 227, and has the byte order of the capture in cooked packets.
//! Some writers use the wrong order. An identifier that is invalid in the current order and valid in the
//! other one changes the order ([`IdOrder`]): a base identifier with any of the upper eighteen bits set is
//! impossible on a bus.

use std::fmt;

use super::LinkFrameType;
use crate::capture::byte_order::ByteOrder;
use crate::capture::notice::CAN_XL;
use crate::frame::is_fd_length;
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};

const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
const IDENTIFIER: u32 = 0x1FFF_FFFF;
const ABOVE_STANDARD: u32 = 0x1FFF_F800;
/// Bits of an error class that are far above the classes defined in linux/can/error.h.
const ABOVE_CLASSES: u32 = 0x1FFF_0000;

const BIT_RATE_SWITCH: u8 = 0x01;
const ERROR_STATE: u8 = 0x02;
const FD_FRAME: u8 = 0x04;
/// Flag in the length field that marks a CAN XL frame.
const XL_FRAME: u8 = 0x80;

const HEADER: usize = 8;
const MAX_CLASSIC: u8 = 8;
/// Size of the kernel's structure for CAN FD in bytes, with the header.
const FD_SIZE: usize = 72;

/// Byte order of identifiers: as defined for the link type, until a frame shows the other order.
#[derive(Debug, Clone, Copy)]
pub(in crate::capture) struct IdOrder {
    is_little: bool,
    defined_little: bool,
    is_stated: bool,
    is_fixed: bool,
}

impl IdOrder {
    pub(super) fn new(defined: ByteOrder) -> Self {
        let is_little = defined == ByteOrder::Little;
        Self { is_little, defined_little: is_little, is_stated: false, is_fixed: false }
    }

    #[inline]
    fn read_word(self, bytes: [u8; 4]) -> u32 {
        if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) }
    }

    /// The identifier, in the order in which it is valid.
    fn decide_order(&mut self, bytes: [u8; 4]) -> u32 {
        let word = self.read_word(bytes);
        if self.is_fixed || is_plausible(word) || !is_plausible(word.swap_bytes()) {
            return word;
        }
        self.is_little = !self.is_little;
        word.swap_bytes()
    }

    /// The detected order if it differs from the defined one and was not reported yet.
    pub(super) fn detected_order(&mut self) -> Option<&'static str> {
        if self.is_stated || self.is_little == self.defined_little {
            return None;
        }
        self.is_stated = true;
        Some(if self.is_little { "little-endian" } else { "big-endian" })
    }
}

/// Whether the identifier is possible on a bus.
#[inline]
fn is_plausible(word: u32) -> bool {
    if word & ERROR != 0 {
        return word & (EXTENDED | REMOTE | ABOVE_CLASSES) == 0;
    }
    word & EXTENDED != 0 || word & ABOVE_STANDARD == 0
}

/// Fields of a CAN XL frame (linux/can.h, `struct canxl_frame`); link type 227 stores the first word big-endian, the
/// others little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct XlFields {
    /// 11 bits.
    priority: u32,
    /// Virtual CAN network ID.
    network: u32,
    /// SDU type.
    kind: u8,
    /// Acceptance field.
    acceptance: u32,
    /// 1 to 2,048 bytes.
    length: u16,
}

impl XlFields {
    fn parse(packet: &[u8], order: IdOrder) -> Option<Self> {
        let head = order.read_word(*packet.first_chunk()?);
        let little = ByteOrder::Little;
        Some(Self {
            priority: head & 0x7FF,
            network: head >> 16 & 0xFF,
            kind: *packet.get(5)?,
            length: little.u16(packet, 6)?,
            acceptance: little.u32(packet, 8)?,
        })
    }
}

/// Reason why bytes are not a valid frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum InvalidFrame {
    /// Shorter than any frame; contains the size.
    Short(usize),
    /// CAN XL frame, with its fields if all are present.
    Xl(Option<XlFields>),
    /// Length that CAN FD does not have.
    FdLength(u8),
    /// Length above the maximum of the frame type.
    Length { length: u8, limit: u8 },
    /// The recorder stored only a part of the data.
    Cut { has: usize, length: u8 },
    /// Remote frame, undefined in CAN FD.
    RemoteFd,
}

impl fmt::Display for InvalidFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short(found) => write!(f, "CAN frame: found {found} bytes; expected at least {HEADER}"),
            Self::Xl(None) => write!(f, "{CAN_XL}: not supported"),
            Self::Xl(Some(XlFields { priority, network, kind, acceptance, length })) => write!(
                f,
                "{CAN_XL}: not supported (priority {priority:03X}, VCID {network:02X}, SDT {kind:02X}, AF {acceptance:08X}, \
                 {length} bytes)"
            ),
            Self::FdLength(length) => {
                write!(
                    f,
                    "CAN FD frame: found length {length}; expected 0 to 8, 12, 16, 20, 24, 32, 48 or 64"
                )
            }
            Self::Length { length, limit } => {
                write!(f, "CAN frame: found length {length}; expected at most {limit}")
            }
            Self::Cut { has, length } => write!(f, "CAN frame: found {has} of {length} data bytes"),
            Self::RemoteFd => f.write_str("CAN frame: a remote frame cannot be CAN FD"),
        }
    }
}

/// Parses a common frame: classic data of up to eight bytes. `window` begins with the packet of `captured`
/// bytes; the bytes after it are arbitrary. Returns `false` for any other frame; `slot` is then undefined.
///
/// Always copies eight bytes: a branch on the length would cost more.
#[inline]
pub(in crate::capture) fn parse_common(
    window: &[u8; 16],
    captured: u32,
    order: IdOrder,
    slot: &mut Frame,
) -> bool {
    let [head, data] = bytemuck::must_cast_ref(window);
    let head = u64::from_le_bytes(*head);
    let [length, ..] = (head >> 32).to_le_bytes();
    // The lowest four bytes.
    let word = (head & 0xFFFF_FFFF) as u32;
    let word = if order.is_little { word } else { word.swap_bytes() };
    let room = u64::from(captured.wrapping_sub(8));
    // Flags and reserved bytes must be zero, so that the four bytes as one number equal the length.
    let is_usual = word & EXTENDED != 0 || word & ABOVE_STANDARD == 0;
    if room > 8 || head >> 32 > room || word & (REMOTE | ERROR) != 0 || !is_usual {
        return false;
    }
    slot.id = if word & EXTENDED == 0 {
        CanId::from_standard((word & 0x7FF) as u16)
    } else {
        CanId::from_extended(word)
    };
    slot.flags = FrameFlags(0);
    slot.length = length;
    slot.raw_dlc = 0;
    if let Some(target) = slot.bytes.first_chunk_mut::<8>() {
        *target = *data;
    }
    true
}

/// Parses a frame from a CAN socket of this computer: `struct can_frame` or `struct canfd_frame`
/// (linux/can.h).
///
/// # Errors
/// If the bytes are not a valid frame; describes the content found and expected.
pub fn kernel_frame(bytes: &[u8]) -> Result<Frame, String> {
    let own = if cfg!(target_endian = "little") { ByteOrder::Little } else { ByteOrder::Big };
    let mut frame = Frame::EMPTY;
    // The order of this computer is known, so it is fixed.
    let mut order = IdOrder { is_fixed: true, ..IdOrder::new(own) };
    parse_frame(bytes, LinkFrameType::Unsaid, &mut order, &mut frame).map_err(|bad| bad.to_string())?;
    Ok(frame)
}

/// Parses the bytes of a packet of link type 227.
///
/// # Errors
/// If the bytes are not a valid frame; describes the content found and expected.
pub(in crate::capture) fn frame_of_packet(bytes: &[u8]) -> Result<Frame, String> {
    let mut frame = Frame::EMPTY;
    let mut order = IdOrder { is_fixed: true, ..IdOrder::new(ByteOrder::Big) };
    if !bytes.first_chunk().is_some_and(|bytes| is_plausible(u32::from_be_bytes(*bytes))) {
        return Err("identifier: expected 11 bits, or the mark of 29".to_owned());
    }
    parse_frame(bytes, LinkFrameType::Unsaid, &mut order, &mut frame).map_err(|bad| bad.to_string())?;
    Ok(frame)
}

/// Parses any frame: writes identifier, flags, length and data to `slot`.
pub(super) fn parse_frame(
    packet: &[u8],
    kind: LinkFrameType,
    order: &mut IdOrder,
    slot: &mut Frame,
) -> Result<(), InvalidFrame> {
    let Some(&[i0, i1, i2, i3, length, bits, reserved, raw_dlc]) = packet.first_chunk() else {
        return Err(if kind == LinkFrameType::Xl {
            InvalidFrame::Xl(None)
        } else {
            InvalidFrame::Short(packet.len())
        });
    };
    if kind == LinkFrameType::Xl || length & XL_FRAME != 0 {
        return Err(InvalidFrame::Xl(XlFields::parse(packet, *order)));
    }
    let word = order.decide_order([i0, i1, i2, i3]);
    // Old recorders store uninitialised memory here in classic frames, so a single bit is not sufficient.
    let is_marked = bits & FD_FRAME != 0 && bits <= 7 && reserved == 0 && raw_dlc == 0;
    let is_fd = kind == LinkFrameType::Fd || is_marked || packet.len() == FD_SIZE || length > MAX_CLASSIC;
    let mut flags = FrameFlags::default();
    let mut limit = MAX_CLASSIC;
    if word & ERROR != 0 {
        flags = FrameFlags::ERROR;
    } else if word & REMOTE != 0 {
        if is_fd {
            return Err(InvalidFrame::RemoteFd);
        }
        flags = FrameFlags::REMOTE;
    } else if is_fd {
        flags = fd_flags(bits);
        limit = u8::try_from(MAX_DATA).unwrap_or(u8::MAX);
    }
    if length > limit {
        return Err(InvalidFrame::Length { length, limit });
    }
    if flags.contains(FrameFlags::FD) && !is_fd_length(length) {
        return Err(InvalidFrame::FdLength(length));
    }
    let data = packet.get(HEADER..).unwrap_or_default();
    match data.get(..usize::from(length)) {
        _ if flags == FrameFlags::REMOTE => slot.length = length,
        Some(data) => slot.set_data(data),
        None => return Err(InvalidFrame::Cut { has: data.len(), length }),
    }
    slot.id = match word & (EXTENDED | ERROR) {
        0 => CanId::from_standard((word & 0x7FF) as u16),
        _ => CanId::from_extended(word & IDENTIFIER),
    };
    slot.flags = flags;
    let says_more =
        !is_fd && flags != FrameFlags::ERROR && length == MAX_CLASSIC && (9..=15).contains(&raw_dlc);
    slot.raw_dlc = if says_more { raw_dlc } else { 0 };
    Ok(())
}

fn fd_flags(bits: u8) -> FrameFlags {
    let mut flags = FrameFlags::FD;
    if bits & BIT_RATE_SWITCH != 0 {
        flags = flags.with(FrameFlags::BIT_RATE_SWITCH);
    }
    if bits & ERROR_STATE != 0 {
        flags = flags.with(FrameFlags::ERROR_STATE);
    }
    flags
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(packet: &[u8], kind: LinkFrameType) -> Result<String, InvalidFrame> {
        let mut slot = Frame::EMPTY;
        parse_frame(packet, kind, &mut IdOrder::new(ByteOrder::Big), &mut slot).map(|()| format!("{slot:?}"))
    }

    #[test]
    fn frames_of_the_kernel_are_in_the_order_of_this_computer() {
        let mut bytes = [0u8; 16];
        bytes[..4].copy_from_slice(&0x581u32.to_ne_bytes());
        bytes[4..11].copy_from_slice(&[3, 0, 0, 0, 1, 2, 3]);
        assert_eq!(format!("{:?}", kernel_frame(&bytes).unwrap()), "{0} bus0 581#010203 flags=00 dlc=0");
        bytes[..4].copy_from_slice(&0x98FE_F180u32.to_ne_bytes());
        assert_eq!(format!("{:?}", kernel_frame(&bytes).unwrap()), "{0} bus0 18FEF180#010203 flags=00 dlc=0");
        bytes[4] = 9;
        assert!(kernel_frame(&bytes).is_err());
        assert!(kernel_frame(&bytes[..7]).is_err());
        // A structure of 72 bytes is CAN FD: 64 data bytes, bit rate switched.
        let mut long = [0x55u8; 72];
        long[..4].copy_from_slice(&0x123u32.to_ne_bytes());
        long[4..8].copy_from_slice(&[64, 1, 0, 0]);
        let frame = kernel_frame(&long).unwrap();
        assert_eq!((frame.data().len(), frame.flags), (64, FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH)));
    }

    #[test]
    fn classic_frames_of_both_widths() {
        let standard = b"\0\0\x05\x81\x02\0\0\0\xAA\xBB\0\0\0\0\0\0";
        assert_eq!(read(standard, LinkFrameType::Unsaid).unwrap(), "{0} bus0 581#AABB flags=00 dlc=0");
        let extended = b"\x98\xFE\xF1\x80\x01\0\0\0\x7F";
        assert_eq!(read(extended, LinkFrameType::Unsaid).unwrap(), "{0} bus0 18FEF180#7F flags=00 dlc=0");
    }

    #[test]
    fn a_remote_frame_needs_no_data_and_keeps_its_length() {
        assert_eq!(
            read(b"\x40\0\x07\x05\x01\0\0\0", LinkFrameType::Unsaid).unwrap(),
            "{0} bus0 705#R1 flags=01 dlc=0"
        );
    }

    #[test]
    fn an_error_frame_keeps_its_class_as_identifier() {
        let packet = b"\x20\0\0\x04\x08\0\0\x09\0\x10\0\0\0\0\x60\0";
        assert_eq!(
            read(packet, LinkFrameType::Unsaid).unwrap(),
            "{0} bus0 00000004#0010000000006000 flags=02 dlc=0"
        );
    }

    #[test]
    fn the_raw_dlc_counts_on_eight_bytes_only() {
        let eight = b"\0\0\x01\x23\x08\0\0\x0B12345678";
        assert!(read(eight, LinkFrameType::Unsaid).unwrap().ends_with("flags=00 dlc=11"));
        let two = b"\0\0\x01\x23\x02\0\0\x0B12345678";
        assert!(read(two, LinkFrameType::Unsaid).unwrap().ends_with("flags=00 dlc=0"));
    }

    #[test]
    fn can_fd_has_sixteen_lengths() {
        for length in 0..=64_u8 {
            let mut packet = vec![0, 0, 1, 0x23, length, 0x04, 0, 0];
            packet.extend(vec![0; usize::from(length)]);
            let is_read = read(&packet, LinkFrameType::Unsaid).is_ok();
            // ISO 11898-1 table 5.
            let exists = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64].contains(&length);
            assert_eq!(is_read, exists, "{length}");
        }
    }

    #[test]
    fn fields_of_can_xl_are_stated() {
        // Priority 123, VCID 45, SDT 03, 100 bytes, AF 11223344.
        let packet = b"\0\x45\x01\x23\x80\x03\x64\0\x44\x33\x22\x11";
        let expected = "CAN XL frame: not supported (priority 123, VCID 45, SDT 03, AF 11223344, 100 bytes)";
        let text = |packet: &[u8]| read(packet, LinkFrameType::Unsaid).unwrap_err().to_string();
        assert_eq!(text(packet), expected);
        assert_eq!(text(&packet[..11]), "CAN XL frame: not supported");
    }

    #[test]
    fn can_fd_is_known_by_link_layer_flag_size_or_length() {
        let mut packet = vec![0, 0, 1, 0x23, 12, 0x05, 0, 0];
        packet.extend([0xAB; 12]);
        assert!(read(&packet, LinkFrameType::Unsaid).unwrap().ends_with("flags=0C dlc=0"));
        packet[5] = 0x02;
        assert!(read(&packet, LinkFrameType::Fd).unwrap().ends_with("flags=14 dlc=0"));
        packet[5] = 0;
        assert!(
            read(&packet, LinkFrameType::Unsaid).unwrap().ends_with("flags=04 dlc=0"),
            "too long for a classic frame"
        );
        packet[4] = 2;
        assert!(read(&packet, LinkFrameType::Unsaid).unwrap().ends_with("flags=00 dlc=0"));
        packet.resize(FD_SIZE, 0);
        assert!(read(&packet, LinkFrameType::Unsaid).unwrap().ends_with("flags=04 dlc=0"));
    }

    #[test]
    fn leftovers_of_memory_do_not_make_a_frame_can_fd() {
        assert!(
            read(b"\0\0\x01\x23\x01\x3C\x10\x40\x55", LinkFrameType::Unsaid)
                .unwrap()
                .ends_with("#55 flags=00 dlc=0")
        );
    }

    #[test]
    fn what_is_no_frame_says_why() {
        let bad = |packet: &[u8], kind| read(packet, kind).unwrap_err().to_string();
        assert_eq!(bad(b"1234567", LinkFrameType::Unsaid), "CAN frame: found 7 bytes; expected at least 8");
        assert_eq!(
            bad(b"\0\0\x01\x23\x80\0\x0C\0\0\0\0\0xl", LinkFrameType::Unsaid),
            "CAN XL frame: not supported (priority 123, VCID 00, SDT 00, AF 00000000, 12 bytes)"
        );
        assert_eq!(bad(b"", LinkFrameType::Xl), "CAN XL frame: not supported");
        assert_eq!(
            bad(b"\0\0\x01\x23\x08\0\0\x00123", LinkFrameType::Unsaid),
            "CAN frame: found 3 of 8 data bytes"
        );
        assert_eq!(
            bad(b"\0\0\x01\x23\x41\0\0\0", LinkFrameType::Fd),
            "CAN frame: found length 65; expected at most 64"
        );
        assert_eq!(
            bad(b"\x20\0\0\x04\x09\0\0\0", LinkFrameType::Unsaid),
            "CAN frame: found length 9; expected at most 8"
        );
        assert_eq!(
            bad(b"\x40\0\0\x04\x01\0\0\0", LinkFrameType::Fd),
            "CAN frame: a remote frame cannot be CAN FD"
        );
    }

    #[test]
    fn an_impossible_identifier_reverses_the_order_until_another_one() {
        let mut order = IdOrder::new(ByteOrder::Big);
        assert_eq!(order.decide_order([0x01, 0x02, 0, 0]), 0x201);
        assert_eq!(order.detected_order(), Some("little-endian"));
        assert_eq!(order.decide_order([0x80, 0, 0, 0]), 0x080, "would be an extended 0 in the other order");
        assert_eq!(order.decide_order([0, 0, 0x07, 0x10]), 0x710, "proves big-endian again");
        assert_eq!(
            (order.decide_order([5, 7, 0, 0]), order.detected_order()),
            (0x705, None),
            "reported once"
        );
        assert_eq!(order.decide_order([0x01, 0x23, 0x45, 0x17]), 0x1745_2301, "impossible in both: stays");
    }

    #[test]
    fn the_common_path_gives_what_the_general_one_gives() {
        let words =
            [0u32, 0x123, 0x7FF, 0x800, 0x8000_0000, 0x98FE_F180, 0x4000_0701, 0x2000_0004, 0xFFFF_FFFF];
        for word in words {
            for (captured, length, bits) in
                [(16, 8, 0), (8, 0, 0), (11, 3, 0), (10, 3, 0), (16, 9, 0), (16, 2, 4)]
            {
                let mut window = *b"iiiilfrd01234567";
                window[..4].copy_from_slice(&word.to_be_bytes());
                window[4..8].copy_from_slice(&[length, bits, 0, 0]);
                let (mut quick, mut general) = (Frame::EMPTY, Frame::EMPTY);
                if parse_common(&window, captured, IdOrder::new(ByteOrder::Big), &mut quick) {
                    let packet = &window[..captured as usize];
                    parse_frame(
                        packet,
                        LinkFrameType::Unsaid,
                        &mut IdOrder::new(ByteOrder::Big),
                        &mut general,
                    )
                    .unwrap();
                    assert_eq!(quick, general);
                }
            }
        }
        let mut slot = Frame::EMPTY;
        assert!(parse_common(
            b"\0\0\x01\x23\x08\0\0\x0012345678",
            16,
            IdOrder::new(ByteOrder::Big),
            &mut slot
        ));
        assert!(!parse_common(
            b"\0\0\x01\x23\x08\0\0\x0012345678",
            7,
            IdOrder::new(ByteOrder::Big),
            &mut slot
        ));
        assert!(!parse_common(
            b"\0\0\x01\x23\x08\0\0\x0012345678",
            17,
            IdOrder::new(ByteOrder::Big),
            &mut slot
        ));
    }
}
