//! Position of a CAN frame in a ROS message, from the message definition in the file.
//!
//! ```text
//! std_msgs/Header header        can_msgs/Frame, ros2_socketcan_msgs/FdFrame, dataspeed_can_msgs/Frame …:
//! uint32 id                     any message with an identifier and data in fields of these names
//! bool is_extended
//! uint8 dlc
//! uint8[8] data
//! ====
//! MSG: std_msgs/Header
//! …
//! ```
//! <https://mcap.dev/spec/registry#ros2msg>, <https://mcap.dev/spec/registry#ros1msg>

/// Maximum length of a definition in bytes; the rest is ignored.
const LONGEST: usize = 64 * 1024;

/// Maximum number of fields in a message, with the fields of nested messages.
const MOST_FIELDS: usize = 256;

/// Maximum nesting depth of messages.
const DEEPEST: usize = 8;

/// Maximum number of definitions expanded, counted once per array element: stops nested arrays of empty
/// messages.
const MOST_STEPS: usize = 4_096;

/// Meaning of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldRole {
    /// Seconds of the timestamp.
    Seconds,
    /// Nanoseconds of the timestamp.
    Nanoseconds,
    /// Bus name.
    Bus,
    Id,
    Extended,
    Remote,
    Error,
    /// Length or DLC.
    Length,
    Data,
    Fd,
    BitRateSwitch,
    ErrorState,
}

/// Meanings of field names, as in the messages of ROS.
const NAMES: &[(&str, FieldRole)] = &[
    ("header.stamp.sec", FieldRole::Seconds),
    ("header.stamp.secs", FieldRole::Seconds),
    ("header.stamp.nanosec", FieldRole::Nanoseconds),
    ("header.stamp.nsecs", FieldRole::Nanoseconds),
    ("header.frame_id", FieldRole::Bus),
    ("id", FieldRole::Id),
    ("can_id", FieldRole::Id),
    ("is_extended", FieldRole::Extended),
    ("extended", FieldRole::Extended),
    ("is_rtr", FieldRole::Remote),
    ("rtr", FieldRole::Remote),
    ("is_error", FieldRole::Error),
    ("error", FieldRole::Error),
    ("dlc", FieldRole::Length),
    ("len", FieldRole::Length),
    ("length", FieldRole::Length),
    ("data", FieldRole::Data),
    ("is_fd", FieldRole::Fd),
    ("fd", FieldRole::Fd),
    ("brs", FieldRole::BitRateSwitch),
    ("esi", FieldRole::ErrorState),
];

/// Number of elements in a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ElementCount {
    /// One element, not an array.
    One,
    /// Array of fixed size.
    Fixed(usize),
    /// Array whose size is stored in the message.
    Stored,
}

/// Data type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MessageFieldType {
    /// A number of this size in bytes.
    Number(usize),
    /// A string.
    Text,
}

/// A field of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MessageField {
    pub(super) kind: MessageFieldType,
    pub(super) count: ElementCount,
    pub(super) role: Option<FieldRole>,
}

/// Layout of the messages of a type that contains a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CanMessageLayout {
    /// All fields, in order.
    pub(super) fields: Vec<MessageField>,
    /// Whether the data may have more than eight bytes.
    pub(super) is_fd: bool,
}

impl CanMessageLayout {
    /// Parses a definition; `None` if it is invalid or its messages are not CAN frames.
    pub(super) fn parse_definition(definition: &[u8]) -> Option<Self> {
        let definition = std::str::from_utf8(definition.get(..LONGEST).unwrap_or(definition)).ok()?;
        let definitions = MessageDefinitions::split_definitions(definition);
        let mut found = MessageLayout::default();
        definitions.add_fields(definitions.first, "", 0, &mut found)?;
        let has = |role| found.fields.iter().any(|field| field.role == Some(role));
        let is_frame = has(FieldRole::Id) && has(FieldRole::Data);
        is_frame.then_some(Self { is_fd: found.most_data > 8, fields: found.fields })
    }
}

/// Definitions in a text: that of the message, then those of its nested messages.
struct MessageDefinitions<'a> {
    first: &'a str,
    others: Vec<(&'a str, &'a str)>,
}

#[derive(Default)]
struct MessageLayout {
    fields: Vec<MessageField>,
    most_data: usize,
    steps: usize,
}

impl<'a> MessageDefinitions<'a> {
    fn split_definitions(text: &'a str) -> Self {
        let mut parts = Vec::new();
        let (mut begin, mut at) = (0, 0);
        for line in text.split_inclusive('\n') {
            if line.starts_with("====") {
                parts.push(text.get(begin..at).unwrap_or_default());
                begin = at + line.len();
            }
            at += line.len();
        }
        parts.push(text.get(begin..).unwrap_or_default());
        let named = |part: &'a str| {
            let (head, body) = part.trim_start().split_once('\n')?;
            Some((head.strip_prefix("MSG:")?.trim(), body))
        };
        let mut parts = parts.into_iter();
        let first = parts.next().unwrap_or_default();
        Self { first, others: parts.filter_map(named).collect() }
    }

    /// Adds the fields of a definition; `None` if the layout of one of them is unknown.
    fn add_fields(
        &self,
        definition: &str,
        prefix: &str,
        depth: usize,
        found: &mut MessageLayout,
    ) -> Option<()> {
        found.steps += 1;
        if depth > DEEPEST || found.steps > MOST_STEPS {
            return None;
        }
        for line in definition.lines() {
            let line = line.split('#').next().unwrap_or_default();
            let mut words = line.split_ascii_whitespace();
            let (Some(kind), Some(name)) = (words.next(), words.next()) else { continue };
            // `uint8 MODE=3`, `uint8 MODE = 3`: constants occupy no space.
            if line.contains('=') && !kind.contains("<=") {
                continue;
            }
            self.add_field(kind, &format!("{prefix}{name}"), depth, found)?;
        }
        Some(())
    }

    fn add_field(&self, kind: &str, name: &str, depth: usize, found: &mut MessageLayout) -> Option<()> {
        let (kind, count, most) = parse_count(kind)?;
        let known = match kind {
            "bool" | "byte" | "char" | "int8" | "uint8" => Some(MessageFieldType::Number(1)),
            "int16" | "uint16" => Some(MessageFieldType::Number(2)),
            "int32" | "uint32" | "float32" => Some(MessageFieldType::Number(4)),
            "int64" | "uint64" | "float64" => Some(MessageFieldType::Number(8)),
            "string" => Some(MessageFieldType::Text),
            // ROS 1: two numbers.
            "time" | "duration" => {
                self.add_field("uint32", &format!("{name}.secs"), depth, found)?;
                return self.add_field("uint32", &format!("{name}.nsecs"), depth, found);
            }
            _ => None,
        };
        let Some(kind) = known else {
            let repeats = match count {
                ElementCount::One => 1,
                ElementCount::Fixed(count) => count,
                // The size of such an array is only known from the message.
                ElementCount::Stored => return None,
            };
            let definition = self.find_definition(kind)?;
            for _ in 0..repeats {
                self.add_fields(definition, &format!("{name}."), depth + 1, found)?;
            }
            return Some(());
        };
        let role = NAMES.iter().find(|(known, _)| *known == name).map(|(_, role)| *role);
        // Data must be an array of bytes; numbers must not be in an array.
        let fits = match role {
            Some(FieldRole::Data) => kind == MessageFieldType::Number(1) && count != ElementCount::One,
            Some(FieldRole::Bus) => kind == MessageFieldType::Text && count == ElementCount::One,
            Some(_) => matches!(kind, MessageFieldType::Number(_)) && count == ElementCount::One,
            None => false,
        };
        let role = role.filter(|_| fits);
        if role == Some(FieldRole::Data) {
            found.most_data = most;
        }
        if found.fields.len() >= MOST_FIELDS {
            return None;
        }
        found.fields.push(MessageField { kind, count, role });
        Some(())
    }

    /// Finds the definition of a message by its full name, or by the part after the last slash.
    fn find_definition(&self, kind: &str) -> Option<&'a str> {
        let last = |name: &str| name.rsplit('/').next().map(str::to_owned);
        let whole = self.others.iter().find(|(name, _)| *name == kind);
        // Header without a package is std_msgs/Header in ROS 1; ROS 2 may write std_msgs/msg/Header.
        let found = whole.or_else(|| self.others.iter().find(|(name, _)| last(name) == last(kind)));
        found.map(|(_, definition)| *definition)
    }
}

/// Parses a type, its count and its maximum count: `uint8`, `uint8[8]`, `uint8[<=64]`, `uint8[]`,
/// `string<=8`.
fn parse_count(kind: &str) -> Option<(&str, ElementCount, usize)> {
    let Some((kind, array)) = kind.strip_suffix(']').and_then(|kind| kind.split_once('[')) else {
        let kind = kind.split("<=").next().unwrap_or(kind);
        return Some((kind, ElementCount::One, 1));
    };
    let kind = kind.split("<=").next().unwrap_or(kind);
    if let Some(most) = array.strip_prefix("<=") {
        return Some((kind, ElementCount::Stored, most.parse().ok()?));
    }
    if array.is_empty() {
        return Some((kind, ElementCount::Stored, usize::MAX));
    }
    let count = array.parse().ok()?;
    Some((kind, ElementCount::Fixed(count), count))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn roles(layout: &CanMessageLayout) -> Vec<FieldRole> {
        layout.fields.iter().filter_map(|field| field.role).collect()
    }

    #[test]
    fn frames_of_ros2() {
        let layout = CanMessageLayout::parse_definition(include_bytes!("frame.msg")).unwrap();
        assert_eq!(
            roles(&layout),
            [
                FieldRole::Seconds,
                FieldRole::Nanoseconds,
                FieldRole::Bus,
                FieldRole::Id,
                FieldRole::Remote,
                FieldRole::Extended,
                FieldRole::Error,
                FieldRole::Length,
                FieldRole::Data
            ]
        );
        assert!(!layout.is_fd);
        let layout = CanMessageLayout::parse_definition(include_bytes!("fd_frame.msg")).unwrap();
        assert!(layout.is_fd);
        assert_eq!(layout.fields.last().unwrap().count, ElementCount::Stored);
    }

    #[test]
    fn frames_of_ros1_with_constants_and_comments() {
        let text = "# a frame\nuint8 MODE=3\nHeader header\nuint32 id # as it is\nbool extended\nuint8 dlc\nuint8[8] data\n\
                    ====\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
        let layout = CanMessageLayout::parse_definition(text.as_bytes()).unwrap();
        let expected = [
            FieldRole::Seconds,
            FieldRole::Nanoseconds,
            FieldRole::Bus,
            FieldRole::Id,
            FieldRole::Extended,
            FieldRole::Length,
            FieldRole::Data,
        ];
        assert_eq!(roles(&layout), expected);
        assert_eq!(layout.fields.len(), 8);
    }

    #[test]
    fn other_messages_and_endless_ones_are_none() {
        for text in [
            "float64 x\nfloat64 y\n",
            "uint32 id\nstring data\n",
            "uint32 id\nuint8[] data\nPoint where\n",
            "uint32 id\nuint8[8] data\nA a\n====\nMSG: p/A\nA a\n",
            "uint32 id\nuint8[8] data\nA[1000000000] a\n====\nMSG: p/A\nuint8 x\n",
            "uint32 id\nuint8[8] data\nA[1000000000] a\n====\nMSG: p/A\n",
            "uint32 id\nuint8[x] data\n",
        ] {
            assert_eq!(CanMessageLayout::parse_definition(text.as_bytes()), None, "{text}");
        }
        assert_eq!(CanMessageLayout::parse_definition(b"\xFF"), None);
    }
}
