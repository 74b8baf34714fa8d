//! Frames of ROS as `rostopic echo` and `ros2 topic echo` print them: YAML, one document per message.
//!
//! ```text
//! header:
//!   stamp:
//!     sec: 1700000000            secs and nsecs in ROS 1
//!     nanosec: 250000000
//!   frame_id: can0
//! id: 1537                       decimal
//! is_rtr: false
//! is_extended: false
//! is_error: false
//! dlc: 8                         len in messages of ros2_socketcan for CAN FD
//! data: [64, 24, 16, 1, 0, 0, 0, 0]      or one line per byte, as "- 64"
//! ---
//! ```
//!
//! Sources: ros-industrial/ros_canopen, `can_msgs/msg/Frame.msg` (eight bytes of data, whatever the length);
//! autowarefoundation/ros2_socketcan, `ros2_socketcan_msgs/msg/FdFrame.msg`.

use crate::capture::CaptureFormat;
use crate::capture::text::columns::{NumberBase, parse_identifier};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine, first_lines,
};
use crate::frame::{Frame, FrameFlags, MAX_DATA, is_fd_length};

/// Number of lines at the start within which the keys of a message must occur.
const DETECTING_LINES: usize = 60;

/// Keys that other messages of ROS do not have together.
const SIGNS: &[&[u8]] = &[b"id:", b"is_extended:", b"is_error:", b"data:"];

/// Data bytes of a message without a length of its data.
const FIXED: usize = 8;

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "ros-echo",
    title: RosMessages::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| {
        let has = |sign: &&[u8]| first_lines(head, DETECTING_LINES).any(|line| line.starts_with(sign));
        SIGNS.iter().all(has)
    },
    parser: |_| Box::new(LineParser::new(RosMessages::default())),
};

/// A message so far.
#[derive(Clone, Default)]
struct RosMessages {
    message: RosMessage,
    /// Whether the data follow, one byte per line.
    in_data: bool,
    /// Whether a line of the message was unreadable: the rest of the message is skipped.
    is_broken: bool,
    bus: Vec<u8>,
}

#[derive(Clone, Default)]
struct RosMessage {
    seconds: Option<i64>,
    nanoseconds: i64,
    id: Option<u32>,
    is_extended: bool,
    flags: FrameFlags,
    /// Length of the frame.
    dlc: Option<u8>,
    /// Length of the data of a message for CAN FD.
    length: Option<u8>,
    data: Vec<u8>,
}

impl RosMessage {
    /// Whether all bytes of the data were read.
    fn has_all_data(&self) -> bool {
        self.data.len() >= self.length.map_or(FIXED, usize::from)
    }

    fn time(&self) -> Option<i64> {
        // Messages without a stamp have zeros.
        let seconds = self.seconds.filter(|seconds| *seconds > 0 || self.nanoseconds > 0)?;
        seconds.checked_mul(SECOND)?.checked_add(self.nanoseconds)
    }

    fn build_frame(&self) -> Result<Frame, &'static str> {
        const LENGTH: &str = "message: expected a length of a frame, and as many bytes";
        let is_error = self.flags.contains(FrameFlags::ERROR);
        let id = self.id.and_then(|id| parse_identifier(id, self.is_extended || is_error));
        let id = id.ok_or("message: expected an identifier up to 2047, or 536870911 if it is extended")?;
        let length = self.dlc.or(self.length).ok_or(LENGTH)?;
        if length > 8 && !is_fd_length(length) {
            return Err(LENGTH);
        }
        let flags = if length > 8 { self.flags.with(FrameFlags::FD) } else { self.flags };
        if flags.contains(FrameFlags::REMOTE) {
            return Ok(Frame { id, flags, length, ..Frame::EMPTY });
        }
        let data = self.data.get(..usize::from(length)).ok_or(LENGTH)?;
        Ok(Frame { flags, ..Frame::data_frame(id, data) })
    }
}

fn parse_truth(text: &[u8]) -> Result<bool, &'static str> {
    match text.to_ascii_lowercase().as_slice() {
        b"true" | b"1" => Ok(true),
        b"false" | b"0" => Ok(false),
        _ => Err("expected true or false"),
    }
}

fn parse_number(text: &[u8]) -> Result<u32, &'static str> {
    NumberBase::Decimal.parse_number(text).ok_or("expected a decimal number")
}

fn parse_byte(text: &[u8]) -> Result<u8, &'static str> {
    u8::try_from(parse_number(text)?).map_err(|_| "expected a number up to 255")
}

impl RosMessages {
    /// Takes `key: value`; the frame if this completes the message.
    fn take_key(&mut self, key: &[u8], value: &[u8]) -> Result<Option<Frame>, &'static str> {
        self.in_data = false;
        let message = &mut self.message;
        let mut set = |flag: FrameFlags| -> Result<(), &'static str> {
            if parse_truth(value)? {
                message.flags = message.flags.with(flag);
            }
            Ok(())
        };
        match key {
            b"header" => self.message = RosMessage::default(),
            b"sec" | b"secs" => self.message.seconds = Some(i64::from(parse_number(value)?)),
            b"nanosec" | b"nsecs" => self.message.nanoseconds = i64::from(parse_number(value)?),
            b"frame_id" => {
                let name = value.trim_ascii();
                let is_quote = |byte: &u8| matches!(byte, b'\'' | b'"');
                self.bus = name.iter().copied().filter(|byte| !is_quote(byte)).collect();
            }
            b"id" => self.message.id = Some(parse_number(value)?),
            b"is_extended" => self.message.is_extended = parse_truth(value)?,
            b"is_rtr" => set(FrameFlags::REMOTE)?,
            b"is_error" => set(FrameFlags::ERROR)?,
            b"dlc" => self.message.dlc = Some(parse_byte(value)?),
            b"len" => self.message.length = Some(parse_byte(value)?),
            b"data" => return self.take_data(value),
            // Stamp, sequence number, and keys of later versions.
            _ => {}
        }
        Ok(None)
    }

    /// Takes the text after `data:`: a list, or nothing if one line per byte follows.
    fn take_data(&mut self, value: &[u8]) -> Result<Option<Frame>, &'static str> {
        self.message.data.clear();
        if value.is_empty() {
            self.in_data = true;
            return if self.message.has_all_data() { self.finish_message().map(Some) } else { Ok(None) };
        }
        let list = value.strip_prefix(b"[").or(value.strip_prefix(b"("));
        let list = list.and_then(|list| list.strip_suffix(b"]").or(list.strip_suffix(b")")));
        let list = list.ok_or("data: expected a list such as [64, 24]")?;
        let numbers = list.split(|byte| *byte == b',').map(<[u8]>::trim_ascii);
        let data: Result<Vec<u8>, _> = numbers.filter(|number| !number.is_empty()).map(parse_byte).collect();
        self.message.data = data?;
        self.finish_message().map(Some)
    }

    /// Takes a byte of `- 64`.
    fn take_byte(&mut self, text: &[u8]) -> Result<Option<Frame>, &'static str> {
        if !self.in_data || self.message.data.len() >= MAX_DATA {
            return Err("expected a key such as id: before a list");
        }
        self.message.data.push(parse_byte(text.trim_ascii())?);
        if !self.message.has_all_data() {
            return Ok(None);
        }
        self.finish_message().map(Some)
    }

    /// Takes a line; the frame if this completes the message.
    fn take_line(&mut self, text: &[u8]) -> Result<Option<Frame>, &'static str> {
        match (text.strip_prefix(b"- "), text.iter().position(|byte| *byte == b':')) {
            (Some(byte), _) => self.take_byte(byte),
            (None, Some(colon)) => {
                let (key, value) = (text.get(..colon), text.get(colon + 1..));
                self.take_key(key.unwrap_or_default(), value.unwrap_or_default().trim_ascii())
            }
            (None, None) => Err("expected a key such as id:, or ---"),
        }
    }

    fn finish_message(&mut self) -> Result<Frame, &'static str> {
        self.in_data = false;
        self.message.build_frame()
    }
}

impl LineFormat for RosMessages {
    const TITLE: &'static str = "messages of ROS (can_msgs)";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        _: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if text == b"---" {
            let is_open = std::mem::take(&mut self.in_data);
            let is_broken = std::mem::take(&mut self.is_broken);
            self.message = RosMessage::default();
            return if is_open && !is_broken {
                Err("message: ends before its data".into())
            } else {
                Ok(None)
            };
        }
        if self.is_broken {
            return Ok(None);
        }
        let taken = self.take_line(text);
        self.is_broken = taken.is_err();
        let Some(frame) = taken? else { return Ok(None) };
        let time = self.message.time();
        let bus = if self.bus.is_empty() { ONLY_BUS } else { &self.bus };
        Ok(Some(ParsedLine::new(time, bus, frame)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::{read_capture, read_in_pieces};

    const ROS_2: &str = "header:\n  stamp:\n    sec: 1700000000\n    nanosec: 250000000\n  frame_id: can0\nid: 1537\n\
        is_rtr: false\nis_extended: false\nis_error: false\ndlc: 3\ndata:\n- 64\n- 24\n- 16\n- 1\n- 0\n- 0\n- 0\n- 0\n---\n";
    const ROS_1: &str = "header: \n  seq: 12\n  stamp: \n    secs: 1700000001\n    nsecs:  5\n  frame_id: ''\nid: 418317056\n\
        is_rtr: False\nis_extended: True\nis_error: False\ndlc: 2\ndata: [1, 2, 0, 0, 0, 0, 0, 0]\n---\n";

    #[test]
    fn messages_of_both_versions() {
        let text = format!("{ROS_2}{ROS_1}").replace('\n', "\r\n");
        let whole = read_capture(text.as_bytes());
        assert_eq!(whole, read_in_pieces(text.as_bytes(), &[1, 20, 3]));
        // 418317056 = 18EF0300h.
        assert_eq!(
            whole.items,
            [
                "{1} (1700000000.250000000) bus0 601#401810 flags=00 dlc=0",
                "{2} (1700000001.000000005) bus1 18EF0300#0102 flags=00 dlc=0",
            ]
        );
        assert_eq!(whole.buses, ["can0", "1"]);
    }

    #[test]
    fn remote_error_and_fd_frames() {
        let message = |rtr: &str, error: &str, length: &str, data: &str| {
            format!(
                "header:\n  stamp:\n    sec: 0\n    nanosec: 0\nid: 4\nis_rtr: {rtr}\nis_extended: false\nis_error: {error}\n\
                 {length}\ndata: {data}\n---\n"
            )
        };
        let bytes: Vec<_> = (0..12).map(|byte| byte.to_string()).collect();
        let text = [
            message("true", "false", "dlc: 2", "[0, 0, 0, 0, 0, 0, 0, 0]"),
            message("false", "true", "dlc: 8", "[0, 16, 0, 0, 0, 0, 0, 0]"),
            message("false", "false", "len: 12", &format!("[{}]", bytes.join(", "))),
        ];
        assert_eq!(
            read_capture(text.concat().as_bytes()).items,
            [
                "{1} bus0 004#R2 flags=01 dlc=0",
                "{2} bus0 00000004#0010000000000000 flags=02 dlc=0",
                "{3} bus0 004#000102030405060708090A0B flags=04 dlc=0",
            ]
        );
    }

    #[test]
    fn broken_messages_cost_one_frame() {
        let broken = [
            ROS_2.replace("id: 1537", "id: 2048"),
            ROS_2.replace("- 16", "- 256"),
            ROS_2.replace("is_rtr: false", "is_rtr: maybe"),
            ROS_1.replace("dlc: 2", "dlc: 9"),
            ROS_1.replace("[1, 2", "1, 2"),
            ROS_2.replace("- 0\n", ""),
            "hello\n---\n".to_owned(),
        ];
        for text in &broken {
            let content = read_capture(format!("{text}{ROS_1}").as_bytes());
            let bad = content.items.iter().filter(|item| item.starts_with("line ")).count();
            assert_eq!((content.frames.len(), bad), (1, 1), "{text}: {:?}", content.items);
            assert_eq!(content.frames[0].data(), [1, 2], "{text}");
        }
        assert!(!(FORMAT.detect)(b"id: 5\ndata: 3\n"));
    }
}
