//! CAN captures to annotated CANopen events.
pub mod capture;
pub mod frame;
pub mod wire;
pub mod profile;
