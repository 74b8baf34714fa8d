//! Evaluation of triggers, and the events they are compared with.

use super::condition::mask_number;
use crate::profile::device::condition::{ExpectedValue, LssTrigger, ProfileTrigger, SetTrigger};
use crate::profile::layout::{PdoName, ValueCarrier};
use crate::profile::meaning::ObjectMeaning;
use crate::profile::object::NumberList;
use crate::wire::canopen::ObjectAddress;

/// Event at a device, in the categories of triggers.
#[derive(Debug, Clone, Copy)]
pub(crate) enum TriggerEvent<'a> {
    /// A PDO is received or sent.
    Pdo(PdoName),
    /// A J1939 message, by its name in the profile.
    Message(&'a str),
    /// An object is written or read, or its value arrives in a PDO or message.
    Value(ValueUpdate<'a>),
    /// NMT command to the node, by its name.
    Nmt(&'a str),
    /// The machine of a channel reports a state.
    State(Option<u8>, &'a str),
    /// SYNC with the identifier configured in the node.
    Sync,
    /// EMCY code.
    Emcy(u16),
    /// SPN and FMI of a trouble code.
    Dtc(u32, u8),
    /// Start of the node.
    Boot {
        /// Whether an NMT reset caused it.
        is_commanded: bool,
    },
    /// Guarding request.
    Guard,
    /// NMT state in a heartbeat or guarding response.
    Reports(&'a str),
    /// LSS message on the node's bus.
    Lss(LssEvent<'a>),
}

/// New value of an object.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ValueUpdate<'a> {
    pub(crate) object: ObjectAddress,
    pub(crate) source: UpdateSource,
    /// Raw number; `None` if it is not a number or not complete.
    pub(crate) raw: Option<i64>,
    /// Raw number before, if known.
    pub(crate) before: Option<i64>,
    /// Bytes of a transfer.
    pub(crate) bytes: &'a [u8],
    pub(crate) meaning: Option<&'a ObjectMeaning>,
    /// Whether all bits count as clear before, if the number before is unknown.
    pub(crate) is_fresh: bool,
}

/// Transfer or message that contains a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum UpdateSource {
    /// Confirmed SDO download.
    Written,
    /// Refused SDO download.
    Refused,
    /// SDO upload.
    Read,
    /// PDO or message to the device.
    Received,
    /// PDO or message of the device.
    Sent,
}

impl UpdateSource {
    /// Whether the value is sent to the device.
    pub(crate) const fn is_command(self) -> bool {
        matches!(self, Self::Written | Self::Refused | Self::Received)
    }

    /// Name in findings.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Written => "written",
            Self::Refused => "refused",
            Self::Read => "read",
            Self::Received => "received",
            Self::Sent => "sent",
        }
    }
}

/// LSS message.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LssEvent<'a> {
    pub(crate) service: &'a str,
    pub(crate) is_answer: bool,
    /// Byte after the command specifier; `None` if the service has none to compare.
    pub(crate) value: Option<u8>,
}

impl<'a> From<&'a ValueCarrier> for TriggerEvent<'a> {
    fn from(carrier: &'a ValueCarrier) -> Self {
        match carrier {
            ValueCarrier::Pdo(name) => Self::Pdo(*name),
            ValueCarrier::Message(name) => Self::Message(name),
        }
    }
}

impl ProfileTrigger {
    /// Whether the event matches. An aborted write has no effect and does not match.
    pub(crate) fn is_met_by(&self, event: &TriggerEvent<'_>) -> bool {
        self.matches_event(event, false)
    }

    /// Like [`Self::is_met_by`], but an aborted write also matches.
    pub(crate) fn is_attempted_by(&self, event: &TriggerEvent<'_>) -> bool {
        self.matches_event(event, true)
    }

    /// Whether the event is compared with the trigger: an event of its category, for values that of its object.
    pub(crate) fn is_compared_with(&self, event: &TriggerEvent<'_>) -> bool {
        let is_value = |is_meant: &dyn Fn(&ValueUpdate<'_>) -> bool| matches!(event, TriggerEvent::Value(update) if is_meant(update));
        let is_of = |update: &ValueUpdate<'_>, set: &SetTrigger| {
            let is_comparable = update.raw.is_some() && (!set.changed || update.before.is_some());
            update.object == set.object.object && (set.values.is_none() && !set.changed || is_comparable)
        };
        match self {
            Self::Write(..) | Self::Writes(_) => {
                is_value(&|update| matches!(update.source, UpdateSource::Written | UpdateSource::Refused))
            }
            Self::Read(..) => is_value(&|update| update.source == UpdateSource::Read),
            Self::Set(set) => is_value(&|update| update.source.is_command() && is_of(update, set)),
            Self::Shows(set) => is_value(&|update| !update.source.is_command() && is_of(update, set)),
            Self::Bit(bit, _) => is_value(&|update| {
                update.object == bit.object.object
                    && !matches!(update.source, UpdateSource::Refused | UpdateSource::Read)
                    && (update.before.is_some() || update.is_fresh)
            }),
            Self::Pdo(_) => matches!(event, TriggerEvent::Pdo(_)),
            Self::Message(_) => matches!(event, TriggerEvent::Message(_)),
            Self::Nmt(_) => matches!(event, TriggerEvent::Nmt(_)),
            Self::State(_) => matches!(event, TriggerEvent::State(..)),
            Self::Emcy(_) => matches!(event, TriggerEvent::Emcy(_)),
            Self::Dtc(_) => matches!(event, TriggerEvent::Dtc(..)),
            Self::Sync => matches!(event, TriggerEvent::Sync),
            Self::Boot | Self::PowerOn => matches!(event, TriggerEvent::Boot { .. }),
            // A report of the state shows that the node is monitored by one of the two.
            Self::Guard => matches!(event, TriggerEvent::Guard | TriggerEvent::Reports(_)),
            Self::Reports(_) => matches!(event, TriggerEvent::Reports(_)),
            Self::Lss(_) => matches!(event, TriggerEvent::Lss(_)),
        }
    }

    fn matches_event(&self, event: &TriggerEvent<'_>, attempts: bool) -> bool {
        match self {
            Self::Write(..)
            | Self::Read(..)
            | Self::Writes(_)
            | Self::Set(_)
            | Self::Shows(_)
            | Self::Bit(..) => {
                matches!(event, TriggerEvent::Value(update) if self.matches_update(update, attempts))
            }
            Self::Pdo(wanted) => matches!(event, TriggerEvent::Pdo(name) if name == wanted),
            Self::Message(wanted) => matches!(event, TriggerEvent::Message(name) if *name == wanted.name),
            Self::Nmt(wanted) => matches!(event, TriggerEvent::Nmt(command) if command == wanted),
            Self::State(wanted) => {
                matches!(event, TriggerEvent::State(_, state) if wanted.iter().any(|it| it == state))
            }
            Self::Emcy(wanted) => matches!(event, TriggerEvent::Emcy(code) if code == wanted),
            Self::Dtc(wanted) => {
                matches!(event, TriggerEvent::Dtc(spn, fmi) if wanted.is_none_or(|it| it == (*spn, *fmi)))
            }
            Self::Sync => matches!(event, TriggerEvent::Sync),
            Self::Boot => matches!(event, TriggerEvent::Boot { .. }),
            Self::PowerOn => matches!(event, TriggerEvent::Boot { is_commanded: false }),
            Self::Guard => matches!(event, TriggerEvent::Guard),
            Self::Reports(wanted) => {
                matches!(event, TriggerEvent::Reports(state) if wanted.iter().any(|it| it == state))
            }
            Self::Lss(wanted) => matches!(event, TriggerEvent::Lss(message) if is_service(message, wanted)),
        }
    }

    fn matches_update(&self, update: &ValueUpdate<'_>, attempts: bool) -> bool {
        let is_write = match update.source {
            UpdateSource::Written => true,
            UpdateSource::Refused => attempts,
            UpdateSource::Read | UpdateSource::Received | UpdateSource::Sent => false,
        };
        match self {
            Self::Write(of, wanted) => {
                update.object == of.object && is_write && is_wanted(update, wanted.as_ref())
            }
            Self::Read(of, wanted) => {
                update.object == of.object
                    && update.source == UpdateSource::Read
                    && is_wanted(update, wanted.as_ref())
            }
            Self::Writes(range) => is_write && range.covers(update.object, 0, 0),
            Self::Set(set) => {
                update.object == set.object.object
                    && (is_write || update.source == UpdateSource::Received)
                    && is_set(update, set)
            }
            Self::Shows(set) => {
                update.object == set.object.object
                    && matches!(update.source, UpdateSource::Sent | UpdateSource::Read)
                    && is_set(update, set)
            }
            Self::Bit(bit, becomes) => {
                update.object == bit.object.object
                    && !matches!(update.source, UpdateSource::Refused | UpdateSource::Read)
                    && is_change_of_bit(update, bit.bit, *becomes)
            }
            _ => false,
        }
    }
}

fn is_wanted(update: &ValueUpdate<'_>, wanted: Option<&ExpectedValue>) -> bool {
    match wanted {
        None => true,
        Some(ExpectedValue::Text(text)) => text.as_bytes() == update.bytes,
        Some(ExpectedValue::Numbers(numbers)) => update.raw.is_some_and(|raw| numbers.contains(raw)),
    }
}

fn is_set(update: &ValueUpdate<'_>, set: &SetTrigger) -> bool {
    let through = |raw: i64| mask_number(raw, set.mask);
    let Some(raw) = update.raw.map(through) else { return set.values.is_none() && !set.changed };
    let is_meant = set.values.as_ref().is_none_or(|values| values.contains(raw) != set.negated);
    is_meant && (!set.changed || update.before.is_some_and(|before| through(before) != raw))
}

fn is_change_of_bit(update: &ValueUpdate<'_>, bit: u8, becomes: bool) -> bool {
    let is_as_wanted = |word: i64| word >> bit & 1 == i64::from(becomes);
    let before = update.before.or(update.is_fresh.then_some(0));
    update.raw.is_some_and(is_as_wanted) && before.is_some_and(|before| !is_as_wanted(before))
}

fn is_service(message: &LssEvent<'_>, wanted: &LssTrigger) -> bool {
    let is_value = |values: &NumberList| message.value.is_some_and(|value| values.contains(i64::from(value)));
    message.service == wanted.service
        && message.is_answer == wanted.answer
        && wanted.values.as_ref().is_none_or(is_value)
}

#[cfg(test)]
mod tests {
    use UpdateSource::{Read, Received, Refused, Sent, Written};

    use super::*;

    fn trigger(text: &str) -> ProfileTrigger {
        toml::from_str(text).unwrap()
    }

    fn is_met(text: &str, event: &TriggerEvent<'_>) -> bool {
        let trigger = trigger(text);
        let is_met = trigger.is_met_by(event);
        // The two differ only for an aborted write.
        let is_refused = matches!(event, TriggerEvent::Value(update) if update.source == Refused);
        assert!(is_refused || trigger.is_attempted_by(event) == is_met, "{text}");
        is_met
    }

    /// Object 2000:00 gets a value.
    fn update(source: UpdateSource, before: Option<i64>, raw: Option<i64>) -> TriggerEvent<'static> {
        TriggerEvent::Value(ValueUpdate {
            object: ObjectAddress::new(0x2000, 0),
            source,
            raw,
            before,
            bytes: b"save",
            meaning: None,
            is_fresh: false,
        })
    }

    const SOURCES: [UpdateSource; 5] = [Written, Refused, Read, Received, Sent];

    /// Sources that meet a trigger, and sources that attempt it.
    fn sources(text: &str, before: Option<i64>, raw: i64) -> [Vec<UpdateSource>; 2] {
        let (trigger, event) = (trigger(text), |source| update(source, before, Some(raw)));
        let met = SOURCES.into_iter().filter(|source| trigger.is_met_by(&event(*source)));
        let attempted = SOURCES.into_iter().filter(|source| trigger.is_attempted_by(&event(*source)));
        [met.collect(), attempted.collect()]
    }

    #[test]
    fn each_trigger_on_an_object_has_its_sources() {
        assert_eq!(sources("write = \"2000:00\"", None, 1), [vec![Written], vec![Written, Refused]]);
        assert_eq!(sources("read = \"2000:00\"", None, 1), [vec![Read], vec![Read]]);
        let writes = "writes = \"1FFF:00..2001:00\"";
        assert_eq!(sources(writes, None, 1), [vec![Written], vec![Written, Refused]]);
        let set = [vec![Written, Received], vec![Written, Refused, Received]];
        assert_eq!(sources("set = \"2000:00\"", None, 1), set);
        assert_eq!(sources("shows = \"2000:00\"", None, 1), [vec![Read, Sent], vec![Read, Sent]]);
        let bit = vec![Written, Received, Sent];
        assert_eq!(sources("bit = \"2000:00/3\"\nbecomes = 1", Some(0), 8), [bit.clone(), bit]);
    }

    #[test]
    fn other_objects_are_ignored() {
        for text in [
            "write = \"2000:01\"",
            "read = \"2000:01\"",
            "writes = \"2000:01..2FFF:00\"",
            "set = \"2000:01\"",
            "shows = \"2000:01\"",
            "bit = \"2000:01/3\"\nbecomes = 1",
        ] {
            assert_eq!(sources(text, Some(0), 8), [vec![], vec![]], "{text}");
        }
    }

    #[test]
    fn write_and_read_compare_numbers_or_text() {
        for (key, source) in [("write", Written), ("read", Read)] {
            let is_met = |equals: &str, raw| {
                is_met(&format!("{key} = \"2000:00\"\nequals = {equals}"), &update(source, None, raw))
            };
            assert!(is_met("7", Some(7)) && is_met("[1, 7]", Some(7)) && is_met("\"save\"", None));
            assert!(!is_met("6", Some(7)) && !is_met("7", None) && !is_met("\"load\"", Some(7)));
        }
    }

    #[test]
    fn set_compares_through_its_mask() {
        let is_met = |keys: &str, raw| {
            is_met(&format!("set = \"2000:00\"\n{keys}"), &update(Received, Some(0), Some(raw)))
        };
        assert!(is_met("equals = 5", 5) && !is_met("equals = 5", 7));
        assert!(is_met("equals = 5\nmask = 0x0D", 7) && !is_met("equals = 5\nmask = 0x0D", 8));
        assert!(is_met("not = 5", 7) && !is_met("not = 5", 5));
        assert!(is_met("not = 5\nmask = 0x0D", 8) && !is_met("not = 5\nmask = 0x0D", 7));
    }

    #[test]
    fn set_with_changed_needs_another_value_before() {
        let is_met = |keys: &str, before, raw| {
            is_met(&format!("set = \"2000:00\"\n{keys}"), &update(Received, before, raw))
        };
        assert!(is_met("changed = true", Some(4), Some(5)));
        assert!(!is_met("changed = true", Some(5), Some(5)));
        assert!(!is_met("changed = true", None, Some(5)));
        // Bits outside the mask do not count as a change.
        let masked = "changed = true\nequals = 1\nmask = 1";
        assert!(is_met(masked, Some(2), Some(3)) && !is_met(masked, Some(1), Some(3)));
        // A value other than a number sets the object, but cannot be compared.
        assert!(is_met("", None, None) && !is_met("changed = true", Some(1), None));
        assert!(!is_met("equals = 1", None, None) && !is_met("not = 1", None, None));
    }

    #[test]
    fn bit_needs_a_change_to_the_wanted_level() {
        let is_met = |becomes: u8, before, raw| {
            is_met(&format!("bit = \"2000:00/3\"\nbecomes = {becomes}"), &update(Sent, before, raw))
        };
        assert!(is_met(1, Some(0b0100), Some(0b1100)) && is_met(0, Some(0b1000), Some(0)));
        assert!(!is_met(1, Some(0b1000), Some(0b1100)) && !is_met(1, Some(0b1000), Some(0)));
        assert!(!is_met(0, Some(0b1000), Some(0b1100)) && !is_met(0, Some(0), Some(0)));
        assert!(!is_met(1, None, Some(0b1000)) && !is_met(1, Some(0), None));
    }

    #[test]
    fn bits_of_a_fresh_node_count_as_clear() {
        let TriggerEvent::Value(value) = update(Sent, None, Some(8)) else { unreachable!() };
        let fresh = TriggerEvent::Value(ValueUpdate { is_fresh: true, ..value });
        assert!(is_met("bit = \"2000:00/3\"\nbecomes = 1", &fresh));
        assert!(!is_met("bit = \"2000:00/2\"\nbecomes = 0", &fresh));
    }

    #[test]
    fn carriers_are_compared_by_name() {
        let pdo = ValueCarrier::Pdo("RPDO2".parse().unwrap());
        let message = ValueCarrier::Message("TSC1".into());
        assert!(is_met("pdo = \"RPDO2\"", &TriggerEvent::from(&pdo)));
        assert!(!is_met("pdo = \"TPDO2\"", &TriggerEvent::from(&pdo)));
        assert!(is_met("message = { name = \"TSC1\" }", &TriggerEvent::from(&message)));
        assert!(!is_met("message = { name = \"EEC1\" }", &TriggerEvent::from(&message)));
    }

    #[test]
    fn codes_commands_and_states_are_compared() {
        assert!(is_met("emcy = 0x8130", &TriggerEvent::Emcy(0x8130)));
        assert!(!is_met("emcy = 0x8130", &TriggerEvent::Emcy(0)));
        let reports = "reports = [\"stopped\", \"undefined\"]";
        assert!(is_met(reports, &TriggerEvent::Reports("undefined")));
        assert!(!is_met(reports, &TriggerEvent::Reports("operational")));
        assert!(is_met("dtc = true", &TriggerEvent::Dtc(91, 3)));
        assert!(is_met("dtc = \"91/3\"", &TriggerEvent::Dtc(91, 3)));
        assert!(!is_met("dtc = \"91/3\"", &TriggerEvent::Dtc(91, 4)));
        assert!(is_met("nmt = \"start\"", &TriggerEvent::Nmt("start")));
        assert!(!is_met("nmt = \"start\"", &TriggerEvent::Nmt("stop")));
        assert!(is_met("state = [\"A\", \"B\"]", &TriggerEvent::State(Some(1), "B")));
        assert!(!is_met("state = \"A\"", &TriggerEvent::State(None, "B")));
    }

    #[test]
    fn an_lss_service_is_compared_with_its_direction_and_byte() {
        let of =
            |is_answer, value| TriggerEvent::Lss(LssEvent { service: "switch-global", is_answer, value });
        let is_service = |keys: &str, event| is_met(&format!("lss = \"switch-global\"\n{keys}"), &event);
        assert!(is_service("", of(false, Some(1))) && !is_service("", of(true, Some(1))));
        assert!(is_service("answer = true", of(true, None)) && !is_service("answer = true", of(false, None)));
        assert!(
            is_service("equals = [0, 1]", of(false, Some(1)))
                && !is_service("equals = 0", of(false, Some(1)))
        );
        assert!(!is_service("equals = 0", of(false, None)));
        assert!(!is_met("lss = \"other\"", &of(false, None)));
    }

    #[test]
    fn a_power_on_is_a_start_without_a_command() {
        for is_commanded in [false, true] {
            let event = TriggerEvent::Boot { is_commanded };
            assert!(is_met("boot = true", &event));
            assert_eq!(is_met("boot = \"power-on\"", &event), !is_commanded);
        }
        for wrong in ["boot = false", "boot = \"reset\""] {
            assert!(toml::from_str::<ProfileTrigger>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn events_without_data_meet_their_own_trigger_only() {
        let all = [
            ("sync = true", TriggerEvent::Sync),
            ("boot = true", TriggerEvent::Boot { is_commanded: true }),
            ("guard = true", TriggerEvent::Guard),
        ];
        for (place, (text, _)) in all.iter().enumerate() {
            for (other, (_, event)) in all.iter().enumerate() {
                assert_eq!(is_met(text, event), place == other, "{text}");
            }
        }
    }
}
