//! Places of fields within a payload.

/// Place of one field. Equal places have equal layouts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct FieldPlace {
    pub(super) line: u16,
    /// Number of the repetition, from 1; 0 outside repetitions.
    pub(super) repetition: u16,
    pub(super) bit: u16,
    pub(super) bits: u16,
    /// Whether a text has two bytes per character.
    pub(super) is_wide: bool,
    pub(super) origin: FieldOrigin,
}

/// Definition of a placed field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum FieldOrigin {
    /// That of the line.
    Line,
    /// That of a key in the table of the key field.
    Key { line: u16, key: u64 },
    /// That of a numbered field of another group.
    Group { number: u32, field: u8 },
}
