//! PCAN-Basic with one adapter, USB1.

#![allow(clippy::cast_possible_truncation, reason = "times are cut to the width of their field")]

use std::ffi::{c_char, c_void};

use crate::scenario::QueueItem;
use crate::{with_adapter, write_text};

const OK: u32 = 0;
const OVERRUN: u32 = 0x40;
const EMPTY: u32 = 0x20;
const BUS_OFF: u32 = 0x10;
const NO_HARDWARE: u32 = 0x1400;
const NO_PARAMETER: u32 = 0x4000;
const NOT_INITIALISED: u32 = 0x400_0000;

const USB1: u16 = 0x51;
const LISTEN_ONLY: u8 = 0x08;
const CONDITION: u8 = 0x0D;
const ATTACHED_COUNT: u8 = 0x2A;
const ATTACHED: u8 = 0x2B;

/// `TPCANMsg`.
#[repr(C)]
pub struct FakeMessage {
    id: u32,
    kind: u8,
    length: u8,
    data: [u8; 8],
}

/// `TPCANTimestamp`.
#[repr(C)]
pub struct FakeTimestamp {
    milliseconds: u32,
    overflows: u16,
    microseconds: u16,
}

/// Joins the bus.
#[unsafe(no_mangle)]
pub extern "system" fn CAN_Initialize(
    channel: u16,
    registers: u16,
    _kind: u8,
    _port: u32,
    _interrupt: u16,
) -> u32 {
    with_adapter(|adapter| {
        adapter.record_call(&format!("CAN_Initialize {registers:04X}"));
        if channel != USB1 || adapter.scenario.is_absent {
            return NO_HARDWARE;
        }
        adapter.go_on_bus();
        OK
    })
}

/// Leaves the bus.
#[unsafe(no_mangle)]
pub extern "system" fn CAN_Uninitialize(_channel: u16) -> u32 {
    with_adapter(|adapter| {
        adapter.record_call("CAN_Uninitialize");
        adapter.is_on_bus = false;
        adapter.is_listen_only = false;
        OK
    })
}

/// Status bits.
#[unsafe(no_mangle)]
pub extern "system" fn CAN_GetStatus(_channel: u16) -> u32 {
    with_adapter(|adapter| match (adapter.is_plugged(), adapter.is_bus_off()) {
        (false, _) => NO_HARDWARE,
        (true, true) => BUS_OFF,
        (true, false) => OK,
    })
}

/// The next message.
///
/// # Safety
/// Both pointers must be valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn CAN_Read(
    _channel: u16,
    message: *mut FakeMessage,
    stamp: *mut FakeTimestamp,
) -> u32 {
    let (item, is_on_bus, time) = with_adapter(|adapter| {
        let item = if adapter.is_on_bus { adapter.next_item() } else { QueueItem::Unplugged };
        let number = if let QueueItem::Frame(number) | QueueItem::Error(number) = item { number } else { 0 };
        (item, adapter.is_on_bus || !adapter.is_plugged(), adapter.frame_time(number))
    });
    if !is_on_bus {
        return NOT_INITIALISED;
    }
    let (status, found) = match item {
        QueueItem::Frame(number) => {
            (OK, Some(FakeMessage { id: 0x181, kind: 0, length: 8, data: number.to_le_bytes() }))
        }
        QueueItem::Error(_) => {
            (OK, Some(FakeMessage { id: 4, kind: 0x40, length: 4, data: [1, 10, 96, 0, 0, 0, 0, 0] }))
        }
        QueueItem::Overrun => (OVERRUN, None),
        QueueItem::Invalid => {
            (OK, Some(FakeMessage { id: u32::MAX, kind: 0, length: 0xFF, data: [0xFF; 8] }))
        }
        QueueItem::Empty => (EMPTY, None),
        QueueItem::Unplugged => (NO_HARDWARE, None),
    };
    if let Some(found) = found {
        let milliseconds = time / 1_000;
        let times = FakeTimestamp {
            milliseconds: (milliseconds & 0xFFFF_FFFF) as u32,
            overflows: (milliseconds >> 32) as u16,
            microseconds: (time % 1_000) as u16,
        };
        // SAFETY: the caller guarantees both pointers.
        unsafe {
            message.write(found);
            stamp.write(times);
        }
    }
    status
}

/// Must never be called.
#[unsafe(no_mangle)]
pub extern "system" fn CAN_Write(_channel: u16, _message: *const c_void) -> u32 {
    with_adapter(|adapter| adapter.record_call("CAN_Write"));
    OK
}

/// A parameter.
///
/// # Safety
/// `buffer` must be valid for `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn CAN_GetValue(
    channel: u16,
    parameter: u8,
    buffer: *mut c_void,
    length: u32,
) -> u32 {
    let value = with_adapter(|adapter| {
        if parameter != ATTACHED {
            adapter.record_call(&format!("CAN_GetValue {parameter:02X}"));
        }
        let scenario = &adapter.scenario;
        match (parameter, channel) {
            (LISTEN_ONLY, USB1) => Some(u32::from(adapter.is_listen_only)),
            (CONDITION, USB1) if !scenario.is_absent => Some(if scenario.is_in_use { 2 } else { 1 }),
            (CONDITION, _) => Some(0),
            (ATTACHED_COUNT, 0) if scenario.is_hostile => Some(u32::MAX),
            (ATTACHED_COUNT | ATTACHED, 0) => Some(u32::from(!scenario.is_absent)),
            _ => None,
        }
    });
    let Some(value) = value else { return NO_PARAMETER };
    if parameter == ATTACHED {
        return if length >= 52 {
            let condition = with_adapter(|adapter| if adapter.scenario.is_in_use { 2_u32 } else { 1 });
            // SAFETY: the caller guarantees the length.
            unsafe { write_attached(buffer.cast(), condition) };
            OK
        } else {
            NO_PARAMETER
        };
    }
    // SAFETY: the caller guarantees four bytes, as the parameter requires.
    unsafe { buffer.cast::<u32>().write_unaligned(value) };
    OK
}

/// Writes a `TPCANChannelInformation` of 52 bytes.
unsafe fn write_attached(buffer: *mut u8, condition: u32) {
    // SAFETY: the caller guarantees 52 bytes.
    unsafe {
        buffer.cast::<u16>().write_unaligned(USB1);
        buffer.add(2).write(5);
        buffer.add(3).write(0);
        buffer.add(4).cast::<u32>().write_unaligned(1);
        write_text("PCAN-USB FD", buffer.add(8), 33);
        buffer.add(44).cast::<u32>().write_unaligned(7);
        buffer.add(48).cast::<u32>().write_unaligned(condition);
    }
}

/// Sets a parameter.
///
/// # Safety
/// `buffer` must be valid for `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn CAN_SetValue(
    _channel: u16,
    parameter: u8,
    buffer: *const c_void,
    _length: u32,
) -> u32 {
    // SAFETY: the caller guarantees four bytes, as all parameters in use require.
    let value = unsafe { buffer.cast::<u32>().read_unaligned() };
    with_adapter(|adapter| {
        adapter.record_call(&format!("CAN_SetValue {parameter:02X} {value}"));
        match (parameter, value) {
            (LISTEN_ONLY, 1) if adapter.set_listen_only() => OK,
            (LISTEN_ONLY, _) => NO_PARAMETER,
            _ => OK,
        }
    })
}

/// Text of a status.
///
/// # Safety
/// `buffer` must be valid for 256 bytes.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn CAN_GetErrorText(status: u32, _language: u16, buffer: *mut c_char) -> u32 {
    let text = if status == NO_HARDWARE { "The value of a handle is invalid\x1b[2J" } else { "Other" };
    // SAFETY: the caller guarantees 256 bytes.
    unsafe { write_text(text, buffer.cast(), 256) };
    OK
}
