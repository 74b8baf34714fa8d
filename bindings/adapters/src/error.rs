//! Failures to open an adapter, and the loss of it.

use std::fmt;
use std::path::PathBuf;

use crate::{AdapterKind, Vendor};

/// Reason why a channel was not opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OpenError {
    /// The library of the vendor cannot be loaded.
    NoDriver {
        /// Vendor.
        vendor: Vendor,
        /// Name or path of the library.
        library: PathBuf,
        /// Reason of the operating system.
        reason: String,
    },
    /// The library lacks a function: it is too old, or another library.
    OldDriver {
        /// Vendor.
        vendor: Vendor,
        /// Name of the missing function.
        function: &'static str,
    },
    /// The channel does not exist.
    NoChannel {
        /// Kind of adapter.
        kind: AdapterKind,
        /// Channel as typed.
        channel: String,
        /// Names of the existing channels.
        present: Vec<String>,
    },
    /// Another program uses the channel.
    InUse {
        /// Channel as typed.
        channel: String,
    },
    /// No such bit rate.
    BitRate {
        /// Bit rate as requested in bit/s.
        bit_rate: u32,
        /// Existing bit rates in bit/s.
        available: Vec<u32>,
    },
    /// The clock of the adapter gives no such bit rate.
    Clock {
        /// Bit rate as requested in bit/s.
        bit_rate: u32,
        /// Clock of the CAN controller in Hz.
        clock: u32,
    },
    /// A driver of the operating system or another program uses the adapter.
    Claimed {
        /// Channel as typed.
        channel: String,
    },
    /// This user must not open the adapter.
    NoPermission {
        /// Channel as typed.
        channel: String,
    },
    /// Listen-only mode is not available. Other modes are not used because they acknowledge frames.
    NotListenOnly {
        /// Kind of adapter.
        kind: AdapterKind,
        /// Channel as typed.
        channel: String,
    },
    /// A function of the driver failed.
    Driver {
        /// Name of the function.
        function: &'static str,
        /// Text of the driver, with its code.
        reason: String,
    },
}

impl OpenError {
    /// Whether a later attempt can succeed without a change by the user: an adapter that is plugged in again.
    pub fn is_temporary(&self) -> bool {
        matches!(
            self,
            Self::NoChannel { .. } | Self::InUse { .. } | Self::Claimed { .. } | Self::Driver { .. }
        )
    }
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDriver { vendor, library, reason } => write!(
                f,
                "driver library {} not available ({reason}); install {}",
                library.display(),
                vendor.package()
            ),
            Self::OldDriver { vendor, function } => {
                write!(f, "the driver library has no function {function}; update {}", vendor.package())
            }
            Self::NoChannel { kind, channel, present } => no_channel(f, *kind, channel, &present.join(", ")),
            Self::InUse { channel } => {
                write!(f, "channel {channel} is in use by another program; close it first")
            }
            Self::BitRate { bit_rate, available } => {
                let available: Vec<_> = available.iter().map(u32::to_string).collect();
                write!(f, "{bit_rate} bit/s not available; expected {}", available.join(", "))
            }
            Self::Clock { bit_rate, clock } => {
                write!(f, "{bit_rate} bit/s not available: the clock of the adapter has {clock} Hz")
            }
            Self::Claimed { channel } => write!(
                f,
                "{} is in use by another program or by a driver; an adapter that Linux uses is an interface of \
                 SocketCAN: open can0",
                adapter_text(channel)
            ),
            Self::NoPermission { channel } => write!(
                f,
                "no permission to open {}; on Linux a udev rule gives it (docs/adapters.md)",
                adapter_text(channel)
            ),
            Self::NotListenOnly { kind, channel } => write!(
                f,
                "{} has no listen-only mode; other modes are not used because they acknowledge frames; {}",
                match kind {
                    AdapterKind::GsUsb => adapter_text(channel),
                    AdapterKind::Pcan | AdapterKind::Kvaser => format!("channel {channel}"),
                },
                kind.listen_only_remedy()
            ),
            Self::Driver { function, reason } => write!(f, "{function}: {reason}"),
        }
    }
}

impl std::error::Error for OpenError {}

/// An adapter by its name; the only one has none.
fn adapter_text(name: &str) -> String {
    if name.is_empty() { "the adapter".into() } else { format!("adapter {name}") }
}

fn no_channel(f: &mut fmt::Formatter<'_>, kind: AdapterKind, channel: &str, present: &str) -> fmt::Result {
    let vendor = match kind {
        AdapterKind::Pcan => Vendor::Pcan.maker(),
        AdapterKind::Kvaser => Vendor::Kvaser.maker(),
        AdapterKind::GsUsb => {
            return match (channel, present) {
                ("", "") => f.write_str("no gs_usb adapter found"),
                ("", _) => write!(f, "several gs_usb adapters found; name one: {present}"),
                (_, "") => write!(f, "adapter {channel} not found; no gs_usb adapter is connected"),
                _ => write!(f, "adapter {channel} not found; gs_usb adapters: {present}"),
            };
        }
    };
    match present {
        "" => write!(f, "channel {channel} not found; the driver of {vendor} reports no adapter"),
        _ => write!(f, "channel {channel} not found; channels of {vendor}: {present}"),
    }
}

/// The channel cannot be read any more: unplugged, or closed by the driver. The text is the reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Disconnected(pub String);

impl fmt::Display for Disconnected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Disconnected {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_error_names_what_to_do() {
        let no_driver = OpenError::NoDriver {
            vendor: Vendor::Kvaser,
            library: "libcanlib.so".into(),
            reason: "no such file".into(),
        };
        let text = no_driver.to_string();
        assert!(
            text.starts_with("driver library libcanlib.so not available (no such file); install "),
            "{text}"
        );
        assert!(!no_driver.is_temporary());
        let channel = |present: &[&str]| OpenError::NoChannel {
            kind: AdapterKind::Pcan,
            channel: "USB9".into(),
            present: present.iter().map(ToString::to_string).collect(),
        };
        assert_eq!(channel(&[]).to_string(), "channel USB9 not found; the driver of PEAK reports no adapter");
        assert_eq!(
            channel(&["USB1", "USB2"]).to_string(),
            "channel USB9 not found; channels of PEAK: USB1, USB2"
        );
        assert!(channel(&[]).is_temporary());
        let rate = OpenError::BitRate { bit_rate: 1, available: vec![125_000, 250_000] };
        assert_eq!(rate.to_string(), "1 bit/s not available; expected 125000, 250000");
    }
}
