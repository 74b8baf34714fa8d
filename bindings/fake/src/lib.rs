//! Driver libraries of PEAK and Kvaser for tests, in one shared library with the functions of both; and a gs_usb adapter.
//!
//! A scenario selects what they play: `frames=100000,error_every=1000,unplug_at=500`. It is read from `COBSCOPE_FAKE_SCENARIO`,
//! or set by [`fake_reset`]. Calls other than reads are recorded, and appended to the file `COBSCOPE_FAKE_CALLS`.
//!
//! Frame number n has identifier 181 and n as its data, least significant byte first, and a timestamp of 100 µs × n after
//! the start, so that a test sees each lost, repeated or changed frame.

#![allow(unsafe_code, reason = "functions in C that are called by their names")]

pub mod gs_usb;
mod kvaser;
mod pcan;
mod scenario;

use std::ffi::{CStr, c_char};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::sync::{Mutex, MutexGuard, PoisonError};

use scenario::{QueueItem, Scenario};

/// State of the simulated adapter. It has one channel.
pub(crate) struct SimulatedAdapter {
    pub(crate) scenario: Scenario,
    calls: Vec<String>,
    pub(crate) is_on_bus: bool,
    pub(crate) is_listen_only: bool,
    is_unplugged: bool,
    /// Number of the next frame.
    next: u64,
    /// Items until the queue is empty once.
    left_in_burst: u64,
    /// The error, overrun or invalid item before the next frame has been played.
    has_played_special: bool,
}

impl SimulatedAdapter {
    fn new(scenario: Scenario) -> Self {
        Self {
            left_in_burst: scenario.burst,
            scenario,
            calls: Vec::new(),
            is_on_bus: false,
            is_listen_only: false,
            is_unplugged: false,
            next: 0,
            has_played_special: false,
        }
    }

    /// Records a call.
    pub(crate) fn record_call(&mut self, call: &str) {
        self.calls.push(call.to_owned());
        if let Some(path) = std::env::var_os("COBSCOPE_FAKE_CALLS") {
            let file = OpenOptions::new().create(true).append(true).open(path);
            let _ = file.and_then(|mut file| writeln!(file, "{call}"));
        }
    }

    /// Joins the bus. The scenario can cancel listen-only mode here, as a faulty driver would.
    pub(crate) fn go_on_bus(&mut self) {
        if self.scenario.listen == scenario::ListenBehaviour::Cancel {
            self.is_listen_only = false;
        }
        self.is_on_bus = true;
        self.is_unplugged = false;
        let mode = if self.is_listen_only { "listen-only" } else { "normal" };
        self.record_call(&format!("on the bus in {mode} mode"));
    }

    /// Sets listen-only mode; false if the scenario refuses it.
    pub(crate) fn set_listen_only(&mut self) -> bool {
        self.is_listen_only = self.scenario.listen != scenario::ListenBehaviour::Ignore;
        self.scenario.listen != scenario::ListenBehaviour::Refuse
    }

    /// The next item of the receive queue.
    pub(crate) fn next_item(&mut self) -> QueueItem {
        if self.scenario.unplug_at == Some(self.next) && !self.is_unplugged {
            self.is_unplugged = true;
            self.is_on_bus = false;
            // After it is plugged in again, the frames continue.
            self.scenario.unplug_at = None;
        }
        if self.is_unplugged {
            return QueueItem::Unplugged;
        }
        if self.next >= self.scenario.frames {
            return QueueItem::Empty;
        }
        if self.left_in_burst == 0 {
            self.left_in_burst = self.scenario.burst;
            return QueueItem::Empty;
        }
        let special = self.scenario.special_before(self.next).filter(|_| !self.has_played_special);
        if let Some(item) = special {
            self.has_played_special = true;
            return item;
        }
        self.has_played_special = false;
        self.left_in_burst -= 1;
        self.next += 1;
        QueueItem::Frame(self.next - 1)
    }

    /// Time of the next frame in µs.
    pub(crate) fn frame_time(&self, number: u64) -> u64 {
        self.scenario.start.wrapping_add(number.wrapping_mul(100))
    }

    /// Whether the controller is bus off at present.
    pub(crate) fn is_bus_off(&self) -> bool {
        self.scenario.bus_off_at.is_some_and(|at| self.next >= at)
    }

    /// Whether the adapter answers.
    pub(crate) fn is_plugged(&self) -> bool {
        !self.is_unplugged
    }
}

static ADAPTER: Mutex<Option<SimulatedAdapter>> = Mutex::new(None);

/// Runs `work` with the adapter.
pub(crate) fn with_adapter<T>(work: impl FnOnce(&mut SimulatedAdapter) -> T) -> T {
    let mut guard: MutexGuard<'_, Option<SimulatedAdapter>> =
        ADAPTER.lock().unwrap_or_else(PoisonError::into_inner);
    let from_environment = || Scenario::parse(&std::env::var("COBSCOPE_FAKE_SCENARIO").unwrap_or_default());
    work(guard.get_or_insert_with(|| SimulatedAdapter::new(from_environment())))
}

/// Writes a text of at most `room` bytes with its NUL.
///
/// # Safety
/// `buffer` must be valid for `room` bytes.
pub(crate) unsafe fn write_text(text: &str, buffer: *mut u8, room: usize) {
    let length = text.len().min(room.saturating_sub(1));
    // SAFETY: the caller guarantees the room.
    unsafe {
        buffer.copy_from_nonoverlapping(text.as_ptr(), length);
        buffer.add(length).write(0);
    }
}

/// Starts again with a scenario.
///
/// # Safety
/// `scenario` must point to a text that ends with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fake_reset(scenario: *const c_char) {
    // SAFETY: the caller guarantees it.
    let text = unsafe { CStr::from_ptr(scenario) }.to_string_lossy();
    *ADAPTER.lock().unwrap_or_else(PoisonError::into_inner) =
        Some(SimulatedAdapter::new(Scenario::parse(&text)));
}

/// The recorded calls, one line each.
///
/// # Safety
/// `buffer` must be valid for `room` bytes, and `room` above 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fake_calls(buffer: *mut u8, room: usize) {
    let calls = with_adapter(|adapter| adapter.calls.join("\n"));
    // SAFETY: the caller guarantees the room.
    unsafe { write_text(&calls, buffer, room) };
}
