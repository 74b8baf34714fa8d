//! File names of captures of triggers: `2026-11-22_073051.250_node2_guard-late.pcapng`.

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::wire::NodeId;
use jiff::tz::TimeZone;

use super::super::trigger::CaptureTrigger;

/// Maximum length of the cause in a name, in bytes.
const LONGEST_CAUSE: usize = 60;

/// Name of the capture of a trigger, without suffix: time in the zone `zone`, node and cause. It contains letters,
/// digits, `.`, `-` and `_` only.
pub(super) fn file_stem(trigger: &CaptureTrigger, zone: &TimeZone) -> String {
    let time = trigger.time.and_then(|time| day_and_time(time, zone)).unwrap_or_else(|| "no-time".to_owned());
    let node = match trigger.node {
        Some(NodeId::Canopen(id)) => format!("_node{id}"),
        Some(NodeId::J1939(address)) => format!("_sa{address:02X}"),
        None => String::new(),
    };
    format!("{time}{node}_{}", plain_cause(&trigger.cause))
}

/// `2026-11-22_073051.250`; None outside the years that a date can have.
fn day_and_time(time: Timestamp, zone: &TimeZone) -> Option<String> {
    let time = jiff::Timestamp::from_nanosecond(i128::from(time.0)).ok()?;
    Some(time.to_zoned(zone.clone()).strftime("%Y-%m-%d_%H%M%S.%3f").to_string())
}

/// A cause with letters, digits and `-` only.
fn plain_cause(cause: &str) -> String {
    let text: String =
        cause.chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '-' }).collect();
    text.get(..LONGEST_CAUSE).unwrap_or(&text).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trigger(cause: &str, node: Option<NodeId>, time: Option<i64>) -> CaptureTrigger {
        CaptureTrigger {
            bus: "../can0".to_owned(),
            node,
            subject: String::new(),
            cause: cause.to_owned(),
            text: "../../etc/passwd".to_owned(),
            time: time.map(Timestamp),
            first_frame: 1,
            last_frame: 2,
        }
    }

    #[test]
    fn time_node_and_cause() {
        let name = |cause, node, time| file_stem(&trigger(cause, node, time), &TimeZone::UTC);
        let time = Some(1_700_000_000_123_456_789);
        assert_eq!(name("emcy", Some(NodeId::Canopen(2)), time), "2023-11-14_221320.123_node2_emcy");
        assert_eq!(name("dtc", Some(NodeId::J1939(0x80)), time), "2023-11-14_221320.123_sa80_dtc");
        assert_eq!(name("bus-load", None, time), "2023-11-14_221320.123_bus-load");
        assert_eq!(name("emcy", None, None), "no-time_emcy");
        assert_eq!(name("emcy", None, Some(i64::MIN)), "1677-09-21_001243.145_emcy");
    }

    #[test]
    fn text_of_users_and_buses_cannot_leave_the_folder() {
        let name = |cause: &str| file_stem(&trigger(cause, None, None), &TimeZone::UTC);
        assert_eq!(name("rexroth-sydfec:eeprom-wear"), "no-time_rexroth-sydfec-eeprom-wear");
        assert_eq!(name("../a b\0\u{1b}[2Jé$(rm)"), "no-time_---a-b---2J---rm-");
        assert_eq!(name(&"x".repeat(500)).len(), "no-time_".len() + LONGEST_CAUSE);
    }
}
