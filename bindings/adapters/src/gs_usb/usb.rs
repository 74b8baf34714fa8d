//! Transfers over USB with `nusb`. The endpoint to the adapter, which carries frames to transmit, is never opened.

use std::time::Duration;

use nusb::transfer::{Buffer, Bulk, ControlIn, ControlOut, ControlType, In, Recipient};
use nusb::{DeviceInfo, Endpoint, ErrorKind, Interface, MaybeFuture as _};

use super::protocol::{AdapterCommand, AdapterQuestion};
use super::{AdapterTransport, UsbAdapter};
use crate::{Disconnected, OpenError, driver_text};

/// Vendor and product (gs_usb.c, `gs_usb_table`): gs_usb, candleLight, CES CANext FD, ABE CANdebugger FD.
const PRODUCTS: [(u16, u16); 4] = [(0x1D50, 0x606F), (0x1209, 0x2323), (0x1CD2, 0x606F), (0x16D0, 0x10B8)];

/// The interface with the CAN channels; CANable 2 has a second one for firmware updates.
const INTERFACE: u8 = 0;

/// The endpoint that delivers frames: `GS_USB_ENDPOINT_IN`.
const FRAMES: u8 = 0x81;

/// Transfers that wait for frames; each one takes a single frame, and a full bus sends up to 20 per ms.
const PENDING: usize = 256;

/// Max time of a request: as in Linux.
const REQUEST: Duration = Duration::from_secs(1);

/// Adapters that are plugged in, in the order of their names.
///
/// # Errors
/// The operating system does not list devices; a computer without USB has no devices.
pub(super) fn list_devices() -> Result<Vec<(UsbAdapter, DeviceInfo)>, OpenError> {
    let listed = match nusb::list_devices().wait() {
        Ok(listed) => listed,
        // A kernel without USB has no folder of devices: error 2 of Linux.
        Err(error) if error.kind() == ErrorKind::NotFound || error.os_error() == Some(2) => {
            return Ok(Vec::new());
        }
        Err(error) => return Err(usb_error("list of USB devices", &error.to_string())),
    };
    let ours = listed.filter(|info| PRODUCTS.contains(&(info.vendor_id(), info.product_id())));
    let mut devices: Vec<_> = ours.map(|info| (describe_device(&info), info)).collect();
    devices.sort_by(|(a, _), (b, _)| a.name.cmp(&b.name));
    Ok(devices)
}

fn describe_device(info: &DeviceInfo) -> UsbAdapter {
    let text = |text: Option<&str>| driver_text::clean_text(text.unwrap_or_default().as_bytes());
    let serial = text(info.serial_number()).replace([' ', '@', '/'], "_");
    let place = || format!("{}-{}", driver_text::clean_text(info.bus_id().as_bytes()), info.device_address());
    let product = text(info.product_string());
    UsbAdapter {
        name: if serial.is_empty() { place() } else { serial },
        product: if product.is_empty() { "gs_usb adapter".into() } else { product },
    }
}

fn usb_error(function: &'static str, reason: &str) -> OpenError {
    OpenError::Driver { function, reason: reason.into() }
}

/// An adapter whose interface this program has claimed.
pub(super) struct UsbTransport {
    interface: Interface,
    frames: Endpoint<Bulk, In>,
    channel: u8,
}

impl UsbTransport {
    /// Claims the adapter.
    ///
    /// # Errors
    /// No permission, in use, or unplugged.
    pub(super) fn open(info: &DeviceInfo, name: &str, channel: u8) -> Result<Self, OpenError> {
        let refused = |error: &nusb::Error| match error.kind() {
            ErrorKind::Busy => OpenError::Claimed { channel: name.into() },
            ErrorKind::PermissionDenied => OpenError::NoPermission { channel: name.into() },
            _ => usb_error("USB", &error.to_string()),
        };
        let device = info.open().wait().map_err(|error| refused(&error))?;
        let interface = device.claim_interface(INTERFACE).wait().map_err(|error| refused(&error))?;
        let frames = interface.endpoint::<Bulk, In>(FRAMES).map_err(|error| refused(&error))?;
        if frames.max_packet_size() == 0 {
            return Err(usb_error("USB", "the endpoint of the frames has packets of 0 bytes"));
        }
        Ok(Self { interface, frames, channel })
    }

    fn setup_index(&self, is_of_device: bool) -> u16 {
        // gs_usb.c: requests to the device have value 1, those to a channel its number; the index is that of the interface.
        if is_of_device { 1 } else { self.channel.into() }
    }

    /// Gives all buffers to the operating system.
    fn fill_queue(&mut self) {
        let length = self.frames.max_packet_size();
        while self.frames.pending() < PENDING {
            self.frames.submit(Buffer::new(length));
        }
    }
}

impl AdapterTransport for UsbTransport {
    fn ask_question(&mut self, question: AdapterQuestion) -> Result<Vec<u8>, Disconnected> {
        let request = ControlIn {
            control_type: ControlType::Vendor,
            recipient: Recipient::Interface,
            request: question.request(),
            value: self.setup_index(question.is_of_device()),
            index: INTERFACE.into(),
            length: question.length(),
        };
        let answer = self.interface.control_in(request, REQUEST).wait();
        answer.map_err(|error| Disconnected(format!("request {}: {error}", question.request())))
    }

    fn send_command(&mut self, command: AdapterCommand) -> Result<(), Disconnected> {
        let request = ControlOut {
            control_type: ControlType::Vendor,
            recipient: Recipient::Interface,
            request: command.request(),
            value: self.setup_index(command.is_of_device()),
            index: INTERFACE.into(),
            data: &command.data(),
        };
        let done = self.interface.control_out(request, REQUEST).wait();
        done.map_err(|error| Disconnected(format!("request {}: {error}", command.request())))
    }

    fn read_transfer(&mut self, wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<bool, Disconnected> {
        self.fill_queue();
        let Some(completion) = self.frames.wait_next_complete(wait) else { return Ok(false) };
        if let Err(error) = completion.status {
            return Err(Disconnected(error.to_string()));
        }
        let buffer = completion.buffer;
        take(buffer.get(..completion.actual_len).unwrap_or(&buffer));
        self.frames.submit(buffer);
        Ok(true)
    }
}
