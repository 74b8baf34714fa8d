//! Functions of PCAN-Basic. `CAN_Write` and `CAN_WriteFD` are not among them.

use std::ffi::{c_char, c_void};
use std::mem::size_of;

use crate::driver_text::clean_text;
use crate::library::DriverLibrary;
use crate::{OpenError, Vendor};

use super::message::{PcanMessage, PcanTimestamp};

/// Handle of a channel (`TPCANHandle`).
pub(super) type Handle = u16;

/// Handle of the driver as a whole (`PCAN_NONEBUS`).
const DRIVER: Handle = 0;

/// Status without an error (`PCAN_ERROR_OK`).
const OK: u32 = 0;

/// Language of texts: English (Windows language identifier).
const ENGLISH: u16 = 0x09;

/// Length of the buffer for texts that `CAN_GetErrorText` requires.
const TEXT_LENGTH: usize = 256;

/// Max number of channels that are listed; PCAN-Basic has 59 handles for plug-and-play devices.
const MAX_CHANNELS: u32 = 256;

/// Parameters that are only read (`PCAN_…`).
#[derive(Debug, Clone, Copy)]
#[repr(u8)]
pub(super) enum PcanParameter {
    /// `PCAN_CHANNEL_CONDITION`.
    Condition = 0x0D,
    /// `PCAN_ATTACHED_CHANNELS_COUNT`.
    AttachedCount = 0x2A,
    /// `PCAN_ATTACHED_CHANNELS`.
    Attached = 0x2B,
}

/// Parameters that may be switched on: no other parameter is ever written.
#[derive(Debug, Clone, Copy)]
#[repr(u8)]
pub(super) enum PcanSwitch {
    /// `PCAN_LISTEN_ONLY`.
    ListenOnly = 0x08,
    /// `PCAN_ALLOW_ERROR_FRAMES`: reception of bus errors.
    ErrorFrames = 0x20,
}

/// `TPCANChannelInformation`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(super) struct AttachedChannel {
    pub(super) handle: Handle,
    pub(super) device_type: u8,
    pub(super) controller: u8,
    pub(super) features: u32,
    pub(super) device_name: [u8; 33],
    pub(super) device_id: u32,
    pub(super) condition: u32,
}

impl AttachedChannel {
    const EMPTY: Self = Self {
        handle: 0,
        device_type: 0,
        controller: 0,
        features: 0,
        device_name: [0; 33],
        device_id: 0,
        condition: 0,
    };
}

/// The functions, with `__stdcall` on Windows.
pub(super) struct PcanFunctions {
    initialize: unsafe extern "system" fn(Handle, u16, u8, u32, u16) -> u32,
    uninitialize: unsafe extern "system" fn(Handle) -> u32,
    status: unsafe extern "system" fn(Handle) -> u32,
    read: unsafe extern "system" fn(Handle, *mut PcanMessage, *mut PcanTimestamp) -> u32,
    get: unsafe extern "system" fn(Handle, u8, *mut c_void, u32) -> u32,
    set: unsafe extern "system" fn(Handle, u8, *mut c_void, u32) -> u32,
    text: unsafe extern "system" fn(u32, u16, *mut c_char) -> u32,
    /// Keeps the functions valid.
    _library: DriverLibrary,
}

impl PcanFunctions {
    pub(super) fn load() -> Result<Self, OpenError> {
        let library = DriverLibrary::load(Vendor::Pcan)?;
        // SAFETY: the signatures are those of PCANBasic.h: TPCANHandle and TPCANBaudrate are 16 bits wide, TPCANType and
        // TPCANParameter 8, TPCANStatus and DWORD 32, also on Linux (__u32).
        unsafe {
            Ok(Self {
                initialize: library.function("CAN_Initialize")?,
                uninitialize: library.function("CAN_Uninitialize")?,
                status: library.function("CAN_GetStatus")?,
                read: library.function("CAN_Read")?,
                get: library.function("CAN_GetValue")?,
                set: library.function("CAN_SetValue")?,
                text: library.function("CAN_GetErrorText")?,
                _library: library,
            })
        }
    }

    /// Joins the bus.
    pub(super) fn initialize(&self, handle: Handle, registers: u16) -> Result<(), OpenError> {
        // SAFETY: no pointers. Type, port and interrupt are 0, as for all plug-and-play devices.
        let status = unsafe { (self.initialize)(handle, registers, 0, 0, 0) };
        self.check_status("CAN_Initialize", status)
    }

    /// Leaves the bus.
    pub(super) fn uninitialize(&self, handle: Handle) {
        // SAFETY: no pointers. The status is of no use: an unplugged channel is closed already.
        let _ = unsafe { (self.uninitialize)(handle) };
    }

    pub(super) fn status(&self, handle: Handle) -> u32 {
        // SAFETY: no pointers.
        unsafe { (self.status)(handle) }
    }

    /// Status and message; `None` if the driver has not written one.
    pub(super) fn read(&self, handle: Handle) -> (u32, Option<PcanMessage>, PcanTimestamp) {
        let (mut message, mut stamp) = (PcanMessage::UNWRITTEN, PcanTimestamp::default());
        // SAFETY: both pointers are valid for writes during the call. The structures have the layout of the header, and the
        // message has room after it.
        let status = unsafe { (self.read)(handle, &raw mut message, &raw mut stamp) };
        (status, message.is_written().then_some(message), stamp)
    }

    /// A parameter of 32 bits.
    pub(super) fn read_parameter(&self, handle: Handle, parameter: PcanParameter) -> Result<u32, OpenError> {
        self.read_word(handle, parameter as u8).map_err(|status| self.call_failure("CAN_GetValue", status))
    }

    fn read_word(&self, handle: Handle, parameter: u8) -> Result<u32, u32> {
        let mut value: u32 = 0;
        // SAFETY: the buffer is valid for writes and as long as stated.
        let status = unsafe { (self.get)(handle, parameter, (&raw mut value).cast(), 4) };
        if status == OK { Ok(value) } else { Err(status) }
    }

    /// Whether a switch is on; false if the driver does not state it.
    pub(super) fn is_on(&self, handle: Handle, switch: PcanSwitch) -> bool {
        self.read_word(handle, switch as u8) == Ok(1)
    }

    pub(super) fn switch_on(&self, handle: Handle, switch: PcanSwitch) -> Result<(), OpenError> {
        let mut on: u32 = 1;
        // SAFETY: the buffer is valid and as long as stated; the driver only reads it.
        let status = unsafe { (self.set)(handle, switch as u8, (&raw mut on).cast(), 4) };
        self.check_status("CAN_SetValue", status)
    }

    /// Channels of the adapters that are plugged in.
    pub(super) fn attached_channels(&self) -> Result<Vec<AttachedChannel>, OpenError> {
        let count = self.read_parameter(DRIVER, PcanParameter::AttachedCount)?.min(MAX_CHANNELS);
        if count == 0 {
            return Ok(Vec::new());
        }
        let mut list: Vec<_> = (0..count).map(|_| AttachedChannel::EMPTY).collect();
        let length = count.saturating_mul(size_of::<AttachedChannel>().try_into().unwrap_or(0));
        // SAFETY: the buffer is valid for writes and as long as stated; any bytes are a valid `Attached`.
        let status =
            unsafe { (self.get)(DRIVER, PcanParameter::Attached as u8, list.as_mut_ptr().cast(), length) };
        self.check_status("CAN_GetValue", status)?;
        // An adapter that was unplugged between the calls leaves an empty entry.
        list.retain(|attached| attached.handle != DRIVER);
        Ok(list)
    }

    /// Text of a status with its code: `The hardware handle is invalid (PCAN status 1400)`.
    pub(super) fn status_text(&self, status: u32) -> String {
        let mut buffer = [0_u8; TEXT_LENGTH * 2];
        // SAFETY: the buffer is twice as long as PCAN-Basic requires.
        let result = unsafe { (self.text)(status, ENGLISH, buffer.as_mut_ptr().cast()) };
        let found = clean_text(&buffer);
        if result == OK && !found.is_empty() {
            format!("{found} (PCAN status {status:X})")
        } else {
            format!("PCAN status {status:X}")
        }
    }

    fn check_status(&self, function: &'static str, status: u32) -> Result<(), OpenError> {
        if status == OK { Ok(()) } else { Err(self.call_failure(function, status)) }
    }

    fn call_failure(&self, function: &'static str, status: u32) -> OpenError {
        OpenError::Driver { function, reason: self.status_text(status) }
    }
}

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use super::*;

    /// As a C compiler places the fields: DWORDs at multiples of 4.
    #[test]
    fn the_structure_has_the_layout_of_the_header() {
        assert_eq!(size_of::<AttachedChannel>(), 52);
        assert_eq!(offset_of!(AttachedChannel, features), 4);
        assert_eq!(offset_of!(AttachedChannel, device_name), 8);
        assert_eq!(offset_of!(AttachedChannel, device_id), 44);
        assert_eq!(offset_of!(AttachedChannel, condition), 48);
    }
}
