//! Conditions and triggers of profiles as text, for reports on rules that were not exercised.

use std::fmt;

use super::condition::{
    DeviceCondition, DeviceConditions, ExpectedValue, ProfileTrigger, ProfileTriggers, SetTrigger,
};
use crate::profile::object::NumberList;

impl fmt::Display for NumberList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::One(one) => write!(f, "{one}"),
            Self::Any(any) => f.write_str(&join_alternatives(any)),
        }
    }
}

/// `1, 2 or 3`.
fn join_alternatives(all: &[impl fmt::Display]) -> String {
    let mut text = String::new();
    for (place, one) in all.iter().enumerate() {
        let joint = match place {
            0 => "",
            _ if place.saturating_add(1) == all.len() => " or ",
            _ => ", ",
        };
        text.push_str(joint);
        text.push_str(&one.to_string());
    }
    text
}

/// `5B00:00 = 1`, with a mask `5B00:00 & Fh = 1`.
fn comparison_text(object: &dyn fmt::Display, mask: u64, values: &NumberList, negated: bool) -> String {
    let masked = if mask == u64::MAX { String::new() } else { format!(" & {mask:X}h") };
    let sign = if negated { "not" } else { "=" };
    format!("{object}{masked} {sign} {values}")
}

impl fmt::Display for DeviceCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nmt(name) => write!(f, "NMT state {}", name.state().name()),
            Self::Object { object, mask, values, negated } => {
                f.write_str(&comparison_text(&object.object, *mask, values, *negated))
            }
            Self::Inside { object, range: [least, most] } => {
                write!(f, "{} = {least} to {most}", object.object)
            }
            Self::Known(object) => write!(f, "a value of {} in the capture", object.object),
            Self::State(states) => write!(f, "state {}", join_alternatives(states)),
            Self::Sync => f.write_str("SYNC of the node"),
            Self::NoError => f.write_str("no active error"),
            Self::NoProcedure => f.write_str("no running procedure"),
            Self::Younger(limit) => write!(f, "a PDO within {limit} ms"),
            Self::Invisible => f.write_str("a condition that is not visible on the bus"),
            Self::Other(conditions) => write!(f, "another node with {conditions}"),
            Self::Alone => f.write_str("no other node on the bus"),
        }
    }
}

impl fmt::Display for DeviceConditions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all: Vec<_> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&all.join(", "))
    }
}

impl fmt::Display for ExpectedValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Numbers(numbers) => write!(f, "{numbers}"),
            Self::Text(text) => write!(f, "'{text}'"),
        }
    }
}

impl fmt::Display for SetTrigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.values {
            Some(values) => {
                f.write_str(&comparison_text(&self.object.object, self.mask, values, self.negated))
            }
            None => write!(f, "a value of {}", self.object.object),
        }
    }
}

impl fmt::Display for ProfileTrigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Write(of, None) => write!(f, "a write to {}", of.object),
            Self::Write(of, Some(value)) => write!(f, "a write of {value} to {}", of.object),
            Self::Read(of, None) => write!(f, "a read of {}", of.object),
            Self::Read(of, Some(value)) => write!(f, "a read of {} = {value}", of.object),
            Self::Bit(bit, is_set) => {
                write!(
                    f,
                    "bit {} of {} {}",
                    bit.bit,
                    bit.object.object,
                    if *is_set { "set" } else { "cleared" }
                )
            }
            Self::Pdo(name) => write!(f, "{name}"),
            Self::Message(message) => f.write_str(&message.name),
            Self::Dtc(None) => f.write_str("a fault in DM1"),
            Self::Dtc(Some((spn, fmi))) => write!(f, "SPN {spn} FMI {fmi} in DM1"),
            Self::Nmt(command) => write!(f, "NMT {command}"),
            Self::State(states) => write!(f, "state {}", join_alternatives(states)),
            Self::Sync => f.write_str("SYNC of the node"),
            Self::Emcy(code) => write!(f, "EMCY {code:04X}"),
            Self::Boot => f.write_str("a start of the node"),
            Self::PowerOn => f.write_str("a start without an NMT reset"),
            Self::Set(set) => write!(f, "{set}"),
            Self::Shows(shows) => write!(f, "{shows} from the device"),
            Self::Writes(range) => write!(f, "a write to {range}"),
            Self::Lss(lss) => write!(f, "LSS {}", lss.service),
            Self::Guard => f.write_str("a guarding request"),
            Self::Reports(states) => {
                write!(f, "a heartbeat or guarding response {}", join_alternatives(states))
            }
        }
    }
}

impl fmt::Display for ProfileTriggers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&join_alternatives(&self.0))
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    struct Both {
        on: ProfileTriggers,
        #[serde(rename = "while")]
        during: DeviceConditions,
    }

    #[test]
    fn triggers_and_conditions_read_like_their_profile() {
        let both: Both = toml::from_str(
            "on = [{ pdo = \"RPDO1\" }, { write = \"1010:01\", equals = \"save\" }]\n\
             while = [{ nmt = \"operational\" }, { object = \"1800:02\", equals = [254, 255] }]",
        )
        .unwrap();
        assert_eq!(both.on.to_string(), "RPDO1 or a write of 'save' to 1010:01");
        assert_eq!(both.during.to_string(), "NMT state operational, 1800:02 = 254 or 255");
    }
}
