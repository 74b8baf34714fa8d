//! What a rule needs of the next PDOs or messages of an identifier.

/// What a rule needs of the next PDOs or messages with an identifier and unchanged data length: their events, if a bound
/// is crossed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Need {
    /// Payload bits: the rule needs the event if one of them changes.
    pub(super) bits: u64,
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
    /// The rule takes the number of PDOs without an event before the next event.
    pub(super) is_counted: bool,
}

impl Need {
    /// No event.
    pub const NOTHING: Self = Self {
        bits: 0,
        shortest: i64::MIN,
        longest: i64::MAX,
        alternations: u32::MAX,
        frames: u32::MAX,
        is_passed: false,
        is_counted: false,
    };

    /// Each event.
    pub const EACH: Self = Self { shortest: i64::MAX, longest: i64::MIN, ..Self::NOTHING };

    /// Each one without an event counts as a check without a defect.
    pub const PASSED: Self = Self { is_passed: true, ..Self::NOTHING };

    /// The rule takes the number of PDOs without an event.
    #[must_use]
    pub const fn counted(self) -> Self {
        Self { is_counted: true, ..self }
    }

    /// Whether each event is needed.
    pub(super) const fn is_each(&self) -> bool {
        self.shortest > self.longest
    }
}
