//! The library of the page `cobscope.html`: captures are read in a worker of the browser, in slices and in
//! bounded steps, and nothing leaves the machine.
//!
//! ```text
//! page ─JSON─▶ worker ─call─▶ Session ─▶ cobscope-decoder
//!                 ▲              │
//!                 └─read(file, offset)   File.slice of the user's file
//! ```
//!
//! Nothing is decided here: findings, stories, texts and pages are those of the library. Everything but
//! `abi` runs on any platform, so that tests compare it with the program without a browser.

#[cfg(target_arch = "wasm32")]
mod abi;
mod capture;
mod counts;
mod cut;
mod export;
pub mod files;
mod filter;
mod input;
mod jobs;
mod matcher;
mod opening;
mod overview;
mod plot;
mod report;
mod request;
mod rows;
mod search;
mod seek;
mod session;
mod state;
mod survey;
mod unpack;

pub use session::{Response, WorkerState};
