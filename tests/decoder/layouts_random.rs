//! Layouts drawn at random: frames are written as text and read again.
//!
//! The writer here does not use the reader. It draws the columns, their order, separators, units, names, bases and
//! noise, and leaves out what no reader can know, such as the unit of whole numbers without a name. 400 layouts in each
//! run, 6,000 with `COBSCOPE_FULL`.

use std::env;
use std::fmt::Write as _;

use cobscope_decoder::capture::{Batch, CaptureReader, ReadOptions};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};

/// SplitMix64: the layouts are the same in each run.
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut value = self.0;
        value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        value ^ (value >> 31)
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }

    fn percent(&mut self, share: u64) -> bool {
        self.below(100) < share
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[usize::try_from(self.below(from.len() as u64)).unwrap()]
    }

    fn shuffle<T>(&mut self, list: &mut [T]) {
        for at in (1..list.len()).rev() {
            let other = usize::try_from(self.below(at as u64 + 1)).unwrap();
            list.swap(at, other);
        }
    }
}

/// A frame that is written.
#[derive(Debug, Clone)]
struct Sent {
    time: i64,
    id: CanId,
    data: Vec<u8>,
    is_remote: bool,
    is_transmitted: bool,
    bus: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Column {
    Number,
    Time,
    Bus,
    Direction,
    Kind,
    Name,
    Id,
    Length,
    Data,
    Remark,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum IdStyle {
    /// Three or eight digits.
    Padded,
    Plain,
    Prefixed,
    PrefixedPadded,
    Suffixed,
    Eight,
    FlagBit,
    Decimal,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DataStyle {
    Spaced,
    Packed,
    Prefixed,
    OneDigit,
    Commas,
    Dashes,
    Colons,
    Decimal,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimeStyle {
    Seconds(usize),
    Parentheses,
    Milliseconds,
    MillisecondsFraction,
    Microseconds,
    Clock,
    ClockTenths,
    Iso,
    DateAndClock,
    Suffix,
    Delta,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    /// Columns separated by blanks or marks.
    Words,
    /// A table with a heading.
    Table,
    /// A name before each value.
    Labels,
    /// A name before each value, one line each.
    Lines,
}

#[derive(Debug, Clone)]
struct Drawn {
    shape: Shape,
    columns: Vec<Column>,
    separator: &'static str,
    language: usize,
    id: IdStyle,
    data: DataStyle,
    time: TimeStyle,
    length: &'static str,
    direction: (&'static str, &'static str),
    has_heading: bool,
    is_lower: bool,
    assignment: &'static str,
    noise: u64,
    end: &'static str,
    quote: &'static str,
}

const NAMES: [[&str; 10]; 3] = [
    ["No", "Time", "Channel", "Dir", "Type", "Name", "ID", "DLC", "Data", "Comment"],
    ["Nr.", "Zeit", "Kanal", "Richtung", "Typ", "Name", "Kennung", "Länge", "Daten", "Bemerkung"],
    ["序号", "时间", "通道", "方向", "帧类型", "名称", "帧ID", "数据长度", "数据", "Comment"],
];

impl Drawn {
    fn has(&self, column: Column) -> bool {
        self.columns.contains(&column)
    }
}

#[expect(clippy::too_many_lines, reason = "one draw after the other")]
fn draw_layout(draw: &mut Draw) -> Drawn {
    let shape =
        draw.pick(&[Shape::Words, Shape::Words, Shape::Table, Shape::Table, Shape::Labels, Shape::Lines]);
    let mut columns = vec![Column::Id, Column::Data];
    let mut add = |draw: &mut Draw, column, share| {
        if draw.percent(share) {
            columns.push(column);
        }
    };
    add(draw, Column::Time, 75);
    add(draw, Column::Length, 70);
    add(draw, Column::Direction, 45);
    add(draw, Column::Bus, 25);
    add(draw, Column::Kind, 20);
    if shape != Shape::Lines {
        add(draw, Column::Number, 20);
        add(draw, Column::Name, 15);
    }
    if shape == Shape::Table {
        add(draw, Column::Remark, 20);
    }
    let has_length = columns.contains(&Column::Length);
    let has_time = columns.contains(&Column::Time);
    draw.shuffle(&mut columns);
    let is_named = shape != Shape::Words;
    let has_heading = shape == Shape::Table || (shape == Shape::Words && draw.percent(35));
    let id = loop {
        let style = draw.pick(&[
            IdStyle::Padded,
            IdStyle::Padded,
            IdStyle::Plain,
            IdStyle::Prefixed,
            IdStyle::PrefixedPadded,
            IdStyle::Suffixed,
            IdStyle::Eight,
            IdStyle::FlagBit,
            IdStyle::Decimal,
        ]);
        // Only a heading states that identifiers are decimal.
        if (style != IdStyle::Decimal || shape == Shape::Table)
            && (style != IdStyle::Plain || is_named || has_length)
        {
            break style;
        }
    };
    let data = loop {
        let style = draw.pick(&[
            DataStyle::Spaced,
            DataStyle::Spaced,
            DataStyle::Spaced,
            DataStyle::Packed,
            DataStyle::Packed,
            DataStyle::Prefixed,
            DataStyle::OneDigit,
            DataStyle::Commas,
            DataStyle::Dashes,
            DataStyle::Colons,
            DataStyle::Decimal,
        ]);
        if style != DataStyle::Decimal || shape == Shape::Table {
            break style;
        }
    };
    let time = loop {
        let style = draw.pick(&[
            TimeStyle::Seconds(3),
            TimeStyle::Seconds(4),
            TimeStyle::Seconds(6),
            TimeStyle::Parentheses,
            TimeStyle::Milliseconds,
            TimeStyle::MillisecondsFraction,
            TimeStyle::Microseconds,
            TimeStyle::Clock,
            TimeStyle::ClockTenths,
            TimeStyle::Iso,
            TimeStyle::DateAndClock,
            TimeStyle::Suffix,
            TimeStyle::Delta,
        ]);
        // The unit of a number of ms or µs needs a name.
        let needs_name = matches!(
            style,
            TimeStyle::Milliseconds
                | TimeStyle::MillisecondsFraction
                | TimeStyle::Microseconds
                | TimeStyle::Delta
        );
        if !needs_name || is_named || has_heading {
            break style;
        }
    };
    let separator = match shape {
        Shape::Table => draw.pick(&[";", ",", "\t", "|", " | "]),
        _ => draw.pick(&[" ", "  ", "\t", " | ", ", ", " ; ", "   "]),
    };
    let mut drawn = Drawn {
        shape,
        columns,
        separator,
        language: usize::try_from(draw.below(3)).unwrap(),
        id,
        data,
        time,
        length: draw.pick(&["", "", "[]", "()", "0x"]),
        direction: draw.pick(&[
            ("Rx", "Tx"),
            ("RX", "TX"),
            ("rx", "tx"),
            ("R", "T"),
            ("<-", "->"),
            ("接收", "发送"),
        ]),
        has_heading,
        is_lower: draw.percent(30),
        assignment: draw.pick(&[": ", ":", "=", " = "]),
        noise: draw.pick(&[0, 0, 0, 5, 12]),
        end: draw.pick(&["\n", "\n", "\r\n"]),
        quote: draw.pick(&["", "", "", "> "]),
    };
    restrict(&mut drawn, draw, has_time);
    drawn
}

/// Leaves out combinations in which the text does not determine the frames.
fn restrict(drawn: &mut Drawn, draw: &mut Draw, has_time: bool) {
    // Commas between bytes next to commas between cells.
    if drawn.separator.contains(',') && matches!(drawn.data, DataStyle::Commas) {
        drawn.data = DataStyle::Spaced;
    }
    if drawn.shape == Shape::Words {
        // Bytes of unknown number end the line, unless words or a time follow.
        drawn.columns.retain(|column| *column != Column::Data);
        let tail = draw.below(4);
        if tail == 0 && drawn.has(Column::Direction) && drawn.direction.0 != "R" {
            drawn.columns.retain(|column| *column != Column::Direction);
            drawn.columns.extend([Column::Data, Column::Direction]);
        } else {
            drawn.columns.push(Column::Data);
        }
        // A name of letters next to other words of a meaning is not drawn: no reader can separate them.
        if drawn.has(Column::Name)
            && (drawn.has(Column::Direction) || drawn.has(Column::Kind) || drawn.has(Column::Bus))
        {
            drawn.columns.retain(|column| *column != Column::Name);
        }
        // This is the screen form of candump, in which eight digits are an extended identifier.
        if drawn.columns == [Column::Bus, Column::Id, Column::Length, Column::Data]
            && drawn.id == IdStyle::Eight
        {
            drawn.id = IdStyle::Padded;
        }
        if drawn.direction.0 == "R" && drawn.has(Column::Kind) {
            drawn.direction = ("Rx", "Tx");
        }
    }
    if drawn.shape == Shape::Table && drawn.has_heading && drawn.time == TimeStyle::DateAndClock && has_time {
        drawn.time = TimeStyle::Iso;
    }
    if drawn.shape == Shape::Lines {
        // The first line of a frame has a name.
        let is_plain = |column: &Column| matches!(column, Column::Direction | Column::Kind | Column::Name);
        drawn.columns.sort_by_key(is_plain);
        if drawn.time == TimeStyle::DateAndClock {
            drawn.time = TimeStyle::Iso;
        }
    }
    // Numbers with a mark of their own.
    if drawn.id == IdStyle::Decimal {
        drawn.columns.retain(|column| *column != Column::Kind);
    }
}

fn draw_frames(draw: &mut Draw, drawn: &Drawn) -> Vec<Sent> {
    let count = 12 + draw.below(30);
    let ids: Vec<(CanId, usize)> = (0..3 + draw.below(5))
        .map(|_| {
            let id = if draw.percent(60) {
                CanId::from_standard(u16::try_from(draw.below(0x7F0) + 1).unwrap())
            } else {
                CanId::from_extended(u32::try_from(0x1000 + draw.below(0x1FFF_0000 - 0x1000)).unwrap())
            };
            (id, usize::try_from(if draw.percent(50) { 8 } else { draw.below(9) }).unwrap())
        })
        .collect();
    // The number of bytes of CAN FD, and the frame type without bytes, need a length.
    let has_length = drawn.has(Column::Length);
    let is_fd = has_length && draw.percent(15);
    let has_remote = has_length && drawn.shape != Shape::Lines && draw.percent(15);
    let mut time = 1_000_000 * i64::try_from(draw.below(50_000)).unwrap();
    let may_be_empty = drawn.has(Column::Length)
        || drawn.shape == Shape::Table
        || drawn.shape == Shape::Lines
        || drawn.shape == Shape::Labels;
    (0..count)
        .map(|number| {
            time += i64::try_from(100_000 + draw.below(19_900_000)).unwrap();
            let (id, size) = draw.pick(&ids);
            let size = if may_be_empty { size } else { size.max(1) };
            let size = if is_fd && draw.percent(40) { draw.pick(&FD_SIZES) } else { size };
            Sent {
                time,
                id,
                data: (0..size).map(|_| u8::try_from(draw.below(256)).unwrap()).collect(),
                is_remote: has_remote && (1..=8).contains(&size) && draw.percent(10),
                // `R` alone may be a direction or a remote frame.
                is_transmitted: if number < 2 { number == 0 } else { draw.percent(30) },
                bus: u8::try_from(1 + draw.below(2)).unwrap(),
            }
        })
        .collect()
}

/// Lengths of CAN FD above those of classical CAN (ISO 11898-1).
const FD_SIZES: [usize; 7] = [12, 16, 20, 24, 32, 48, 64];

/// Time as the style can express it.
fn rounded(time: i64, style: TimeStyle) -> i64 {
    let unit = match style {
        TimeStyle::Seconds(digits) => 10_i64.pow(9 - u32::try_from(digits).unwrap()),
        TimeStyle::Parentheses | TimeStyle::Microseconds | TimeStyle::Delta => 1_000,
        TimeStyle::MillisecondsFraction | TimeStyle::ClockTenths | TimeStyle::Suffix => 100_000,
        _ => 1_000_000,
    };
    time - time % unit
}

/// Day of all dates: 2024-05-01 in days since 1970.
const DAY: i64 = 19_844 * 86_400 * 1_000_000_000;

fn time_text(time: i64, before: i64, style: TimeStyle) -> String {
    let (seconds, rest) = (time / 1_000_000_000, time % 1_000_000_000);
    let (hour, minute, second) = (seconds / 3_600, seconds / 60 % 60, seconds % 60);
    match style {
        TimeStyle::Seconds(digits) => format!("{seconds}.{}", &format!("{rest:09}")[..digits]),
        TimeStyle::Parentheses => format!("({seconds}.{:06})", rest / 1_000),
        TimeStyle::Milliseconds => format!("{}", time / 1_000_000),
        TimeStyle::MillisecondsFraction => format!("{}.{}", time / 1_000_000, time / 100_000 % 10),
        TimeStyle::Microseconds => format!("{}", time / 1_000),
        TimeStyle::Clock => format!("{hour:02}:{minute:02}:{second:02}.{:03}", rest / 1_000_000),
        TimeStyle::ClockTenths => format!("{hour:02}:{minute:02}:{second:02}:{:04}", rest / 100_000),
        TimeStyle::Iso => format!("2024-05-01T{hour:02}:{minute:02}:{second:02}.{:03}Z", rest / 1_000_000),
        TimeStyle::DateAndClock => {
            format!("2024-05-01 {hour:02}:{minute:02}:{second:02}.{:03}", rest / 1_000_000)
        }
        TimeStyle::Suffix => format!("{}.{}ms", time / 1_000_000, time / 100_000 % 10),
        TimeStyle::Delta => {
            let delta = time - before;
            format!("{}.{:06}", delta / 1_000_000_000, delta % 1_000_000_000 / 1_000)
        }
    }
}

fn id_text(id: CanId, style: IdStyle) -> String {
    let (number, is_extended) = match id {
        CanId::Standard(id) => (u32::from(id), false),
        CanId::Extended(id) => (id, true),
    };
    match style {
        IdStyle::Padded => id.to_string(),
        IdStyle::Plain => format!("{number:X}"),
        IdStyle::Prefixed => format!("0x{number:X}"),
        IdStyle::PrefixedPadded => format!("0x{id}"),
        IdStyle::Suffixed => format!("{id}h"),
        IdStyle::Eight => format!("{number:08X}"),
        IdStyle::FlagBit => format!("0x{:X}", if is_extended { number | 0x8000_0000 } else { number }),
        IdStyle::Decimal => number.to_string(),
    }
}

fn data_text(data: &[u8], style: DataStyle) -> String {
    let all =
        |one: fn(&u8) -> String, separator: &str| data.iter().map(one).collect::<Vec<_>>().join(separator);
    match style {
        DataStyle::Spaced => all(|byte| format!("{byte:02X}"), " "),
        DataStyle::Packed => all(|byte| format!("{byte:02X}"), ""),
        DataStyle::Prefixed => all(|byte| format!("0x{byte:02X}"), " "),
        DataStyle::OneDigit => all(|byte| format!("{byte:X}"), " "),
        DataStyle::Commas => all(|byte| format!("{byte:02X}"), ","),
        DataStyle::Dashes => all(|byte| format!("{byte:02X}"), "-"),
        DataStyle::Colons => all(|byte| format!("{byte:02X}"), ":"),
        DataStyle::Decimal => all(u8::to_string, " "),
    }
}

fn field(drawn: &Drawn, column: Column, frame: &Sent, before: i64, number: usize) -> String {
    let cased = |text: String| if drawn.is_lower { text.to_lowercase() } else { text };
    match column {
        Column::Number => (number + 1).to_string(),
        Column::Time => time_text(rounded(frame.time, drawn.time), before, drawn.time),
        Column::Bus if drawn.shape == Shape::Words => format!("can{}", frame.bus),
        Column::Bus => frame.bus.to_string(),
        Column::Direction => {
            (if frame.is_transmitted { drawn.direction.1 } else { drawn.direction.0 }).into()
        }
        Column::Kind => (if matches!(frame.id, CanId::Extended(_)) { "Ext" } else { "Std" }).into(),
        Column::Name => ["Motor_Status", "Lift", "Pump_2x", "Steering"][frame.data.len() % 4].into(),
        Column::Id => cased(id_text(frame.id, drawn.id)),
        Column::Length => match drawn.length {
            "[]" => format!("[{}]", frame.data.len()),
            "()" => format!("({})", frame.data.len()),
            "0x" => format!("0x{:02X}", frame.data.len()),
            _ => frame.data.len().to_string(),
        },
        Column::Data if frame.is_remote => "RTR".into(),
        Column::Data => cased(data_text(&frame.data, drawn.data)),
        Column::Remark => ["", "first try", "ok"][number % 3].into(),
    }
}

fn heading(drawn: &Drawn, column: Column) -> String {
    let name = NAMES[drawn.language][column as usize];
    let unit = match column {
        Column::Time => match drawn.time {
            TimeStyle::Milliseconds | TimeStyle::MillisecondsFraction => " (ms)",
            TimeStyle::Microseconds => " [us]",
            TimeStyle::Seconds(_) if drawn.language == 1 => " [s]",
            TimeStyle::Delta => return "Delta (s)".into(),
            _ => "",
        },
        Column::Id if drawn.id == IdStyle::Decimal => " (dec)",
        // Decimal bytes leave the base of plain identifiers open.
        Column::Id if drawn.data == DataStyle::Decimal => " (hex)",
        Column::Data if drawn.data == DataStyle::Decimal => " (dec)",
        _ => "",
    };
    format!("{name}{unit}")
}

fn label(drawn: &Drawn, column: Column) -> String {
    match column {
        // Words of these columns need no name.
        Column::Direction | Column::Kind | Column::Name => String::new(),
        Column::Time if matches!(drawn.time, TimeStyle::DateAndClock) => String::new(),
        column => format!("{}{}", heading(drawn, column), drawn.assignment),
    }
}

fn write_capture(draw: &mut Draw, drawn: &Drawn, frames: &[Sent]) -> String {
    let mut text = String::new();
    let mut line = |content: &str| write!(text, "{}{content}{}", drawn.quote, drawn.end).unwrap();
    if drawn.has_heading {
        let names: Vec<String> = drawn.columns.iter().map(|column| heading(drawn, *column)).collect();
        line(&names.join(if drawn.shape == Shape::Table { drawn.separator } else { "   " }));
    }
    let mut before = 0;
    for (number, frame) in frames.iter().enumerate() {
        if draw.percent(drawn.noise) {
            line(draw.pick(&["", "battery ok", "--- restart ---", "waiting for the controller"]));
        }
        let values: Vec<String> = drawn
            .columns
            .iter()
            .map(|column| {
                let value = field(drawn, *column, frame, before, number);
                let named = matches!(drawn.shape, Shape::Labels | Shape::Lines);
                if named { format!("{}{value}", label(drawn, *column)) } else { value }
            })
            .collect();
        if drawn.shape == Shape::Lines {
            for value in &values {
                line(value);
            }
        } else {
            line(&values.join(drawn.separator));
        }
        before = rounded(frame.time, drawn.time);
    }
    text
}

/// The result of reading a text.
enum Outcome {
    Refused(String),
    Read(Vec<Frame>, Vec<String>),
}

fn read(text: &str) -> Outcome {
    let mut reader = match CaptureReader::open(text.as_bytes(), &ReadOptions::default()) {
        Ok(reader) => reader,
        Err(error) => return Outcome::Refused(error.to_string()),
    };
    let (mut batch, mut frames) = (Batch::new(), Vec::new());
    while reader.read(&mut batch).unwrap() {
        frames.extend_from_slice(batch.frames());
    }
    Outcome::Read(frames, reader.buses().names().to_vec())
}

/// The first difference between the frames written and read.
fn difference(drawn: &Drawn, sent: &[Sent], frames: &[Frame], buses: &[String]) -> Option<String> {
    if sent.len() != frames.len() {
        return Some(format!("{} frames of {}", frames.len(), sent.len()));
    }
    for (index, (sent, found)) in sent.iter().zip(frames).enumerate() {
        let content = (
            found.id,
            usize::from(found.length),
            found.flags.contains(FrameFlags::REMOTE),
            found.flags.contains(FrameFlags::FD),
        );
        let is_equal = content == (sent.id, sent.data.len(), sent.is_remote, sent.data.len() > 8)
            && (sent.is_remote || sent.data == found.data());
        let time = found.time.map(|time| time.0);
        let mut expected = drawn.has(Column::Time).then(|| rounded(sent.time, drawn.time));
        if matches!(drawn.time, TimeStyle::Iso | TimeStyle::DateAndClock) {
            expected = expected.map(|time| time + DAY);
        }
        let directions = found.flags.0 & (FrameFlags::TRANSMITTED.0 | FrameFlags::RECEIVED.0);
        let direction = match (drawn.has(Column::Direction), sent.is_transmitted) {
            (false, _) => 0,
            (true, true) => FrameFlags::TRANSMITTED.0,
            (true, false) => FrameFlags::RECEIVED.0,
        };
        let bus = &buses[usize::from(found.bus.0)];
        let expected_bus = match (drawn.has(Column::Bus), drawn.shape) {
            (true, Shape::Words) => format!("can{}", sent.bus),
            (true, _) => sent.bus.to_string(),
            (false, _) => "1".into(),
        };
        if !is_equal || time != expected || directions != direction || *bus != expected_bus {
            return Some(format!(
                "frame {index}: sent {sent:?}, time {expected:?}; found {found:?} on {bus}"
            ));
        }
    }
    None
}

#[test]
fn layouts_drawn_at_random_are_read_or_refused() {
    let count = if env::var_os("COBSCOPE_FULL").is_some() { 6_000 } else { 400 };
    let (mut refused, mut wrong) = (Vec::new(), Vec::new());
    for seed in 0..count {
        let mut draw = Draw(seed);
        let drawn = draw_layout(&mut draw);
        let frames = draw_frames(&mut draw, &drawn);
        let text = write_capture(&mut draw, &drawn, &frames);
        let start: String = text.lines().take(7).fold(String::new(), |all, line| all + line + "\n");
        if let Some(folder) = env::var_os("COBSCOPE_LAYOUT_DUMP") {
            std::fs::write(std::path::Path::new(&folder).join(format!("{seed}.txt")), &text).unwrap();
        }
        match read(&text) {
            Outcome::Refused(reason) => {
                let reason = reason.split_once("it begins with").map_or(reason.as_str(), |(_, rest)| rest);
                refused.push(format!("seed {seed}: {drawn:?}\n{start}{reason}\n"));
            }
            Outcome::Read(found, buses) => {
                if let Some(difference) = difference(&drawn, &frames, &found, &buses) {
                    wrong.push(format!("seed {seed}: {drawn:?}\n{start}{difference}\n"));
                }
            }
        }
    }
    if let Some(path) = env::var_os("COBSCOPE_LAYOUT_REPORT") {
        let all = format!("{}\n=== REFUSED\n{}", wrong.join("\n"), refused.join("\n"));
        std::fs::write(path, all).unwrap();
    }
    assert!(wrong.is_empty(), "{} of {count} read wrong; first: {}", wrong.len(), wrong[0]);
    let limit = usize::try_from(count / 100).unwrap();
    assert!(refused.len() <= limit, "{} of {count} refused; first: {}", refused.len(), refused[0]);
}
