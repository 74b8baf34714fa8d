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
pub(super) enum Role {
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
const NAMES: &[(&str, Role)] = &[
    ("header.stamp.sec", Role::Seconds),
    ("header.stamp.secs", Role::Seconds),
    ("header.stamp.nanosec", Role::Nanoseconds),
    ("header.stamp.nsecs", Role::Nanoseconds),
    ("header.frame_id", Role::Bus),
    ("id", Role::Id),
    ("can_id", Role::Id),
    ("is_extended", Role::Extended),
    ("extended", Role::Extended),
    ("is_rtr", Role::Remote),
    ("rtr", Role::Remote),
    ("is_error", Role::Error),
    ("error", Role::Error),
    ("dlc", Role::Length),
    ("len", Role::Length),
    ("length", Role::Length),
    ("data", Role::Data),
    ("is_fd", Role::Fd),
    ("fd", Role::Fd),
    ("brs", Role::BitRateSwitch),
    ("esi", Role::ErrorState),
];

/// Number of elements in a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Count {
    /// One element, not an array.
    One,
    /// Array of fixed size.
    Fixed(usize),
    /// Array whose size is stored in the message.
    Told,
}

/// Data type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A number of this size in bytes.
    Number(usize),
    /// A string.
    Text,
}

/// A field of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) kind: Kind,
    pub(super) count: Count,
    pub(super) role: Option<Role>,
}

/// Layout of the messages of a type that contains a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    /// All fields, in order.
    pub(super) fields: Vec<Field>,
    /// Whether the data may have more than eight bytes.
    pub(super) is_fd: bool,
}

impl Layout {
    /// Parses a definition; `None` if it is invalid or its messages are not CAN frames.
    pub(super) fn of(definition: &[u8]) -> Option<Self> {
        let definition = std::str::from_utf8(definition.get(..LONGEST).unwrap_or(definition)).ok()?;
        let definitions = Definitions::of(definition);
        let mut found = MessageLayout::default();
        definitions.add(definitions.first, "", 0, &mut found)?;
        let has = |role| found.fields.iter().any(|field| field.role == Some(role));
        let is_frame = has(Role::Id) && has(Role::Data);
        is_frame.then_some(Self { is_fd: found.most_data > 8, fields: found.fields })
    }
}

/// Definitions in a text: that of the message, then those of its nested messages.
struct Definitions<'a> {
    first: &'a str,
    others: Vec<(&'a str, &'a str)>,
}

#[derive(Default)]
struct MessageLayout {
    fields: Vec<Field>,
    most_data: usize,
    steps: usize,
}

impl<'a> Definitions<'a> {
    fn of(text: &'a str) -> Self {
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
    fn add(&self, definition: &str, prefix: &str, depth: usize, found: &mut MessageLayout) -> Option<()> {
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
            self.field(kind, &format!("{prefix}{name}"), depth, found)?;
        }
        Some(())
    }

    fn field(&self, kind: &str, name: &str, depth: usize, found: &mut MessageLayout) -> Option<()> {
        let (kind, count, most) = counted(kind)?;
        let known = match kind {
            "bool" | "byte" | "char" | "int8" | "uint8" => Some(Kind::Number(1)),
            "int16" | "uint16" => Some(Kind::Number(2)),
            "int32" | "uint32" | "float32" => Some(Kind::Number(4)),
            "int64" | "uint64" | "float64" => Some(Kind::Number(8)),
            "string" => Some(Kind::Text),
            // ROS 1: two numbers.
            "time" | "duration" => {
                self.field("uint32", &format!("{name}.secs"), depth, found)?;
                return self.field("uint32", &format!("{name}.nsecs"), depth, found);
            }
            _ => None,
        };
        let Some(kind) = known else {
            let repeats = match count {
                Count::One => 1,
                Count::Fixed(count) => count,
                // The size of such an array is only known from the message.
                Count::Told => return None,
            };
            let definition = self.find(kind)?;
            for _ in 0..repeats {
                self.add(definition, &format!("{name}."), depth + 1, found)?;
            }
            return Some(());
        };
        let role = NAMES.iter().find(|(known, _)| *known == name).map(|(_, role)| *role);
        // Data must be an array of bytes; numbers must not be in an array.
        let fits = match role {
            Some(Role::Data) => kind == Kind::Number(1) && count != Count::One,
            Some(Role::Bus) => kind == Kind::Text && count == Count::One,
            Some(_) => matches!(kind, Kind::Number(_)) && count == Count::One,
            None => false,
        };
        let role = role.filter(|_| fits);
        if role == Some(Role::Data) {
            found.most_data = most;
        }
        if found.fields.len() >= MOST_FIELDS {
            return None;
        }
        found.fields.push(Field { kind, count, role });
        Some(())
    }

    /// Finds the definition of a message by its full name, or by the part after the last slash.
    fn find(&self, kind: &str) -> Option<&'a str> {
        let last = |name: &str| name.rsplit('/').next().map(str::to_owned);
        let whole = self.others.iter().find(|(name, _)| *name == kind);
        // Header without a package is std_msgs/Header in ROS 1; ROS 2 may write std_msgs/msg/Header.
        let found = whole.or_else(|| self.others.iter().find(|(name, _)| last(name) == last(kind)));
        found.map(|(_, definition)| *definition)
    }
}

/// Parses a type, its count and its maximum count: `uint8`, `uint8[8]`, `uint8[<=64]`, `uint8[]`,
/// `string<=8`.
fn counted(kind: &str) -> Option<(&str, Count, usize)> {
    let Some((kind, array)) = kind.strip_suffix(']').and_then(|kind| kind.split_once('[')) else {
        let kind = kind.split("<=").next().unwrap_or(kind);
        return Some((kind, Count::One, 1));
    };
    let kind = kind.split("<=").next().unwrap_or(kind);
    if let Some(most) = array.strip_prefix("<=") {
        return Some((kind, Count::Told, most.parse().ok()?));
    }
    if array.is_empty() {
        return Some((kind, Count::Told, usize::MAX));
    }
    let count = array.parse().ok()?;
    Some((kind, Count::Fixed(count), count))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn roles(layout: &Layout) -> Vec<Role> {
        layout.fields.iter().filter_map(|field| field.role).collect()
    }

    #[test]
    fn frames_of_ros2() {
        let layout = Layout::of(include_bytes!("frame.msg")).unwrap();
        assert_eq!(
            roles(&layout),
            [
                Role::Seconds,
                Role::Nanoseconds,
                Role::Bus,
                Role::Id,
                Role::Remote,
                Role::Extended,
                Role::Error,
                Role::Length,
                Role::Data
            ]
        );
        assert!(!layout.is_fd);
        let layout = Layout::of(include_bytes!("fd_frame.msg")).unwrap();
        assert!(layout.is_fd);
        assert_eq!(layout.fields.last().unwrap().count, Count::Told);
    }

    #[test]
    fn frames_of_ros1_with_constants_and_comments() {
        let text = "# a frame\nuint8 MODE=3\nHeader header\nuint32 id # as it is\nbool extended\nuint8 dlc\nuint8[8] data\n\
                    ====\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
        let layout = Layout::of(text.as_bytes()).unwrap();
        let expected =
            [Role::Seconds, Role::Nanoseconds, Role::Bus, Role::Id, Role::Extended, Role::Length, Role::Data];
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
            assert_eq!(Layout::of(text.as_bytes()), None, "{text}");
        }
        assert_eq!(Layout::of(b"\xFF"), None);
    }
}
