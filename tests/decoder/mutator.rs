//! Changes captures by deterministic operators, one per line of text.
//!
//! ```text
//! drop: SELECTOR                          frames are missing
//! insert: 085#1010010000000000 at 50%     a frame is inserted; times 3 every 100ms
//! delay: SELECTOR by 40ms                 frames are later, or earlier by -40ms
//! set: SELECTOR byte 1 is FF              bytes of the payload, counted from 1
//! cut: SELECTOR length 4                  the payload is shorter
//! append: SELECTOR is 00                  the payload is longer
//! duplicate: SELECTOR by 1ms              frames are repeated
//! swap: SELECTOR                          first and second, third and fourth exchange their payloads
//! rename: SELECTOR as 1A5                 another identifier
//! write: 2/5B00:00 is 2003 at 1.5s        SDO write to node 2, with its confirmation; times and every as for insert
//! read: 2/2001:00 is 03000000 at 1.5s     SDO read of node 2, with its response
//! ```
//!
//! A selector is an identifier (`705`, `18FECA80`), a sender (`node:5` of CANopen, `sa:80` of J1939) or `*`,
//! optionally with the start of the payload (`585#43`, a dot is any digit), followed by any of `from 50%`,
//! `to 2.5s`, `nth 3`, `count 2`. Times are a percentage of the capture or seconds since its start.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::fmt::Write as _;

/// A line of a capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// Time in µs.
    pub time: i64,
    /// Name of the bus.
    pub bus: String,
    /// Identifier in the notation of candump: three digits or eight.
    pub id: String,
    /// Text after the `#`: payload, `R`, or `#` and the rest of a CAN FD frame.
    pub body: String,
}

impl Line {
    fn new(time: i64, bus: &str, frame: &str) -> Self {
        let (id, body) = frame.split_once('#').unwrap_or_else(|| panic!("no frame: {frame}"));
        Self { time, bus: bus.into(), id: id.into(), body: body.into() }
    }

    /// Whether the body is a payload that can be changed.
    pub fn has_payload(&self) -> bool {
        self.body.bytes().all(|byte| byte.is_ascii_hexdigit())
    }
}

/// The frames of a capture in candump's log form.
pub fn lines(text: &str) -> Vec<Line> {
    let mut lines = Vec::new();
    for line in text.lines().filter(|line| line.starts_with('(')) {
        let mut words = line.split_whitespace();
        let stamp = words.next().unwrap().trim_matches(['(', ')']);
        let (seconds, micros) = stamp.split_once('.').unwrap();
        let time = seconds.parse::<i64>().unwrap() * 1_000_000 + micros.parse::<i64>().unwrap();
        lines.push(Line::new(time, words.next().unwrap(), words.next().unwrap()));
    }
    lines
}

/// The reverse of [`lines`].
pub fn text(lines: &[Line]) -> String {
    let mut text = String::new();
    for Line { time, bus, id, body } in lines {
        let (seconds, micros) = (time.div_euclid(1_000_000), time.rem_euclid(1_000_000));
        writeln!(text, "({seconds}.{micros:06}) {bus} {id}#{body}").unwrap();
    }
    text
}

/// Parsed words of an operator: the selector, then keys with their values.
struct OperatorWords<'a> {
    first: &'a str,
    keys: Vec<(&'a str, &'a str)>,
    begin: i64,
    end: i64,
}

impl<'a> OperatorWords<'a> {
    fn new(text: &'a str, lines: &[Line]) -> Self {
        let mut words = text.split_whitespace();
        let first = words.next().unwrap_or_else(|| panic!("nothing to change: {text}"));
        let mut keys = Vec::new();
        while let Some(key) = words.next() {
            keys.push((key, words.next().unwrap_or_else(|| panic!("nothing behind {key}: {text}"))));
        }
        let known =
            ["from", "to", "nth", "count", "at", "times", "every", "by", "byte", "is", "length", "as"];
        for (key, _) in &keys {
            assert!(known.contains(key), "{key}: {text}");
        }
        let begin = lines.first().map_or(0, |line| line.time);
        let end = lines.last().map_or(0, |line| line.time);
        Self { first, keys, begin, end }
    }

    fn get(&self, key: &str) -> Option<&'a str> {
        self.keys.iter().find(|(known, _)| *known == key).map(|(_, value)| *value)
    }

    fn need(&self, key: &str) -> &'a str {
        self.get(key).unwrap_or_else(|| panic!("{}: no '{key}'", self.first))
    }

    fn number(&self, key: &str) -> Option<usize> {
        self.get(key).map(|value| value.parse().unwrap_or_else(|_| panic!("{key} {value}")))
    }

    /// A time as `50%` or `2.5s`.
    fn moment(&self, key: &str) -> Option<i64> {
        let value = self.get(key)?;
        let share = value.strip_suffix('%').map(|share| share.parse::<i64>().unwrap());
        let span = self.end - self.begin;
        Some(self.begin + share.map_or_else(|| micros(value), |share| span * share / 100))
    }

    /// Indexes of the selected frames.
    fn places(&self, lines: &[Line]) -> Vec<usize> {
        let (id, prefix) = self.first.split_once('#').unwrap_or((self.first, ""));
        let from = self.moment("from").unwrap_or(i64::MIN);
        let to = self.moment("to").unwrap_or(i64::MAX);
        let fits = |line: &Line| {
            let mut digits = line.body.chars();
            (from..=to).contains(&line.time)
                && is_of(line, id)
                && prefix.chars().all(|digit| digits.next().is_some_and(|it| digit == '.' || it == digit))
        };
        let all: Vec<_> = lines.iter().enumerate().filter(|(_, line)| fits(line)).map(|(at, _)| at).collect();
        let skip = self.number("nth").map_or(0, |nth| nth - 1);
        let count = self.number("count").or(self.number("nth").map(|_| 1)).unwrap_or(usize::MAX);
        all.into_iter().skip(skip).take(count).collect()
    }
}

fn is_of(line: &Line, id: &str) -> bool {
    if let Some(node) = id.strip_prefix("node:") {
        let node = node.parse::<u16>().unwrap();
        let cob_id = if line.id.len() == 3 { u16::from_str_radix(&line.id, 16).unwrap() } else { 0 };
        return cob_id & 0x7F == node
            && matches!(cob_id & 0x780, 0x080 | 0x180 | 0x280 | 0x380 | 0x480 | 0x580 | 0x700);
    }
    match id.strip_prefix("sa:") {
        Some(address) => line.id.len() == 8 && line.id.ends_with(address),
        None => id == "*" || line.id == id,
    }
}

/// A random generator with the same numbers in every run.
pub struct Dice(u64);

impl Dice {
    /// Generator with the numbers of a seed.
    pub fn new(seed: u64) -> Self {
        Self(0x9E37_79B9_7F4A_7C15 ^ (seed + 1))
    }

    /// A number of 64 bits.
    pub fn number(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A number below `sides`, 0 if there are none.
    pub fn roll(&mut self, sides: usize) -> usize {
        usize::try_from(self.number() >> 33).unwrap() % sides.max(1)
    }
}

/// Microseconds of `40ms` or `-1.5s`.
pub fn micros(text: &str) -> i64 {
    let (digits, unit) = match text.strip_suffix("ms") {
        Some(digits) => (digits, 1_000),
        None => (text.strip_suffix('s').unwrap_or_else(|| panic!("no time: {text}")), 1_000_000),
    };
    let (whole, part) = digits.split_once('.').unwrap_or((digits, "0"));
    let sign = if whole.starts_with('-') { -1 } else { 1 };
    let part = part.parse::<i64>().unwrap() * unit / 10_i64.pow(u32::try_from(part.len()).unwrap());
    whole.parse::<i64>().unwrap() * unit + sign * part
}

/// Time from a request to its response, in µs.
const ANSWER: i64 = 1_300;

/// Request and response of an expedited transfer (CiA 301 7.2.4.3): `2/5B00:00`, bytes in order of
/// transmission.
fn expedited(operator: &str, what: &str, bytes: &str) -> Vec<String> {
    let (node, object) = what.split_once('/').unwrap_or_else(|| panic!("no node: {what}"));
    let (index, sub) = object.split_once(':').unwrap_or_else(|| panic!("no sub-index: {what}"));
    let node: u16 = node.parse().unwrap();
    let object = format!("{}{}{sub}", &index[2..], &index[..2]);
    let unused = 4 - bytes.len() / 2;
    let (request, answer) = match operator {
        "write" => (format!("{:02X}{object}{bytes:0<8}", 0x23 | unused << 2), format!("60{object}00000000")),
        _ => (format!("40{object}00000000"), format!("{:02X}{object}{bytes:0<8}", 0x43 | unused << 2)),
    };
    vec![format!("{:03X}#{request}", 0x600 + node), format!("{:03X}#{answer}", 0x580 + node)]
}

/// Applies an operator; panics if it changes nothing.
pub fn apply(step: &str, lines: &mut Vec<Line>) {
    let (operator, rest) = step.split_once(": ").unwrap_or_else(|| panic!("no operator: {step}"));
    let words = OperatorWords::new(rest, lines);
    let inserted = match operator {
        "insert" => Some(vec![words.first.to_owned()]),
        "write" | "read" => Some(expedited(operator, words.first, words.need("is"))),
        _ => None,
    };
    if let Some(frames) = inserted {
        let time = words.moment("at").unwrap_or_else(|| panic!("no 'at': {step}"));
        let every = words.get("every").map_or(0, micros);
        let bus = lines.first().map_or_else(|| "can0".to_owned(), |line| line.bus.clone());
        let times = i64::try_from(words.number("times").unwrap_or(1)).unwrap();
        for number in 0..times {
            let begin = time + number * every;
            lines.extend(
                frames.iter().zip(0..).map(|(frame, at)| Line::new(begin + at * ANSWER, &bus, frame)),
            );
        }
    } else {
        let places = words.places(lines);
        assert!(!places.is_empty(), "{step}: no such frames");
        change(operator, &words, &places, lines);
    }
    // Stable: inserted frames follow those with the same time.
    lines.sort_by_key(|line| line.time);
}

fn change(operator: &str, words: &OperatorWords<'_>, places: &[usize], lines: &mut Vec<Line>) {
    match operator {
        "drop" => places.iter().rev().for_each(|place| drop(lines.remove(*place))),
        "delay" => {
            let by = micros(words.need("by"));
            for place in places {
                lines[*place].time += by;
            }
        }
        "duplicate" => {
            let by = micros(words.need("by"));
            for place in places {
                let line = lines[*place].clone();
                lines.push(Line { time: line.time + by, ..line });
            }
        }
        "set" => {
            let at = (words.number("byte").unwrap() - 1) * 2;
            let bytes = words.need("is");
            for place in places {
                let body = &mut lines[*place].body;
                assert!(body.len() >= at + bytes.len(), "{body} is shorter");
                body.replace_range(at..at + bytes.len(), bytes);
            }
        }
        "cut" => {
            let length = words.number("length").unwrap() * 2;
            for place in places {
                lines[*place].body.truncate(length);
            }
        }
        "append" => {
            for place in places {
                lines[*place].body.push_str(words.need("is"));
            }
        }
        "swap" => {
            for pair in places.chunks_exact(2) {
                let one = std::mem::take(&mut lines[pair[0]].body);
                let other = std::mem::replace(&mut lines[pair[1]].body, one);
                lines[pair[0]].body = other;
            }
        }
        "rename" => {
            let id = words.need("as");
            for place in places {
                id.clone_into(&mut lines[*place].id);
            }
        }
        _ => panic!("no operator: {operator}"),
    }
}

#[test]
fn operators_change_what_they_say() {
    let of = |frames: &str| {
        let frame = |(number, frame): (usize, &str)| format!("({number}.000000) can0 {frame}\n");
        lines(&frames.split(' ').enumerate().map(frame).collect::<String>())
    };
    let changed = |step: &str, frames: &str| {
        let mut lines = of(frames);
        apply(step, &mut lines);
        let reported = lines.iter().map(|line| format!("{}#{}", line.id, line.body));
        reported.collect::<Vec<_>>().join(" ")
    };
    let frames = "705#05 185#0102 585#4310 185#0304 18FECA80#00";
    assert_eq!(changed("drop: node:5 from 2s", frames), "705#05 185#0102 18FECA80#00");
    assert_eq!(changed("drop: sa:80", frames), "705#05 185#0102 585#4310 185#0304");
    assert_eq!(changed("set: 185#.3 byte 2 is FF", frames), frames.replace("0304", "03FF"));
    assert_eq!(changed("cut: 185 length 1", frames), frames.replace("0102", "01").replace("0304", "03"));
    assert_eq!(changed("append: 585 is 00", frames), frames.replace("4310", "431000"));
    assert_eq!(
        changed("swap: 185", frames),
        frames.replace("0102", "x").replace("0304", "0102").replace('x', "0304")
    );
    assert_eq!(changed("rename: * nth 3 as 5AA", frames), frames.replace("585", "5AA"));
    assert_eq!(changed("delay: 705 by 1.5s", frames), "185#0102 705#05 585#4310 185#0304 18FECA80#00");
    assert_eq!(changed("duplicate: 705 by 1ms", frames), format!("705#05 {frames}"));
    let inserted = changed("insert: 080# at 50% times 2 every 1s", frames);
    assert_eq!(inserted, "705#05 185#0102 585#4310 080# 185#0304 080# 18FECA80#00");
    assert_eq!(
        changed("write: 5/5B00:01 is 2003 at 3.5s", frames),
        frames.replace(" 18F", " 605#2B005B0120030000 585#60005B0100000000 18F")
    );
    assert_eq!(
        changed("read: 5/2001:00 is 03000000 at 3.5s", frames),
        frames.replace(" 18F", " 605#4001200000000000 585#4301200003000000 18F")
    );
    assert_eq!(text(&of(frames)).lines().count(), 5);
}
