//! Vendors with a driver library.

/// A vendor with a driver library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Vendor {
    /// PEAK-System, PCAN-Basic.
    Pcan,
    /// Kvaser, CANlib.
    Kvaser,
}

impl Vendor {
    /// Name of the company.
    pub const fn maker(self) -> &'static str {
        match self {
            Self::Pcan => "PEAK",
            Self::Kvaser => "Kvaser",
        }
    }

    /// Environment variable with the path of a library in place of the installed one.
    pub const fn variable(self) -> &'static str {
        match self {
            Self::Pcan => "COBSCOPE_PCAN_LIBRARY",
            Self::Kvaser => "COBSCOPE_KVASER_LIBRARY",
        }
    }

    /// Package of the vendor that contains the library.
    pub const fn package(self) -> &'static str {
        match (self, cfg!(windows)) {
            (Self::Pcan, true) => "\"PEAK-System Device Driver Setup\" with the PCAN-Basic API",
            (Self::Pcan, false) => "\"PCAN-Basic API for Linux\" and its driver pcan (peak-system.com)",
            (Self::Kvaser, true) => "\"Kvaser Drivers for Windows\"",
            (Self::Kvaser, false) => "\"Kvaser Linux Drivers and SDK\" (linuxcan, kvaser.com)",
        }
    }

    pub(crate) const fn windows_library(self) -> &'static str {
        match self {
            Self::Pcan => "PCANBasic.dll",
            Self::Kvaser => "canlib32.dll",
        }
    }

    pub(crate) const fn linux_library(self) -> &'static str {
        match self {
            Self::Pcan => "libpcanbasic.so",
            Self::Kvaser => "libcanlib.so",
        }
    }
}
