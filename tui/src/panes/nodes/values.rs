//! Set points with their actual values, shortened to the available width.
//!
//! ```text
//! p 125.0→124.2 bar/250  angle +50.0→+49.4 %      full
//! p 125.0→124.2 bar angle +50.0→+49.4 %
//! p 125→124bar angle +50→+49%                     without decimals
//! p 125→124 angle +50→+49
//! ```

use std::fmt::Write as _;

use cobscope_decoder::profile::{DecodedSignal, ObjectMeaning, ObjectRole, PayloadLayout, PdoDirection};
use cobscope_decoder::session::{EmittedSetPoint, Node};
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::wire::canopen::ObjectAddress;

use crate::widgets::draw;

/// Content of the column `Set → actual`.
#[derive(Debug, Clone, Default)]
pub struct SetActualValues {
    /// Set points and actual values.
    pub pairs: Vec<SetActualPair>,
    /// Text instead of the values, or after them.
    pub remark: String,
    /// Short form of the remark.
    pub brief: String,
}

/// A set point with its actual value.
#[derive(Debug, Clone, Default)]
pub struct SetActualPair {
    object: Option<ObjectAddress>,
    short: String,
    set: Option<ShortNumber>,
    actual: Option<ShortNumber>,
    /// Value of the full scale, if an object contains it.
    full_scale: Option<f64>,
}

#[derive(Debug, Clone)]
struct ShortNumber {
    text: String,
    unit: String,
    is_assumed: bool,
}

impl ShortNumber {
    fn new(text: &str, meaning: &ObjectMeaning, is_assumed: bool) -> Self {
        let unit = meaning.unit.as_str();
        let plain = text.strip_suffix(unit).filter(|_| !unit.is_empty()).map(str::trim_end);
        Self {
            text: escape(plain.unwrap_or(text)).into_owned(),
            unit: if plain.is_some() { escape(unit).into_owned() } else { String::new() },
            is_assumed,
        }
    }

    /// The value without decimals.
    fn rounded_text(&self) -> String {
        let sign = if self.text.starts_with('+') { "+" } else { "" };
        let Ok(number) = self.text.parse::<f64>() else { return self.text.clone() };
        match format!("{number:.0}").as_str() {
            "0" | "-0" => "0".to_owned(),
            number => format!("{sign}{number}"),
        }
    }

    fn doubt_mark(&self) -> &'static str {
        if self.is_assumed { "?" } else { "" }
    }
}

/// Steps of shortening, in order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Abbreviation {
    Full,
    Close,
    Rounded,
    Unitless,
    Nameless,
}

impl SetActualValues {
    /// Values of one output, or of the whole node without a `channel`.
    pub fn values_of(node: &Node, channel: Option<u8>, rows: &[&IdentifierRow]) -> Self {
        let mut pairs: Vec<SetActualPair> = Vec::new();
        for point in node.set_points().filter(|point| is_of(channel, point.meaning.channel)) {
            pairs.push(SetActualPair::from_set_point(&point));
        }
        for (signal, meaning) in actual_values(rows).filter(|(_, meaning)| is_of(channel, meaning.channel)) {
            let is_assumed = meaning.assumed;
            let number = ShortNumber::new(&meaning.format_signed(&signal.value), meaning, is_assumed);
            let followed = pairs.iter_mut().find(|pair| pair.belongs_to(meaning) && pair.actual.is_none());
            match followed {
                Some(pair) => pair.actual = Some(number),
                None => pairs.push(SetActualPair {
                    short: short_name(meaning),
                    actual: Some(number),
                    ..SetActualPair::default()
                }),
            }
        }
        pairs.iter_mut().for_each(SetActualPair::align_signs);
        Self { pairs, ..Self::default() }
    }

    /// A remark without values.
    pub fn remark_only(text: impl Into<String>, brief: impl Into<String>) -> Self {
        Self { pairs: Vec::new(), remark: text.into(), brief: brief.into() }
    }

    /// The longest form that fits. A remark takes precedence over decimals and names, values over the remark.
    pub fn fit_width(&self, width: u16, arrow: &str) -> String {
        if self.pairs.is_empty() {
            let is_long = draw::text_width(&self.remark) > width && !self.brief.is_empty();
            return if is_long { self.brief.clone() } else { self.remark.clone() };
        }
        let all = [
            Abbreviation::Full,
            Abbreviation::Close,
            Abbreviation::Rounded,
            Abbreviation::Unitless,
            Abbreviation::Nameless,
        ];
        let texts = all.map(|brevity| self.values_text(brevity, arrow));
        let fits = |text: &&String| draw::text_width(text) <= width;
        if !self.remark.is_empty() {
            let remarked = texts.each_ref().map(|text| format!("{text}  {}", self.remark));
            if let Some(text) = remarked.iter().find(fits) {
                return text.clone();
            }
        }
        let [.., shortest] = &texts;
        texts.iter().find(fits).unwrap_or(shortest).clone()
    }

    fn values_text(&self, brevity: Abbreviation, arrow: &str) -> String {
        let between = if brevity == Abbreviation::Full { "  " } else { " " };
        // An actual value without a set point is dropped first.
        let has_set = self.pairs.iter().any(|pair| pair.set.is_some());
        let pairs =
            self.pairs.iter().filter(|pair| pair.set.is_some() || brevity == Abbreviation::Full || !has_set);
        let pairs: Vec<_> = pairs.collect();
        let words: Vec<_> =
            pairs.iter().map(|pair| pair.values_text(brevity, arrow, pairs.len() == 1)).collect();
        words.join(between)
    }
}

impl SetActualPair {
    fn from_set_point(point: &EmittedSetPoint<'_>) -> Self {
        let meaning = point.meaning;
        let scale = meaning.scale.and_then(|scale| scale.full_scale).filter(|_| !meaning.assumed);
        Self {
            object: Some(meaning.object),
            short: short_name(meaning),
            set: Some(ShortNumber::new(&point.quantity.text, meaning, point.is_assumed)),
            actual: None,
            full_scale: scale.map(|(_, value)| value),
        }
    }

    /// Gives both the same sign style: one of the two may be unsigned and have no plus.
    fn align_signs(&mut self) {
        let (Some(set), Some(actual)) = (&self.set, &mut self.actual) else { return };
        let is_positive = |text: &str| text.parse::<f64>().is_ok_and(|number| number > 0.0);
        if set.text.starts_with('+') && is_positive(&actual.text) && !actual.text.starts_with('+') {
            actual.text.insert(0, '+');
        } else if is_positive(&set.text) && !set.text.starts_with('+') {
            actual.text = actual.text.trim_start_matches('+').to_owned();
        }
    }

    /// Whether an actual value belongs to this set point, by the profile or else by its short name.
    fn belongs_to(&self, meaning: &ObjectMeaning) -> bool {
        match meaning.of {
            Some(of) => self.object == Some(of),
            None => self.set.is_some() && meaning.short.is_some() && self.short == short_name(meaning),
        }
    }

    fn values_text(&self, brevity: Abbreviation, arrow: &str, is_alone: bool) -> String {
        let written = |number: &ShortNumber| match brevity {
            Abbreviation::Full | Abbreviation::Close => number.text.clone(),
            Abbreviation::Rounded | Abbreviation::Unitless | Abbreviation::Nameless => number.rounded_text(),
        };
        let blank = if brevity < Abbreviation::Rounded { " " } else { "" };
        let unit = |number: &ShortNumber| match number.unit.as_str() {
            "" => number.doubt_mark().to_owned(),
            _ if brevity > Abbreviation::Rounded => number.doubt_mark().to_owned(),
            unit => format!("{blank}{unit}{}", number.doubt_mark()),
        };
        let mut text = String::new();
        if brevity < Abbreviation::Nameless && !self.short.is_empty() {
            let _ = write!(text, "{} ", self.short);
        }
        let is_roomy = is_alone && brevity == Abbreviation::Full;
        match (&self.set, &self.actual) {
            (Some(set), Some(actual)) if is_roomy || set.unit != actual.unit => {
                let (first, second) = (unit(set), unit(actual));
                let _ = write!(text, "{}{first} {arrow} {}{second}", written(set), written(actual));
            }
            (Some(set), Some(actual)) => {
                let unit = unit(actual);
                let _ = write!(text, "{}{}{arrow}{}{unit}", written(set), set.doubt_mark(), written(actual));
            }
            (Some(set), None) => {
                let _ = write!(text, "{}{}", written(set), unit(set));
                if is_roomy {
                    let _ = write!(text, " {arrow} no actual");
                }
            }
            (None, Some(actual)) => {
                let _ = write!(text, "{arrow}{}{}", written(actual), unit(actual));
            }
            (None, None) => {}
        }
        if let Some(scale) = self.full_scale.filter(|_| brevity == Abbreviation::Full) {
            let _ = write!(text, "/{scale}");
        }
        text
    }
}

/// Short name of the value; empty for a device with a single set point.
fn short_name(meaning: &ObjectMeaning) -> String {
    meaning.short.as_deref().map_or_else(String::new, |short| escape(short).into_owned())
}

fn is_of(channel: Option<u8>, own: Option<u8>) -> bool {
    channel.is_none() || own.is_none() || channel == own
}

/// Fields with a role in the last frame of each identifier.
pub fn role_fields<'a>(
    rows: &'a [&'a IdentifierRow],
    role: ObjectRole,
    direction: PdoDirection,
) -> impl Iterator<Item = (&'a IdentifierRow, usize, &'a PayloadLayout)> {
    let rows = rows.iter().filter(move |row| row.pdo.is_none_or(|pdo| pdo.direction == direction));
    let layouts = rows.filter_map(|row| Some((*row, row.layout.as_deref()?)));
    layouts.flat_map(move |(row, layout)| {
        let fields = layout.fields.iter().enumerate();
        let meant =
            fields.filter(move |(_, field)| field.meaning.as_deref().is_some_and(|it| it.role == Some(role)));
        meant.map(move |(place, _)| (row, place, layout))
    })
}

fn actual_values<'a>(
    rows: &'a [&'a IdentifierRow],
) -> impl Iterator<Item = (DecodedSignal<'a>, &'a ObjectMeaning)> {
    role_signals(rows, ObjectRole::Actual)
}

/// Values with a role that the node sent last.
pub fn role_signals<'a>(
    rows: &'a [&'a IdentifierRow],
    role: ObjectRole,
) -> impl Iterator<Item = (DecodedSignal<'a>, &'a ObjectMeaning)> {
    role_fields(rows, role, PdoDirection::Transmit).filter_map(|(row, place, layout)| {
        let signal = layout.decode_signal(place, row.payload())?;
        let meaning = signal.field.meaning.as_deref()?;
        Some((signal, meaning))
    })
}
