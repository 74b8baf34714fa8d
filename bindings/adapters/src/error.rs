//! Failures to open an adapter, and the loss of it.

use std::fmt;
use std::path::PathBuf;

use crate::Vendor;

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
        /// Vendor.
        vendor: Vendor,
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
    /// Listen-only mode is not available. Other modes are not used because they acknowledge frames.
    NotListenOnly {
        /// Vendor.
        vendor: Vendor,
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
        matches!(self, Self::NoChannel { .. } | Self::InUse { .. } | Self::Driver { .. })
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
            Self::NoChannel { vendor, channel, present } if present.is_empty() => {
                write!(f, "channel {channel} not found; the driver of {} reports no adapter", vendor.maker())
            }
            Self::NoChannel { vendor, channel, present } => {
                write!(
                    f,
                    "channel {channel} not found; channels of {}: {}",
                    vendor.maker(),
                    present.join(", ")
                )
            }
            Self::InUse { channel } => {
                write!(f, "channel {channel} is in use by another program; close it first")
            }
            Self::BitRate { bit_rate, available } => {
                let available: Vec<_> = available.iter().map(u32::to_string).collect();
                write!(f, "{bit_rate} bit/s not available; expected {}", available.join(", "))
            }
            Self::NotListenOnly { vendor, channel } => write!(
                f,
                "channel {channel} has no listen-only mode; other modes are not used because they acknowledge \
                 frames; {}",
                vendor.listen_only_remedy()
            ),
            Self::Driver { function, reason } => write!(f, "{function}: {reason}"),
        }
    }
}

impl std::error::Error for OpenError {}

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
            vendor: Vendor::Pcan,
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
