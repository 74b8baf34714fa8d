//! Functions of CANlib. Those that transmit are not among them.

use std::ffi::{c_char, c_int, c_long, c_uint, c_ulong, c_void};
use std::time::Duration;

use super::CanlibTiming;
use crate::driver_text::clean_text;
use crate::library::DriverLibrary;
use crate::{OpenError, Vendor};

/// An open channel (`CanHandle`).
pub(super) type ChannelHandle = c_int;

/// No message within the time limit (`canERR_NOMSG`, `canERR_TIMEOUT`).
const NO_MESSAGE: [c_int; 2] = [-2, -7];

/// Another program has the channel with other settings (`canERR_NOTFOUND`, as `canOpenChannel` reports it).
const NOT_FOUND: c_int = -3;

/// Open flags: the settings of this program must hold (`canOPEN_REQUIRE_INIT_ACCESS`), and virtual channels are welcome
/// (`canOPEN_ACCEPT_VIRTUAL`).
const OPEN_FLAGS: c_int = 0x0080 | 0x0020;

/// Output control that never drives the bus (`canDRIVER_SILENT`).
const SILENT: c_uint = 1;

/// `canIOCTL_SET_TIMER_SCALE` and `canIOCTL_GET_TIMER_SCALE`: unit of the timestamps in µs.
const SET_TIMER_SCALE: c_uint = 6;
const GET_TIMER_SCALE: c_uint = 12;

/// Unit of the timestamps unless it is set, in µs.
const DEFAULT_SCALE: u32 = 1_000;

/// Data of a channel (`canCHANNELDATA_…`): capabilities, channel number on the card, description of the device.
const CAPABILITIES: c_int = 1;
const CHANNEL_ON_CARD: c_int = 6;
const DESCRIPTION: c_int = 26;

/// Max number of channels that are listed.
const MAX_CHANNELS: c_int = 256;

/// Length of buffers for texts.
const TEXT_LENGTH: usize = 256;

/// A message as CANlib returns it.
#[derive(Debug, Clone, Copy)]
pub(super) struct CanlibMessage {
    pub(super) id: i64,
    /// Room for FD messages, although none are requested.
    pub(super) data: [u8; 64],
    pub(super) length: u32,
    pub(super) flags: u32,
    /// Time in units of the timer scale.
    pub(super) time: u64,
}

type BusParameters =
    unsafe extern "system" fn(c_int, c_long, c_uint, c_uint, c_uint, c_uint, c_uint) -> c_int;
type ReadWait = unsafe extern "system" fn(
    c_int,
    *mut c_long,
    *mut c_void,
    *mut c_uint,
    *mut c_uint,
    *mut c_ulong,
    c_ulong,
) -> c_int;

/// The functions, with `__stdcall` on Windows.
pub(super) struct CanlibFunctions {
    initialize: unsafe extern "system" fn(),
    channel_count: unsafe extern "system" fn(*mut c_int) -> c_int,
    /// Looks for adapters that were plugged in since; libraries of old drivers lack it.
    enumerate: Option<unsafe extern "system" fn(*mut c_int) -> c_int>,
    channel_data: unsafe extern "system" fn(c_int, c_int, *mut c_void, usize) -> c_int,
    open: unsafe extern "system" fn(c_int, c_int) -> c_int,
    set_parameters: BusParameters,
    set_output: unsafe extern "system" fn(c_int, c_uint) -> c_int,
    output: unsafe extern "system" fn(c_int, *mut c_uint) -> c_int,
    control: unsafe extern "system" fn(c_int, c_uint, *mut c_void, c_uint) -> c_int,
    bus_on: unsafe extern "system" fn(c_int) -> c_int,
    bus_off: unsafe extern "system" fn(c_int) -> c_int,
    close: unsafe extern "system" fn(c_int) -> c_int,
    read: ReadWait,
    status: unsafe extern "system" fn(c_int, *mut c_ulong) -> c_int,
    counters: unsafe extern "system" fn(c_int, *mut c_uint, *mut c_uint, *mut c_uint) -> c_int,
    text: unsafe extern "system" fn(c_int, *mut c_char, c_uint) -> c_int,
    /// Keeps the functions valid.
    _library: DriverLibrary,
}

impl CanlibFunctions {
    pub(super) fn load() -> Result<Self, OpenError> {
        let library = DriverLibrary::load(Vendor::Kvaser)?;
        // SAFETY: the signatures are those of canlib.h; CanHandle and canStatus are ints. `long` has 32 bits on Windows and
        // 64 on Linux, as `c_long` has.
        unsafe {
            Ok(Self {
                initialize: library.function("canInitializeLibrary")?,
                channel_count: library.function("canGetNumberOfChannels")?,
                enumerate: library.function("canEnumHardwareEx").ok(),
                channel_data: library.function("canGetChannelData")?,
                open: library.function("canOpenChannel")?,
                set_parameters: library.function("canSetBusParams")?,
                set_output: library.function("canSetBusOutputControl")?,
                output: library.function("canGetBusOutputControl")?,
                control: library.function("canIoCtl")?,
                bus_on: library.function("canBusOn")?,
                bus_off: library.function("canBusOff")?,
                close: library.function("canClose")?,
                read: library.function("canReadWait")?,
                status: library.function("canReadStatus")?,
                counters: library.function("canReadErrorCounters")?,
                text: library.function("canGetErrorText")?,
                _library: library,
            })
        }
    }

    pub(super) fn initialize(&self) {
        // SAFETY: no arguments; may be called at any time.
        unsafe { (self.initialize)() }
    }

    pub(super) fn channel_count(&self) -> Result<i32, OpenError> {
        let mut count: c_int = 0;
        if let Some(enumerate) = self.enumerate {
            // SAFETY: the pointer is valid for writes. Open channels keep their numbers.
            let _ = unsafe { enumerate(&raw mut count) };
        }
        // SAFETY: the pointer is valid for writes.
        let status = unsafe { (self.channel_count)(&raw mut count) };
        self.check_status("canGetNumberOfChannels", status)?;
        Ok(count.clamp(0, MAX_CHANNELS))
    }

    fn channel_word(&self, channel: i32, item: c_int) -> Option<u32> {
        let mut value: u32 = 0;
        // SAFETY: the buffer is valid for writes and as long as stated.
        let status = unsafe { (self.channel_data)(channel, item, (&raw mut value).cast(), 4) };
        (status >= 0).then_some(value)
    }

    /// Capabilities of a channel; `None` if the driver does not state them.
    pub(super) fn capabilities(&self, channel: i32) -> Option<u32> {
        self.channel_word(channel, CAPABILITIES)
    }

    /// Description of the device with its channel: `Kvaser Leaf Pro HS v2, channel 1`.
    pub(super) fn device_text(&self, channel: i32) -> String {
        let mut buffer = [0_u8; TEXT_LENGTH];
        // SAFETY: the buffer is valid for writes and as long as stated.
        let status =
            unsafe { (self.channel_data)(channel, DESCRIPTION, buffer.as_mut_ptr().cast(), TEXT_LENGTH) };
        let name = if status >= 0 { clean_text(&buffer) } else { String::new() };
        let name = if name.is_empty() { "Kvaser device".to_owned() } else { name };
        match self.channel_word(channel, CHANNEL_ON_CARD) {
            Some(number) => format!("{name}, channel {}", number.saturating_add(1)),
            None => name,
        }
    }

    pub(super) fn open(&self, channel: i32) -> Result<ChannelHandle, OpenError> {
        // SAFETY: no pointers.
        let handle = unsafe { (self.open)(channel, OPEN_FLAGS) };
        if handle == NOT_FOUND {
            return Err(OpenError::InUse { channel: channel.to_string() });
        }
        self.check_status("canOpenChannel", handle)?;
        Ok(handle)
    }

    pub(super) fn set_timing(&self, handle: ChannelHandle, timing: CanlibTiming) -> Result<(), OpenError> {
        let CanlibTiming { bit_rate, segment_1, segment_2, jump_width, samples } = timing;
        let [segment_1, segment_2, jump_width, samples] =
            [segment_1, segment_2, jump_width, samples].map(c_uint::from);
        // SAFETY: no pointers.
        let status = unsafe {
            (self.set_parameters)(handle, bit_rate.into(), segment_1, segment_2, jump_width, samples, 0)
        };
        self.check_status("canSetBusParams", status)
    }

    pub(super) fn set_silent(&self, handle: ChannelHandle) -> Result<(), OpenError> {
        // SAFETY: no pointers.
        let status = unsafe { (self.set_output)(handle, SILENT) };
        self.check_status("canSetBusOutputControl", status)
    }

    /// Whether the channel never drives the bus; false if the driver does not state it.
    pub(super) fn is_silent(&self, handle: ChannelHandle) -> bool {
        let mut output: c_uint = 0;
        // SAFETY: the pointer is valid for writes.
        let status = unsafe { (self.output)(handle, &raw mut output) };
        status >= 0 && output == SILENT
    }

    /// Sets the unit of the timestamps to 1 µs; returns the unit that the driver uses.
    pub(super) fn set_microseconds(&self, handle: ChannelHandle) -> u32 {
        let mut scale: u32 = 1;
        // SAFETY: the buffer is valid and as long as stated.
        let set = unsafe { (self.control)(handle, SET_TIMER_SCALE, (&raw mut scale).cast(), 4) };
        let mut found: u32 = 0;
        // SAFETY: as above.
        let get = unsafe { (self.control)(handle, GET_TIMER_SCALE, (&raw mut found).cast(), 4) };
        match (set >= 0, get >= 0 && found > 0) {
            (_, true) => found,
            (true, false) => 1,
            (false, false) => DEFAULT_SCALE,
        }
    }

    pub(super) fn bus_on(&self, handle: ChannelHandle) -> Result<(), OpenError> {
        // SAFETY: no pointers.
        let status = unsafe { (self.bus_on)(handle) };
        self.check_status("canBusOn", status)
    }

    pub(super) fn bus_off(&self, handle: ChannelHandle) {
        // SAFETY: no pointers. The status is of no use: an unplugged channel is off the bus already.
        let _ = unsafe { (self.bus_off)(handle) };
    }

    pub(super) fn close(&self, handle: ChannelHandle) {
        // SAFETY: no pointers; as for `bus_off`.
        let _ = unsafe { (self.close)(handle) };
    }

    /// The next message, waiting at most `wait`; an error if the channel cannot be read any more.
    pub(super) fn read(
        &self,
        handle: ChannelHandle,
        wait: Duration,
    ) -> Result<Option<CanlibMessage>, String> {
        let (mut id, mut length, mut flags, mut time): (c_long, c_uint, c_uint, c_ulong) = (0, 0, 0, 0);
        let mut data = [0_u8; 64];
        let wait = c_ulong::from(u32::try_from(wait.as_millis()).unwrap_or(u32::MAX - 1));
        // SAFETY: all pointers are valid for writes; CANlib writes at most 64 bytes of data.
        let status = unsafe {
            (self.read)(
                handle,
                &raw mut id,
                data.as_mut_ptr().cast(),
                &raw mut length,
                &raw mut flags,
                &raw mut time,
                wait,
            )
        };
        if NO_MESSAGE.contains(&status) {
            return Ok(None);
        }
        if status < 0 {
            return Err(self.status_text(status));
        }
        #[allow(clippy::useless_conversion, reason = "both have 32 bits on Windows")]
        Ok(Some(CanlibMessage { id: i64::from(id), data, length, flags, time: u64::from(time) }))
    }

    /// Flags of the channel (`canSTAT_…`).
    pub(super) fn status(&self, handle: ChannelHandle) -> Result<u64, String> {
        let mut flags: c_ulong = 0;
        // SAFETY: the pointer is valid for writes.
        let status = unsafe { (self.status)(handle, &raw mut flags) };
        #[allow(clippy::useless_conversion, reason = "it has 32 bits on Windows")]
        if status >= 0 { Ok(u64::from(flags)) } else { Err(self.status_text(status)) }
    }

    /// Transmit and receive error counter.
    pub(super) fn error_counters(&self, handle: ChannelHandle) -> Option<(u32, u32)> {
        let (mut transmit, mut receive, mut overruns): (c_uint, c_uint, c_uint) = (0, 0, 0);
        // SAFETY: the pointers are valid for writes.
        let status =
            unsafe { (self.counters)(handle, &raw mut transmit, &raw mut receive, &raw mut overruns) };
        (status >= 0).then_some((transmit, receive))
    }

    /// Text of a status with its code.
    fn status_text(&self, status: c_int) -> String {
        const LENGTH: c_uint = 256;
        let mut buffer = [0_u8; TEXT_LENGTH];
        // SAFETY: the buffer is valid for writes and as long as stated.
        let result = unsafe { (self.text)(status, buffer.as_mut_ptr().cast(), LENGTH) };
        let found = clean_text(&buffer);
        if result >= 0 && !found.is_empty() {
            format!("{found} (CANlib status {status})")
        } else {
            format!("CANlib status {status}")
        }
    }

    fn check_status(&self, function: &'static str, status: c_int) -> Result<(), OpenError> {
        if status >= 0 {
            Ok(())
        } else {
            Err(OpenError::Driver { function, reason: self.status_text(status) })
        }
    }
}
