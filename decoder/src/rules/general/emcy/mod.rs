//! Rules about EMCY messages.

pub(super) mod emcy_history;
pub(super) mod emcy_missing;
pub(super) mod emcy_raised;
pub(super) mod emcy_register;
pub(super) mod emcy_repeated;
