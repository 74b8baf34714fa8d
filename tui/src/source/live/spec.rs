//! Syntax of sources on the command line.
//!
//! ```text
//! can0   can0,123:7FF,400~7F0,#FFFFFFFF   any       SocketCAN, with candump's filters
//! slcan:/dev/ttyACM0@500000                          a serial adapter (Lawicel)
//! pcan:USB1@500k   kvaser:0@250k                     an adapter with the driver of its vendor
//! gs_usb:@500k   gs_usb:0042001A@500k                 an adapter with the gs_usb protocol
//! socketcand://host:29536/can0                       a server
//! -                                                  text on standard input
//! machine.trc                                        a growing file, with --follow
//! ```

use std::path::PathBuf;
use std::str::FromStr;

/// Maximum length of an interface name (IFNAMSIZ without its end mark).
const LONGEST_NAME: usize = 15;

/// A source with a serial port, for messages.
pub const SERIAL_EXAMPLE: &str =
    if cfg!(windows) { "slcan:COM3@500000" } else { "slcan:/dev/ttyACM0@500000" };

/// Flags of a filter identifier in linux/can.h: 29 bits, inverted; then the error classes.
const EXTENDED: u32 = 0x8000_0000;
const INVERTED: u32 = 0x2000_0000;
const ERROR: u32 = 0x2000_0000;

/// Number of digits of a 29-bit identifier; fewer digits mean 11 bits.
const EXTENDED_DIGITS: usize = 8;

/// A parsed source.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourceSpec {
    /// A CAN interface of this computer, or `any`.
    SocketCan(InterfaceSpec),
    /// A serial adapter, and the bit rate to set in bit/s.
    Slcan { device: String, bit_rate: Option<u32> },
    /// An adapter with the driver of its vendor, or with the gs_usb protocol.
    Adapter(AdapterSpec),
    /// A bus of a socketcand server.
    Socketcand { address: String, bus: String },
    /// Standard input.
    Stdin,
    /// A growing file.
    File(PathBuf),
}

/// A channel of an adapter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterSpec {
    /// Kind of adapter: `pcan`, `kvaser`, `gs_usb`.
    pub prefix: &'static str,
    /// Channel, or serial number; empty for the only gs_usb adapter.
    pub channel: String,
    /// Bit rate to set in bit/s.
    pub bit_rate: u32,
}

/// Prefixes of adapters with the example of a source.
const ADAPTERS: [(&str, &str); 3] =
    [("pcan", "pcan:USB1@500k"), ("kvaser", "kvaser:0@500k"), ("gs_usb", "gs_usb:@500k")];

/// A CAN interface with its frame filters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InterfaceSpec {
    /// Name of the interface; `any` for all interfaces.
    pub name: String,
    /// A frame must match any of these filters; all frames if empty.
    pub filters: Vec<IdFilter>,
    /// A frame must match all filters.
    pub is_joined: bool,
    /// Mask of the error frame classes.
    pub errors: u32,
}

/// An identifier filter in the format of the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdFilter {
    /// Identifier with its flags; `CAN_INV_FILTER` inverts the filter.
    pub id: u32,
    /// Bits of the identifier that must match.
    pub mask: u32,
}

impl FromStr for SourceSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "-" {
            return Ok(Self::Stdin);
        }
        if let Some(rest) = text.strip_prefix("slcan:") {
            return parse_slcan(rest);
        }
        if let Some(rest) = text.strip_prefix("socketcand://") {
            return parse_socketcand(rest);
        }
        let prefixed = |prefix: &str| text.strip_prefix(prefix)?.strip_prefix(':');
        for (prefix, example) in ADAPTERS {
            if let Some(rest) = prefixed(prefix) {
                return parse_adapter(prefix, rest, example);
            }
        }
        if text.contains(['/', '\\', '.']) || has_drive(text) || std::path::Path::new(text).is_file() {
            return Ok(Self::File(text.into()));
        }
        parse_interface(text).map(Self::SocketCan)
    }
}

/// Whether a path of Windows starts with a drive: `C:run`. Names of other sources have more than one letter before the colon.
fn has_drive(text: &str) -> bool {
    matches!(text.as_bytes(), [drive, b':', _, ..] if drive.is_ascii_alphabetic())
}

fn parse_slcan(text: &str) -> Result<SourceSpec, String> {
    let (device, rate) = match text.rsplit_once('@') {
        Some((device, rate)) => (device, Some(rate)),
        None => (text, None),
    };
    if device.is_empty() {
        return Err(format!("found no device, expected {SERIAL_EXAMPLE}"));
    }
    Ok(SourceSpec::Slcan { device: device.into(), bit_rate: rate.map(bit_rate).transpose()? })
}

/// Channel and bit rate of an adapter. In listen-only mode a wrong rate is not noticed, so none is assumed.
fn parse_adapter(prefix: &'static str, text: &str, example: &str) -> Result<SourceSpec, String> {
    let has_default = prefix == "gs_usb";
    match text.rsplit_once('@') {
        Some((channel, rate)) if has_default || !channel.is_empty() => Ok(SourceSpec::Adapter(AdapterSpec {
            prefix,
            channel: channel.into(),
            bit_rate: bit_rate(rate)?,
        })),
        None if has_default || !text.is_empty() => Err(format!("found no bit rate, expected {example}")),
        _ => Err(format!("found no channel, expected {example}")),
    }
}

/// `500000`, `500k`, `1M`, in bit/s.
fn bit_rate(text: &str) -> Result<u32, String> {
    let (digits, unit) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (text.get(..at), 1_000),
        Some((at, 'M')) => (text.get(..at), 1_000_000),
        _ => (Some(text), 1),
    };
    let is_number = |digits: &&str| digits.bytes().all(|byte| byte.is_ascii_digit());
    let number = digits.filter(is_number).and_then(|digits| digits.parse::<u32>().ok());
    number
        .and_then(|number| number.checked_mul(unit))
        .filter(|rate| *rate > 0)
        .ok_or_else(|| format!("found {text:?} after @, expected a bit rate such as 500000, 500k or 1M"))
}

fn parse_socketcand(text: &str) -> Result<SourceSpec, String> {
    match text.split_once('/') {
        Some((address, bus)) if !address.is_empty() && !bus.is_empty() => {
            Ok(SourceSpec::Socketcand { address: address.into(), bus: bus.into() })
        }
        _ => Err("expected server and bus, as in socketcand://host:29536/can0".into()),
    }
}

/// What is before the colon of all sources that have one.
fn source_prefixes() -> Vec<&'static str> {
    let adapters = ADAPTERS.iter().map(|(prefix, _)| *prefix);
    ["slcan"].into_iter().chain(adapters).chain(["socketcand"]).collect()
}

/// `can0,123:7FF,400~7F0,#FFFFFFFF,j`, the syntax of candump.
fn parse_interface(text: &str) -> Result<InterfaceSpec, String> {
    let mut parts = text.split(',');
    let name = parts.next().unwrap_or_default();
    // The kernel permits no colon in the name of an interface (dev_valid_name): the prefix of a source was meant.
    if let Some((prefix, _)) = name.split_once(':').filter(|(prefix, _)| !prefix.is_empty()) {
        return Err(format!("found {prefix:?} before the colon, expected {}", source_prefixes().join(", ")));
    }
    if let Some((name, rate)) = name.split_once('@') {
        return Err(format!(
            "found @{rate}, expected {name:?}: the system sets the bit rate of an interface"
        ));
    }
    if name.is_empty() || name.len() > LONGEST_NAME {
        return Err(format!("found {name:?}, expected an interface name of 1 to {LONGEST_NAME} characters"));
    }
    let mut spec =
        InterfaceSpec { name: name.into(), filters: Vec::new(), is_joined: false, errors: u32::MAX >> 3 };
    for part in parts {
        let wrong = || format!("found {part:?}, expected ID:MASK, ID~MASK, #ERRORMASK or j, in hex digits");
        let hex = |digits: &str| u32::from_str_radix(digits, 16).map_err(|_| wrong());
        if part.eq_ignore_ascii_case("j") {
            spec.is_joined = true;
        } else if let Some(mask) = part.strip_prefix('#') {
            spec.errors = hex(mask)? & (u32::MAX >> 3);
        } else {
            let (id, mask, inverted) = match (part.split_once(':'), part.split_once('~')) {
                (Some((id, mask)), _) => (id, mask, 0),
                (_, Some((id, mask))) => (id, mask, INVERTED),
                _ => return Err(wrong()),
            };
            let extended = if id.len() == EXTENDED_DIGITS { EXTENDED } else { 0 };
            spec.filters.push(IdFilter { id: hex(id)? | extended | inverted, mask: hex(mask)? & !ERROR });
        }
    }
    Ok(spec)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(text: &str) -> Result<SourceSpec, String> {
        text.parse()
    }

    /// As in candump.c: eight digits are 29 bits, error bits of a mask are ignored, `~` inverts.
    #[test]
    fn filters_of_candump() {
        let Ok(SourceSpec::SocketCan(found)) = spec("can0,123:7FF,400~7F0,18FEF180:1FFFFFFF,#FFFFFFFF,j")
        else {
            panic!("an interface")
        };
        assert_eq!((found.name.as_str(), found.is_joined, found.errors), ("can0", true, 0x1FFF_FFFF));
        let filters: Vec<_> = found.filters.iter().map(|filter| (filter.id, filter.mask)).collect();
        assert_eq!(
            filters,
            [(0x123, 0x7FF), (0x2000_0400, 0x7F0), (0x98FE_F180, 0x1FFF_FFFF)],
            "an inverted filter has CAN_INV_FILTER, which is 0x20000000"
        );
        let Ok(SourceSpec::SocketCan(found)) = spec("any,#0") else { panic!("an interface") };
        assert_eq!((found.name.as_str(), found.errors), ("any", 0));
        assert!(found.filters.is_empty());
    }

    #[test]
    fn other_sources() {
        let slcan = |device: &str, bit_rate| Ok(SourceSpec::Slcan { device: device.into(), bit_rate });
        assert_eq!(spec("slcan:/dev/ttyACM0@500000"), slcan("/dev/ttyACM0", Some(500_000)));
        assert_eq!(spec("slcan:COM3@500k"), slcan("COM3", Some(500_000)));
        assert_eq!(spec("slcan:COM3"), slcan("COM3", None));
        let server = SourceSpec::Socketcand { address: "box:29536".into(), bus: "can0".into() };
        assert_eq!(spec("socketcand://box:29536/can0"), Ok(server));
        assert_eq!(spec("-"), Ok(SourceSpec::Stdin));
        for path in
            ["logs/machine.trc", r"C:\run.log", r"\\server\share\run.log", "C:run.log", "c:run", r"C:\run"]
        {
            assert_eq!(spec(path), Ok(SourceSpec::File(path.into())));
        }
    }

    #[test]
    fn adapters_have_a_channel_and_a_bit_rate() {
        let adapter = |prefix, channel: &str, bit_rate| {
            Ok(SourceSpec::Adapter(AdapterSpec { prefix, channel: channel.into(), bit_rate }))
        };
        assert_eq!(spec("pcan:USB1@500k"), adapter("pcan", "USB1", 500_000));
        assert_eq!(spec("kvaser:0@1M"), adapter("kvaser", "0", 1_000_000));
        assert_eq!(spec("kvaser:1@83333"), adapter("kvaser", "1", 83_333));
        assert_eq!(spec("gs_usb:@250k"), adapter("gs_usb", "", 250_000));
        assert_eq!(spec("gs_usb:0042001A/1@250k"), adapter("gs_usb", "0042001A/1", 250_000));
        let error = |text: &str| spec(text).unwrap_err();
        assert_eq!(error("pcan:USB1"), "found no bit rate, expected pcan:USB1@500k");
        assert_eq!(error("kvaser:@250k"), "found no channel, expected kvaser:0@500k");
        assert_eq!(error("kvaser:"), "found no channel, expected kvaser:0@500k");
        assert_eq!(error("gs_usb:"), "found no bit rate, expected gs_usb:@500k");
        for rate in ["", "k", "0", "fast", "+5", "5000M", "99999999999", "1m"] {
            let expected = format!("found {rate:?} after @, expected a bit rate such as 500000, 500k or 1M");
            assert_eq!(error(&format!("pcan:USB1@{rate}")), expected);
        }
    }

    #[test]
    fn a_name_is_no_unknown_adapter_and_has_no_bit_rate() {
        let known = "expected slcan, pcan, kvaser, gs_usb, socketcand";
        for (text, prefix) in
            [("ixxat:0@500k", "ixxat"), ("PCAN:USB1@500k", "PCAN"), ("C:", "C"), ("can0:1,123:7FF", "can0")]
        {
            assert_eq!(spec(text), Err(format!("found {prefix:?} before the colon, {known}")), "{text}");
        }
        let rate = "found @500k, expected \"can0\": the system sets the bit rate of an interface";
        assert_eq!(spec("can0@500k"), Err(rate.into()));
        assert!(spec("can0,123:7FF").is_ok());
    }

    #[test]
    fn errors_are_reported() {
        for text in ["", "can0,", "can0,123", "can0,123:", "can0,xyz:7FF", "can0,#", "averyverylongname"] {
            assert!(spec(text).is_err(), "{text}");
        }
        for text in ["slcan:", "slcan:/dev/ttyACM0@fast", "socketcand://box", "socketcand:///can0"] {
            assert!(spec(text).is_err(), "{text}");
        }
    }
}
