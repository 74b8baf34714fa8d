//! CAN captures to annotated CANopen events.
pub mod bus_file;
pub mod capture;
pub mod decoder;
pub mod event;
pub mod frame;
pub mod profile;
pub mod query;
pub mod replay;
pub mod session;
pub mod sink;
pub mod statistics;
pub mod wire;
