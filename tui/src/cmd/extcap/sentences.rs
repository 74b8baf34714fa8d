//! Sentences by which an extcap program describes its interfaces.

use std::fmt::Write as _;

use crate::source::live::socketcan;

/// Start of the names of all interfaces.
const PREFIX: &str = "cobscope-";

/// Name of the interface for files.
const FILE: &str = "file";

/// Name of the interface for live sources.
const SOURCE: &str = "source";

/// Link type of all interfaces: LINKTYPE_CAN_SOCKETCAN.
pub(super) const LINK_TYPES: &str = "dlt {number=227}{name=LINKTYPE_CAN_SOCKETCAN}{display=SocketCAN, with the meaning of each frame as its comment}\n";

/// Options of all interfaces, after those of their own.
const COMMON: [&str; 3] = [
    "{call=--node}{display=Profiles of nodes}{type=string}{tooltip=5=rexroth-sydfec 2=wandfluh-md2; the list is printed by: cobscope profiles list}{group=Devices}",
    "{call=--bus}{display=Bus file}{type=fileselect}{mustexist=true}{tooltip=Names, nodes, EDS files and identifiers of a machine}{group=Devices}",
    "{call=--dbc}{display=DBC file}{type=fileselect}{mustexist=true}{tooltip=Database of messages}{group=Devices}",
];

/// An interface in Wireshark's list.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum ExtcapInterface {
    /// A capture in any format.
    File,
    /// Any live source.
    Source,
    /// A CAN interface of this computer.
    Can(String),
}

impl ExtcapInterface {
    /// The interface with a name.
    pub(super) fn find_interface(name: &str) -> Option<Self> {
        Some(match name.strip_prefix(PREFIX)? {
            FILE => Self::File,
            SOURCE => Self::Source,
            can => Self::Can(can.strip_prefix("can:")?.to_owned()),
        })
    }

    /// Sentences of its options.
    pub(super) fn option_sentences(&self) -> String {
        let own = match self {
            Self::File => {
                "{call=--file}{display=Capture}{type=fileselect}{mustexist=true}{required=true}{tooltip=candump, BLF, \
                 ASC, TRC, MDF4, MCAP, pcap, CSV and more; the format is detected}"
            }
            Self::Source => {
                "{call=--source}{display=Source}{type=string}{required=true}{tooltip=slcan:/dev/ttyACM0@500000, \
                 socketcand://HOST/can0, can0,123:7FF, or a growing file}"
            }
            Self::Can(_) => "",
        };
        let all = std::iter::once(own).filter(|own| !own.is_empty()).chain(COMMON);
        let mut text = String::new();
        for (number, option) in all.enumerate() {
            let _ = writeln!(text, "arg {{number={number}}}{option}");
        }
        text
    }
}

/// Sentences of the program and its interfaces.
pub(super) fn interface_sentences() -> String {
    let mut text = format!(
        "extcap {{version={}}}{{help=https://crates.io/crates/cobscope}}{{display=cobscope}}\n\
         interface {{value={PREFIX}{FILE}}}{{display=cobscope: a capture in any format}}\n\
         interface {{value={PREFIX}{SOURCE}}}{{display=cobscope: slcan, socketcand and other live sources}}\n",
        env!("CARGO_PKG_VERSION")
    );
    for interface in socketcan::all() {
        let name = plain_name(&interface.name);
        let _ = writeln!(text, "interface {{value={PREFIX}can:{name}}}{{display=cobscope: {name}, decoded}}");
    }
    text
}

/// A name without the characters that end a sentence.
fn plain_name(name: &str) -> String {
    name.chars().filter(|letter| !letter.is_control() && !"{}".contains(*letter)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_interfaces() {
        assert_eq!(ExtcapInterface::find_interface("cobscope-file"), Some(ExtcapInterface::File));
        assert_eq!(ExtcapInterface::find_interface("cobscope-source"), Some(ExtcapInterface::Source));
        assert_eq!(
            ExtcapInterface::find_interface("cobscope-can:can0"),
            Some(ExtcapInterface::Can("can0".into()))
        );
        assert_eq!(
            [ExtcapInterface::find_interface("can0"), ExtcapInterface::find_interface("cobscope-x")],
            [None, None]
        );
    }

    #[test]
    fn options_are_numbered() {
        let options = ExtcapInterface::File.option_sentences();
        assert!(
            options.starts_with("arg {number=0}{call=--file}")
                && options.contains("\narg {number=3}{call=--dbc}")
        );
        assert!(
            ExtcapInterface::Can("can0".into()).option_sentences().starts_with("arg {number=0}{call=--node}")
        );
    }
}
