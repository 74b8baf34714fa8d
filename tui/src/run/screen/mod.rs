//! Settings of the terminal UI, and options that are added while it runs.

mod reassign;
mod settings;

pub use reassign::reassign;
pub use settings::{ScreenArgs, ScreenSettings, remember_settings};
