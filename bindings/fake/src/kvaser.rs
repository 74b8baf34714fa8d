//! CANlib with one adapter, channel 0.

#![allow(clippy::cast_possible_truncation, reason = "times are cut to the width of their field")]

use std::ffi::{c_char, c_int, c_long, c_uint, c_ulong, c_void};

use crate::scenario::QueueItem;
use crate::{with_adapter, write_text};

const OK: c_int = 0;
const PARAMETER: c_int = -1;
const NO_MESSAGE: c_int = -2;
const NOT_FOUND: c_int = -3;
const HARDWARE: c_int = -15;

const SILENT: c_uint = 1;
const SILENT_MODE: u32 = 0x0020_0000;
const HANDLE: c_int = 3;

fn record_call(call: &str) {
    with_adapter(|adapter| adapter.record_call(call));
}

/// Initialises the library.
#[unsafe(no_mangle)]
pub extern "system" fn canInitializeLibrary() {
    record_call("canInitializeLibrary");
}

/// Looks for adapters.
///
/// # Safety
/// The pointer must be valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canEnumHardwareEx(count: *mut c_int) -> c_int {
    // SAFETY: the caller guarantees it.
    unsafe { count.write(1) };
    record_call("canEnumHardwareEx");
    OK
}

/// Number of channels.
///
/// # Safety
/// The pointer must be valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canGetNumberOfChannels(count: *mut c_int) -> c_int {
    let found = with_adapter(|adapter| match (adapter.scenario.is_absent, adapter.scenario.is_hostile) {
        (true, _) => 0,
        (_, true) => c_int::MIN,
        _ => 1,
    });
    // SAFETY: the caller guarantees it.
    unsafe { count.write(found) };
    OK
}

/// Data of a channel.
///
/// # Safety
/// `buffer` must be valid for `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canGetChannelData(
    _channel: c_int,
    item: c_int,
    buffer: *mut c_void,
    length: usize,
) -> c_int {
    let is_light = with_adapter(|adapter| adapter.scenario.is_light);
    let word = match item {
        1 if is_light => Some(0x6),
        1 => Some(SILENT_MODE | 0x6),
        6 => Some(0),
        _ => None,
    };
    // SAFETY: the caller guarantees the length.
    match (word, item) {
        (Some(word), _) if length >= 4 => unsafe { buffer.cast::<u32>().write_unaligned(word) },
        (_, 26) => unsafe { write_text("Kvaser Leaf Pro HS v2", buffer.cast(), length) },
        _ => return PARAMETER,
    }
    OK
}

/// Opens a channel.
#[unsafe(no_mangle)]
pub extern "system" fn canOpenChannel(channel: c_int, flags: c_int) -> c_int {
    with_adapter(|adapter| {
        adapter.record_call(&format!("canOpenChannel {channel} {flags:X}"));
        if adapter.scenario.is_in_use || adapter.scenario.is_absent { NOT_FOUND } else { HANDLE }
    })
}

/// Sets a bit rate.
#[unsafe(no_mangle)]
pub extern "system" fn canSetBusParams(
    handle: c_int,
    rate: c_long,
    segment_1: c_uint,
    segment_2: c_uint,
    jump_width: c_uint,
    samples: c_uint,
    _mode: c_uint,
) -> c_int {
    record_call(&match rate {
        ..0 => format!("canSetBusParams {rate}"),
        _ => format!("canSetBusParams {rate} {segment_1} {segment_2} {jump_width} {samples}"),
    });
    if handle == HANDLE { OK } else { PARAMETER }
}

/// Sets the output control.
#[unsafe(no_mangle)]
pub extern "system" fn canSetBusOutputControl(_handle: c_int, output: c_uint) -> c_int {
    with_adapter(|adapter| {
        adapter.record_call(&format!("canSetBusOutputControl {output}"));
        if output == SILENT && adapter.set_listen_only() { OK } else { PARAMETER }
    })
}

/// Reads the output control.
///
/// # Safety
/// The pointer must be valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canGetBusOutputControl(_handle: c_int, output: *mut c_uint) -> c_int {
    let found = with_adapter(|adapter| {
        adapter.record_call("canGetBusOutputControl");
        if adapter.is_listen_only { SILENT } else { 4 }
    });
    // SAFETY: the caller guarantees it.
    unsafe { output.write(found) };
    OK
}

/// Sets or reads the unit of the timestamps.
///
/// # Safety
/// `buffer` must be valid for four bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canIoCtl(
    _handle: c_int,
    function: c_uint,
    buffer: *mut c_void,
    _length: c_uint,
) -> c_int {
    match function {
        6 => record_call("canIoCtl timer scale"),
        // SAFETY: the caller guarantees four bytes.
        12 => unsafe { buffer.cast::<u32>().write_unaligned(1) },
        _ => return PARAMETER,
    }
    OK
}

/// Joins the bus.
#[unsafe(no_mangle)]
pub extern "system" fn canBusOn(_handle: c_int) -> c_int {
    with_adapter(|adapter| {
        adapter.record_call("canBusOn");
        adapter.go_on_bus();
        OK
    })
}

/// Leaves the bus.
#[unsafe(no_mangle)]
pub extern "system" fn canBusOff(_handle: c_int) -> c_int {
    with_adapter(|adapter| {
        adapter.record_call("canBusOff");
        adapter.is_on_bus = false;
        OK
    })
}

/// Closes a channel.
#[unsafe(no_mangle)]
pub extern "system" fn canClose(_handle: c_int) -> c_int {
    with_adapter(|adapter| {
        adapter.record_call("canClose");
        adapter.is_listen_only = false;
        OK
    })
}

/// The next message. If there is none, it waits.
///
/// # Safety
/// All pointers must be valid for writes, `data` for 8 bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canReadWait(
    _handle: c_int,
    id: *mut c_long,
    data: *mut c_void,
    length: *mut c_uint,
    flags: *mut c_uint,
    time: *mut c_ulong,
    wait: c_ulong,
) -> c_int {
    let (item, at, overrun) = with_adapter(|adapter| {
        let mut item = if adapter.is_on_bus { adapter.next_item() } else { QueueItem::Unplugged };
        let is_overrun = item == QueueItem::Overrun;
        // CANlib marks the next message.
        if is_overrun {
            item = adapter.next_item();
        }
        let number = if let QueueItem::Frame(number) | QueueItem::Error(number) = item { number } else { 0 };
        (item, adapter.frame_time(number), if is_overrun { 0x0400 } else { 0 })
    });
    let (found_id, found_data, found_length, found_flags) = match item {
        QueueItem::Frame(number) => (0x181, number.to_le_bytes(), 8, 0x0002),
        QueueItem::Error(_) => (0, [0; 8], 0, 0x0020 | 0x0800),
        QueueItem::Invalid => (-1, [0xFF; 8], c_uint::MAX, 0x0004),
        QueueItem::Empty => {
            #[allow(clippy::useless_conversion, reason = "it has 32 bits on Windows")]
            std::thread::sleep(std::time::Duration::from_millis(u64::from(wait).min(5)));
            return NO_MESSAGE;
        }
        QueueItem::Unplugged | QueueItem::Overrun => return HARDWARE,
    };
    // SAFETY: the caller guarantees all pointers.
    unsafe {
        id.write(found_id);
        data.cast::<[u8; 8]>().write_unaligned(found_data);
        length.write(found_length);
        flags.write(found_flags | overrun);
        // The lowest 32 bits, as on Windows.
        time.write((at & 0xFFFF_FFFF) as c_ulong);
    }
    OK
}

/// Must never be called.
#[unsafe(no_mangle)]
pub extern "system" fn canWrite(
    _handle: c_int,
    _id: c_long,
    _data: *const c_void,
    _length: c_uint,
    _flags: c_uint,
) -> c_int {
    record_call("canWrite");
    OK
}

/// Flags of the channel.
///
/// # Safety
/// The pointer must be valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canReadStatus(_handle: c_int, flags: *mut c_ulong) -> c_int {
    let found =
        with_adapter(|adapter| adapter.is_plugged().then(|| if adapter.is_bus_off() { 0x2 } else { 0x8 }));
    let Some(found) = found else { return HARDWARE };
    // SAFETY: the caller guarantees it.
    unsafe { flags.write(found) };
    OK
}

/// Error counters.
///
/// # Safety
/// The pointers must be valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canReadErrorCounters(
    _handle: c_int,
    transmit: *mut c_uint,
    receive: *mut c_uint,
    overruns: *mut c_uint,
) -> c_int {
    // SAFETY: the caller guarantees it.
    unsafe {
        transmit.write(0);
        receive.write(300);
        overruns.write(0);
    }
    OK
}

/// Text of a status.
///
/// # Safety
/// `buffer` must be valid for `room` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn canGetErrorText(status: c_int, buffer: *mut c_char, room: c_uint) -> c_int {
    let text = if status == HARDWARE { "A hardware error was detected" } else { "Other" };
    // SAFETY: the caller guarantees the room.
    unsafe { write_text(text, buffer.cast(), room as usize) };
    OK
}
