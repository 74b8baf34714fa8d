//! What a rule needs of the next PDOs or messages of an identifier.

/// What a rule needs of the next PDOs or messages with an identifier and unchanged data length: their events, if a bound
/// is crossed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameNeed {
    /// Payload bits: the rule needs the event if one of them changes.
    pub(super) bits: u64,
    /// Of a message, the rule needs the event if a changed payload has one of these codes.
    pub(super) codes: ErrorCodes,
    /// The rule needs the event after a shorter interval, in ns.
    pub(super) shortest: i64,
    /// The rule needs the event after a longer interval, in ns; shorter than `shortest` if it needs each event.
    pub(super) longest: i64,
    /// The rule needs the event if so many PDOs have fitted two producers in turn.
    pub(super) alternations: u32,
    /// The rule needs the event of this PDO, counted from the next one.
    pub(super) frames: u32,
    /// Each PDO without an event counts as a check without a defect.
    pub(super) is_passed: bool,
    /// Each message without an event and with changed payload counts as a check without a defect.
    pub(super) is_passed_if_changed: bool,
    /// The rule takes the number of PDOs without an event before the next event.
    pub(super) is_counted: bool,
    /// The answer depends on the usual interval of the PDO, and holds until it is determined again.
    pub(super) follows_interval: bool,
}

impl FrameNeed {
    /// No event.
    pub const NOTHING: Self = Self {
        bits: 0,
        codes: ErrorCodes { bytes: 0, pairs: 0 },
        shortest: i64::MIN,
        longest: i64::MAX,
        alternations: u32::MAX,
        frames: u32::MAX,
        is_passed: false,
        is_passed_if_changed: false,
        is_counted: false,
        follows_interval: false,
    };

    /// Each event.
    pub const EACH: Self = Self { shortest: i64::MAX, longest: i64::MIN, ..Self::NOTHING };

    /// Each one without an event counts as a check without a defect.
    pub const PASSED: Self = Self { is_passed: true, ..Self::NOTHING };

    /// The rule takes the number of PDOs without an event.
    #[must_use]
    pub const fn with_count(self) -> Self {
        Self { is_counted: true, ..self }
    }

    /// Whether each event is needed.
    pub(super) const fn is_each(&self) -> bool {
        self.shortest > self.longest
    }
}

/// Fields of a payload that may have an error indicator (SAE J1939-71 §5.1.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ErrorCodes {
    /// Bits of the most significant bytes of parameters with whole bytes: FEh is an error.
    bytes: u64,
    /// Upper bits of parameters of two bits: 10b is an error.
    pairs: u64,
}

impl ErrorCodes {
    /// Adds a parameter, little-endian from bit `bit`; `false` for one with another form.
    #[must_use]
    pub fn add_parameter(&mut self, bit: u16, bits: u16) -> bool {
        let end = bit.saturating_add(bits);
        if end > 64 {
            return false;
        }
        if bits == 2 {
            self.pairs |= 1 << (end - 1);
        } else if bits >= 8 && bits.is_multiple_of(8) && bit.is_multiple_of(8) {
            self.bytes |= 0xFF << (end - 8);
        } else {
            return false;
        }
        true
    }

    /// Codes of both.
    #[must_use]
    pub(super) const fn union_with(self, other: Self) -> Self {
        Self { bytes: self.bytes | other.bytes, pairs: self.pairs | other.pairs }
    }

    /// Whether a payload has one of the codes.
    #[inline]
    pub(super) fn are_in(self, payload: u64) -> bool {
        // A byte is zero if it is FEh, or if it is not one of `bytes` and thus all ones otherwise.
        let bytes = (payload ^ 0xFEFE_FEFE_FEFE_FEFE) | !self.bytes;
        let zeros = bytes.wrapping_sub(0x0101_0101_0101_0101) & !bytes & 0x8080_8080_8080_8080;
        zeros != 0 || payload & self.pairs & !(payload << 1) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_indicators_by_size() {
        let mut codes = ErrorCodes::default();
        // A byte at bit 8, 16 bits at bit 16, two bits at bit 4.
        assert!(
            [(8, 8), (16, 16), (4, 2)]
                .map(|(bit, bits)| codes.add_parameter(bit, bits))
                .iter()
                .all(|added| *added)
        );
        assert!(!codes.add_parameter(4, 8) && !codes.add_parameter(40, 4) && !codes.add_parameter(60, 8));
        let payloads = [0x00FD_FE00_u64, 0xFEFF_FF00, 0x0000_0020, 0x00FE_FD00];
        assert_eq!(payloads.map(|payload| codes.are_in(payload)), [true, true, true, false]);
        // FFh, 11b and 01b are no errors; nor is FEh in a byte without a parameter.
        assert_eq!([0xFFFF_FF30_u64, 0x0000_0010, 0x0000_00FE << 32].map(|it| codes.are_in(it)), [false; 3]);
        assert!(!ErrorCodes::default().are_in(0xFEFE_FEFE_FEFE_FEFE));
    }
}
