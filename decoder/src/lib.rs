//! CAN captures to annotated CANopen events.
pub mod capture;
pub mod frame;
pub mod wire;
pub mod profile;
pub mod decoder;
pub mod event;
pub mod session;
