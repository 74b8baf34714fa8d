//! CAN captures to annotated events of CANopen, J1939 and UDS devices.
//!
//! ```text
//! bytes ─capture─▶ Frame ─session: route─▶ wire ─▶ Message ─session (+ profile)─▶ Event ─rules─▶ Finding ─▶ sink, query, statistics
//! ```
//!
//! Each folder is one of these arrows and imports only from those left of it; [`decoder`] alone knows all.
//! Nothing here opens a file, reads a clock or starts a thread: time is the frames' time.
//!
//! ```
//! use cobscope_decoder::capture::{Batch, ReadOptions, Reader};
//! use cobscope_decoder::decoder::Decoder;
//! use cobscope_decoder::event::Event;
//! use cobscope_decoder::session::{Bus, SessionOptions};
//!
//! let capture = &b"(1700000000.000000) can0 705#00\n(1700000000.500000) can0 705#7F\n"[..];
//! let mut reader = Reader::open(capture, &ReadOptions::default())?;
//! let mut decoder = Decoder::new(SessionOptions::default());
//! let mut batch = Batch::new();
//! let mut kinds = Vec::new();
//! while reader.read(&mut batch)? {
//!     for frame in batch.frames() {
//!         decoder.push(frame, reader.buses(), &mut |event: &Event, _: &Bus| kinds.push(event.kind.name()));
//!     }
//! }
//! assert_eq!(kinds, ["boot-up", "nmt-state", "heartbeat"]);
//! # Ok::<(), cobscope_decoder::capture::CaptureError>(())
//! ```

mod ascii;
pub mod bus_file;
pub mod capture;
pub mod decoder;
pub mod event;
pub mod finding;
pub mod frame;
pub mod profile;
pub mod query;
pub mod replay;
pub mod rules;
pub mod samples;
pub mod session;
pub mod sink;
pub mod statistics;
pub mod why;
pub mod wire;
pub mod words;
