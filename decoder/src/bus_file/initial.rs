//! Values of objects, and states of nodes before the first frame.

use serde::Deserialize;
use toml::Spanned;

use super::value::{ObjectValue, TypedEntryValue, encode_value};
use super::written::{TextProblem, parse_address};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::j1939::J1939Name;

/// NMT states that a bus file can name.
const STATES: [NmtState; 4] =
    [NmtState::Initialising, NmtState::Stopped, NmtState::Operational, NmtState::PreOperational];

/// How a value of an object was learnt before the capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ValueOrigin {
    /// Written by SDO.
    Download,
    /// Read by SDO.
    Upload,
    /// Sent in a PDO.
    Pdo,
}

impl ValueOrigin {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Download => "download",
            Self::Upload => "upload",
            Self::Pdo => "pdo",
        }
    }
}

/// What a value of an object is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ValueRole {
    /// The present value.
    #[default]
    Effective,
    /// Written, effective after a restart.
    Pending,
    /// Value in non-volatile memory, to which the object returns at a restart.
    Stored,
    /// Last value in a PDO, which the next PDO replaces.
    Process,
}

/// Value of an object of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InitialValue {
    /// Node with the object.
    pub node: NodeId,
    /// The object.
    pub address: ObjectAddress,
    /// The value.
    pub value: ObjectValue,
    /// Whether the value is in effect.
    pub role: ValueRole,
    /// `None`: stated by the user, valid until the capture contains another value.
    pub origin: Option<ValueOrigin>,
    /// Whether the value may have changed since.
    pub is_assumed: bool,
    /// Frame of an earlier capture that contains the value.
    pub frame: Option<u64>,
}

/// State of a node before the first frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InitialState {
    /// NMT state.
    pub nmt: Option<InitialNmtState>,
    /// Whether the node was silent for longer than its monitoring time.
    pub is_lost: bool,
    /// Whether all written parameters are stored (object 1010).
    pub is_saved: bool,
    /// EMCY codes raised and not cleared.
    pub errors: Vec<u16>,
    /// NMT reset to which the node did not respond with a boot-up yet.
    pub reset: Option<PendingReset>,
    /// NAME of a J1939 device.
    pub name: Option<J1939Name>,
    /// Reported states of the state machines of the device, in the order of its profile; empty for an unknown one.
    pub device: Vec<String>,
}

/// NMT state of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InitialNmtState {
    /// The state.
    pub state: NmtState,
    /// The node did not confirm the state of a command.
    pub is_assumed: bool,
    /// The node reported the state by heartbeat or guarding; a PDO does not override it.
    pub is_reported: bool,
}

/// NMT reset command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PendingReset {
    /// Reset communication.
    Communication,
    /// Reset node.
    Node,
}

impl PendingReset {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Communication => "communication",
            Self::Node => "node",
        }
    }
}

impl InitialValue {
    /// Value stated by the user.
    pub const fn new(node: NodeId, address: ObjectAddress, value: ObjectValue) -> Self {
        Self {
            node,
            address,
            value,
            role: ValueRole::Effective,
            origin: None,
            is_assumed: false,
            frame: None,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AuthoredObject {
    #[serde(rename = "object")]
    address: Spanned<String>,
    #[serde(default)]
    value: Option<Spanned<TypedEntryValue>>,
    #[serde(default)]
    data: Option<Spanned<String>>,
    #[serde(default)]
    origin: Option<ValueOrigin>,
    #[serde(default)]
    frame: Option<u64>,
    #[serde(default)]
    assumed: bool,
    #[serde(default)]
    pending: bool,
    #[serde(default)]
    stored: bool,
    #[serde(default)]
    process: bool,
}

impl AuthoredObject {
    pub(super) fn check_object(self, node: NodeId) -> Result<InitialValue, TextProblem> {
        let span = self.address.span();
        let address = parse_address(&self.address)?;
        let value = match (self.value, self.data) {
            (Some(value), None) => {
                let span = value.span();
                encode_value(address, value.into_inner()).map_err(|message| (span, message))?
            }
            (None, Some(data)) => parse_hex(data.get_ref()).map(ObjectValue::Bytes).ok_or_else(|| {
                (
                    data.span(),
                    "invalid data; expected pairs of hex digits, such as \"10 00 41 60\"".to_owned(),
                )
            })?,
            (Some(_), Some(data)) => {
                return Err((data.span(), "value and data are both present; remove one".into()));
            }
            (None, None) => return Err((span.clone(), "value and data are missing; expected one".into())),
        };
        let role = match (self.pending, self.stored, self.process) {
            (false, false, false) => ValueRole::Effective,
            (true, false, false) => ValueRole::Pending,
            (false, true, false) => ValueRole::Stored,
            (false, false, true) => ValueRole::Process,
            _ => {
                let message = "at most one of pending, stored and process can be true; use several entries";
                return Err((span, message.to_owned()));
            }
        };
        let Self { origin, frame, assumed: is_assumed, .. } = self;
        Ok(InitialValue { node, address, value, role, origin, is_assumed, frame })
    }
}

fn parse_hex(text: &str) -> Option<Vec<u8>> {
    let digits: Vec<u8> = text.bytes().filter(|byte| *byte != b' ').collect();
    let pair = |pair: &[u8]| match pair {
        [high, low] if high.is_ascii_hexdigit() && low.is_ascii_hexdigit() => {
            u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()
        }
        _ => None,
    };
    digits.chunks(2).map(pair).collect()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AuthoredState {
    #[serde(default)]
    nmt: Option<Spanned<String>>,
    #[serde(default)]
    assumed: bool,
    #[serde(default)]
    reported: bool,
    #[serde(default)]
    lost: bool,
    #[serde(default)]
    saved: bool,
    #[serde(default)]
    errors: Vec<Spanned<String>>,
    #[serde(default)]
    reset: Option<PendingReset>,
    #[serde(default)]
    name: Option<Spanned<String>>,
    #[serde(default)]
    device: Vec<String>,
}

impl AuthoredState {
    pub(super) fn check_state(state: Spanned<Self>, node: NodeId) -> Result<InitialState, TextProblem> {
        let span = state.span();
        let Self { nmt, assumed, reported, lost, saved, errors, reset, name, device } = state.into_inner();
        let is_of_canopen =
            nmt.is_some() || assumed || lost || saved || !errors.is_empty() || reset.is_some();
        if node.canopen().is_none() && is_of_canopen {
            return Err((span, "state of a J1939 address; expected name and device only".to_owned()));
        }
        if let Some(name) = name.as_ref().filter(|_| node.canopen().is_some()) {
            return Err((name.span(), "NAME of a CANopen node; expected a J1939 address".to_owned()));
        }
        let name = name.map(|text| {
            let digits = text.get_ref().strip_prefix("0x").filter(|digits| digits.len() == 16);
            let is_hex = |digits: &&str| digits.bytes().all(|byte| byte.is_ascii_hexdigit());
            let number = digits.filter(is_hex).and_then(|digits| u64::from_str_radix(digits, 16).ok());
            let wrong = || (text.span(), "invalid NAME; expected 0x and 16 hex digits".to_owned());
            number.map(J1939Name).ok_or_else(wrong)
        });
        let nmt = nmt.map(|name| {
            let known = STATES.into_iter().find(|state| state.name() == name.get_ref());
            let given = |state| InitialNmtState { state, is_assumed: assumed, is_reported: reported };
            known.map(given).ok_or_else(|| {
                let all = STATES.map(NmtState::name).join(", ");
                (name.span(), format!("unknown NMT state; expected one of {all}"))
            })
        });
        let code = |text: Spanned<String>| {
            let digits = text.get_ref();
            let is_code = digits.len() == 4 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
            let code = is_code.then(|| u16::from_str_radix(digits, 16).ok()).flatten();
            code.ok_or_else(|| (text.span(), "invalid EMCY code; expected four hex digits".to_owned()))
        };
        Ok(InitialState {
            nmt: nmt.transpose()?,
            is_lost: lost,
            is_saved: saved,
            errors: errors.into_iter().map(code).collect::<Result<_, _>>()?,
            reset,
            name: name.transpose()?,
            device,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus_file::BusFile;

    const NODE: NodeId = NodeId::Canopen(5);

    #[test]
    fn values_with_origin_and_role() {
        let file = BusFile::parse(
            "[[node.5.object]]\nobject = \"1017:00\"\nvalue = 500\norigin = \"upload\"\nframe = 96\n\
             [[node.5.object]]\nobject = \"1017:00\"\nvalue = 1000\norigin = \"download\"\npending = true\n\
             [[node.5.object]]\nobject = \"1017:00\"\ndata = \"E8 03\"\nstored = true\nassumed = true\n",
        )
        .unwrap();
        let entry = |bytes: [u8; 2]| {
            InitialValue::new(NODE, ObjectAddress::new(0x1017, 0), ObjectValue::Bytes(bytes.to_vec()))
        };
        let [read, written, stored] = file.everywhere.objects.try_into().unwrap();
        assert_eq!(
            read,
            InitialValue { origin: Some(ValueOrigin::Upload), frame: Some(96), ..entry([0xF4, 1]) }
        );
        let origin = Some(ValueOrigin::Download);
        assert_eq!(written, InitialValue { origin, role: ValueRole::Pending, ..entry([0xE8, 3]) });
        assert_eq!(stored, InitialValue { role: ValueRole::Stored, is_assumed: true, ..entry([0xE8, 3]) });
    }

    #[test]
    fn states_of_nodes() {
        let file = BusFile::parse(
            "[node.5.state]\nnmt = \"pre-operational\"\nassumed = true\nerrors = [\"8130\", \"FF01\"]\nsaved = true\ndevice = [\"\", \"ACTIVE\"]\n\
             [bus.can0.node.6.state]\nlost = true\nreset = \"node\"\n\
             [node.\"sa:0x85\".state]\nname = \"0xA000820000200001\"\n",
        )
        .unwrap();
        let state = InitialState {
            nmt: Some(InitialNmtState {
                state: NmtState::PreOperational,
                is_assumed: true,
                is_reported: false,
            }),
            is_saved: true,
            errors: vec![0x8130, 0xFF01],
            device: vec![String::new(), "ACTIVE".to_owned()],
            ..InitialState::default()
        };
        let named = InitialState { name: Some(J1939Name(0xA000_8200_0020_0001)), ..InitialState::default() };
        assert_eq!(file.everywhere.states, [(NODE, state), (NodeId::J1939(0x85), named)]);
        let reset = Some(PendingReset::Node);
        let lost = InitialState { is_lost: true, reset, ..InitialState::default() };
        assert_eq!(file.buses[0].1.states, [(NodeId::Canopen(6), lost)]);
    }

    #[track_caller]
    fn fails(text: &str, message: &str) {
        let error = BusFile::parse(text).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }

    #[test]
    fn errors_name_their_place() {
        fails(
            "[node.5.state]\nnmt = \"running\"",
            "2:7: unknown NMT state; expected one of initialising, stopped, operational, pre-operational",
        );
        fails("[node.5.state]\nerrors = [\"81\"]", "2:11: invalid EMCY code; expected four hex digits");
        fails(
            "[node.\"sa:5\".state]\nlost = true",
            "state of a J1939 address; expected name and device only",
        );
        fails("[node.\"sa:5\".state]\nname = \"0xA0\"", "2:8: invalid NAME; expected 0x and 16 hex digits");
        fails(
            "[node.5.state]\nname = \"0xA000820000200001\"",
            "2:8: NAME of a CANopen node; expected a J1939 address",
        );
        let object = "[[node.5.object]]\nobject = \"1017:00\"\nvalue = 1\n";
        fails(&format!("{object}origin = \"guess\""), "4:10: unknown variant `guess`");
        fails(
            &format!("{object}pending = true\nstored = true"),
            "2:10: at most one of pending, stored and process can be true; use several entries",
        );
    }
}
