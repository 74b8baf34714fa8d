//! Colours, attributes, border characters and glyphs.
//!
//! ```text
//!            Depth::Full          Depth::Sixteen       Depth::None
//! Bad        red, bold            light red, bold      bold, underlined
//! Selected   grey background      reversed             reversed
//! ```
//!
//! Widgets and panes use a [`TextRole`], never a colour. Roles that must be distinguished differ in every depth,
//! so that no information depends on colour alone.

use cobscope_decoder::sink::text::LineTone;
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::border;

use crate::ascii;

/// Role of a text; it decides colour and attributes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextRole {
    /// Ordinary text.
    Text,
    /// Minor text: units, frame numbers, unchanged values.
    Quiet,
    /// Normal operation.
    Good,
    /// Warning.
    Caution,
    /// Error.
    Bad,
    /// Remark without a verdict.
    Note,
    /// The title of a pane.
    Title,
    /// Name of a key.
    Key,
    /// The border of a pane.
    Border,
    /// The border of the focused pane.
    BorderActive,
    /// The selected line; laid over the styles of its cells.
    Selected,
    /// A cursor in time, in a plot or in the prompt.
    Cursor,
    /// The header line.
    Header,
    /// A column head.
    HeaderCell,
    /// A changed byte or value.
    Changed,
    /// A plot series or a payload field; the looks repeat after [`HIGHLIGHTS`].
    Highlight(u8),
    /// A search match.
    Search,
    /// A target of Enter.
    Link,
}

/// Role of a tone.
pub fn role_of(tone: LineTone) -> TextRole {
    match tone {
        LineTone::Plain => TextRole::Text,
        LineTone::Quiet => TextRole::Quiet,
        LineTone::Good => TextRole::Good,
        LineTone::Caution => TextRole::Caution,
        LineTone::Bad => TextRole::Bad,
    }
}

/// Number of different looks of [`TextRole::Highlight`].
pub const HIGHLIGHTS: u8 = 6;

/// Background of the terminal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ThemePalette {
    /// Light text on a dark background.
    #[default]
    Dark,
    /// Dark text on a light background.
    Light,
}

/// The user's choice of a palette.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ThemeName {
    /// By the background that the terminal reports, else dark
    Auto,
    /// Light text on a dark background
    Dark,
    /// Dark text on a light background
    Light,
}

/// Number of colours of the terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorDepth {
    /// No colours: bold, dim, italic, underlined and reversed only.
    None,
    /// The 16 named ANSI colours of the terminal.
    Sixteen,
    /// 256 indexed colours, the same in all terminals.
    Full,
}

/// Characters for lines, marks and plots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LineCharacters {
    /// Box drawing, block and braille characters.
    #[default]
    Unicode,
    /// ASCII only.
    Ascii,
}

/// A character with an ASCII substitute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Glyph {
    /// Change from one value to another.
    Arrow,
    /// Ascending order; the cursor on an axis.
    Up,
    /// Descending order.
    Down,
    /// Omitted text.
    Ellipsis,
    /// Warning.
    Warning,
    /// A full block.
    Bar,
    /// Chosen or correct.
    Check,
    /// Wrong.
    Cross,
    /// A separator.
    Dot,
    /// A tree row with hidden children.
    Closed,
    /// A tree row with visible children.
    Open,
    /// A vertical line.
    Vertical,
    /// A horizontal line.
    Horizontal,
    /// A difference.
    Delta,
}

/// The user's choice of palette, depth and characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Theme {
    palette: ThemePalette,
    depth: ColorDepth,
    borders: LineCharacters,
    /// Keys act on the pane that is drawn.
    is_focused: bool,
}

impl Theme {
    /// A theme.
    pub fn new(palette: ThemePalette, depth: ColorDepth, borders: LineCharacters) -> Self {
        Self { palette, depth, borders, is_focused: true }
    }

    /// Background of the terminal.
    pub fn palette(&self) -> ThemePalette {
        self.palette
    }

    /// Number of colours used.
    pub fn depth(&self) -> ColorDepth {
        self.depth
    }

    /// The same characters in other colours.
    #[must_use]
    pub fn with_colours(self, palette: ThemePalette, depth: ColorDepth) -> Self {
        Self { palette, depth, ..self }
    }

    /// The theme for a pane on which keys act, or for another one, whose selection is weaker.
    #[must_use]
    pub fn with_focus(self, is_focused: bool) -> Self {
        Self { is_focused, ..self }
    }

    /// Characters for lines, marks and plots.
    pub fn borders(&self) -> LineCharacters {
        self.borders
    }

    /// The style of a role.
    pub fn role_style(&self, role: TextRole) -> Style {
        let look = role_look(role);
        let (front, back) = match (self.depth, self.palette) {
            (ColorDepth::None, _) => return Style::new().add_modifier(look.colourless),
            (ColorDepth::Sixteen, ThemePalette::Dark) => look.sixteen_dark,
            (ColorDepth::Sixteen, ThemePalette::Light) => look.sixteen_light,
            (ColorDepth::Full, ThemePalette::Dark) => indexed_colours(look.full_dark),
            (ColorDepth::Full, ThemePalette::Light) => indexed_colours(look.full_light),
        };
        let modifier = match (self.depth, role) {
            // With sixteen colours only reversing keeps the colours of the cells readable.
            (ColorDepth::Sixteen, TextRole::Selected) => Modifier::REVERSED,
            _ => look.modifier,
        };
        Style { fg: front, bg: back, ..Style::new().add_modifier(modifier) }
    }

    /// Style over the selected line: [`TextRole::Selected`] if keys act on it, else a weaker one.
    pub fn selection_style(&self, is_focused: bool) -> Style {
        match (is_focused && self.is_focused, self.depth, self.palette) {
            (true, _, _) => self.role_style(TextRole::Selected),
            (false, ColorDepth::Full, ThemePalette::Dark) => Style::new().bg(Color::Indexed(235)),
            (false, ColorDepth::Full, ThemePalette::Light) => Style::new().bg(Color::Indexed(255)),
            (false, _, _) => Style::new().add_modifier(Modifier::UNDERLINED),
        }
    }

    /// Border characters of a pane.
    pub fn border_set(&self) -> border::Set<'static> {
        match self.borders {
            LineCharacters::Unicode => border::PLAIN,
            LineCharacters::Ascii => border::Set {
                top_left: "+",
                top_right: "+",
                bottom_left: "+",
                bottom_right: "+",
                vertical_left: "|",
                vertical_right: "|",
                horizontal_top: "-",
                horizontal_bottom: "-",
            },
        }
    }

    /// A glyph or its ASCII substitute.
    pub fn glyph(&self, glyph: Glyph) -> &'static str {
        let unicode = match glyph {
            Glyph::Arrow => "→",
            Glyph::Up => "▲",
            Glyph::Down => "▼",
            Glyph::Ellipsis => "…",
            Glyph::Warning => "⚠",
            Glyph::Bar => "█",
            Glyph::Check => "✓",
            Glyph::Cross => "✗",
            Glyph::Dot => "·",
            Glyph::Closed => "▸",
            Glyph::Open => "▾",
            Glyph::Vertical => "│",
            Glyph::Horizontal => "─",
            Glyph::Delta => "Δ",
        };
        match self.borders {
            LineCharacters::Unicode => unicode,
            // `>` between two values reads as a comparison.
            LineCharacters::Ascii if glyph == Glyph::Arrow => "->",
            LineCharacters::Ascii => ascii::ascii_substitute(unicode),
        }
    }
}

/// Foreground and background.
type Pair<C> = (Option<C>, Option<C>);

/// Colours and attributes of a role for each depth and palette.
struct RoleStyle {
    full_dark: Pair<u8>,
    full_light: Pair<u8>,
    sixteen_dark: Pair<Color>,
    sixteen_light: Pair<Color>,
    /// Attributes in addition to colours.
    modifier: Modifier,
    /// Attributes without colours.
    colourless: Modifier,
}

fn indexed_colours((front, back): Pair<u8>) -> Pair<Color> {
    (front.map(Color::Indexed), back.map(Color::Indexed))
}

/// A look with a foreground colour only.
const fn foreground_look(
    full: (u8, u8),
    sixteen: (Color, Color),
    modifier: Modifier,
    colourless: Modifier,
) -> RoleStyle {
    RoleStyle {
        full_dark: (Some(full.0), None),
        full_light: (Some(full.1), None),
        sixteen_dark: (Some(sixteen.0), None),
        sixteen_light: (Some(sixteen.1), None),
        modifier,
        colourless,
    }
}

/// A look with attributes, and with a background at full depth.
const fn background_look(full: Option<(u8, u8)>, modifier: Modifier, colourless: Modifier) -> RoleStyle {
    let (dark, light) = match full {
        Some((dark, light)) => (Some(dark), Some(light)),
        None => (None, None),
    };
    RoleStyle {
        full_dark: (None, dark),
        full_light: (None, light),
        sixteen_dark: (None, None),
        sixteen_light: (None, None),
        modifier,
        colourless,
    }
}

/// A look with black or white text on a colour.
const fn block_look(
    full: (u8, u8),
    sixteen: (Color, Color),
    is_light_on_light: bool,
    colourless: Modifier,
) -> RoleStyle {
    let (text, sixteen_text) = if is_light_on_light { (231, Color::White) } else { (16, Color::Black) };
    RoleStyle {
        full_dark: (Some(16), Some(full.0)),
        full_light: (Some(text), Some(full.1)),
        sixteen_dark: (Some(Color::Black), Some(sixteen.0)),
        sixteen_light: (Some(sixteen_text), Some(sixteen.1)),
        modifier: Modifier::empty(),
        colourless,
    }
}

/// The looks of all roles. Yellow is unreadable on white, so the light palette of sixteen colours uses
/// magenta.
const fn role_look(role: TextRole) -> RoleStyle {
    use Color::{Blue, Cyan, DarkGray, Green, LightBlue, LightCyan, LightGreen, LightMagenta, LightRed};
    use Color::{LightYellow, Magenta, Red, Yellow};
    const NONE: Modifier = Modifier::empty();
    const BOLD: Modifier = Modifier::BOLD;
    const DIM: Modifier = Modifier::DIM;
    const ITALIC: Modifier = Modifier::ITALIC;
    const UNDER: Modifier = Modifier::UNDERLINED;
    const REVERSED: Modifier = Modifier::REVERSED;
    match role {
        TextRole::Text => background_look(None, NONE, NONE),
        TextRole::Quiet => foreground_look((245, 242), (DarkGray, DarkGray), NONE, DIM),
        TextRole::Good => foreground_look((114, 28), (Green, Green), NONE, ITALIC),
        TextRole::Caution => foreground_look((221, 130), (Yellow, Magenta), NONE, BOLD),
        TextRole::Bad => foreground_look((203, 160), (LightRed, Red), BOLD, BOLD.union(UNDER)),
        TextRole::Note => foreground_look((117, 25), (Cyan, Blue), NONE, UNDER),
        TextRole::Title | TextRole::Header => background_look(None, BOLD, BOLD),
        TextRole::Key => foreground_look((81, 25), (LightCyan, Blue), BOLD, BOLD),
        TextRole::Border => foreground_look((240, 249), (DarkGray, DarkGray), NONE, DIM),
        TextRole::BorderActive => foreground_look((81, 25), (LightCyan, Blue), NONE, BOLD),
        TextRole::Selected => background_look(Some((237, 253)), BOLD, REVERSED),
        TextRole::Cursor => block_look((81, 25), (Cyan, Blue), true, BOLD.union(REVERSED)),
        TextRole::HeaderCell => background_look(None, BOLD.union(UNDER), BOLD.union(UNDER)),
        TextRole::Changed => foreground_look((215, 166), (LightYellow, Red), BOLD, BOLD),
        TextRole::Search => block_look((221, 226), (Yellow, Yellow), false, REVERSED.union(UNDER)),
        TextRole::Link => foreground_look((111, 26), (LightBlue, Blue), UNDER, UNDER),
        TextRole::Highlight(number) => match number % HIGHLIGHTS {
            0 => foreground_look((117, 25), (LightCyan, Blue), NONE, BOLD),
            1 => foreground_look((215, 166), (LightYellow, Red), NONE, UNDER),
            2 => foreground_look((156, 28), (LightGreen, Green), NONE, ITALIC),
            3 => foreground_look((213, 162), (LightMagenta, Magenta), NONE, BOLD.union(UNDER)),
            4 => foreground_look((229, 94), (LightRed, DarkGray), NONE, BOLD.union(ITALIC)),
            _ => foreground_look((141, 55), (LightBlue, Cyan), NONE, UNDER.union(ITALIC)),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Groups of roles that appear next to each other and must be distinguishable.
    const APART: &[&[TextRole]] = &[
        &[TextRole::Text, TextRole::Quiet, TextRole::Good, TextRole::Caution, TextRole::Bad, TextRole::Note],
        &[TextRole::Border, TextRole::BorderActive],
        &[TextRole::Text, TextRole::Selected, TextRole::Cursor, TextRole::Search],
        &[TextRole::Text, TextRole::Quiet, TextRole::Changed],
        &[TextRole::Text, TextRole::HeaderCell],
        &[TextRole::Text, TextRole::Title],
        &[TextRole::Text, TextRole::Quiet, TextRole::Key],
        &[TextRole::Text, TextRole::Link],
        &[
            TextRole::Text,
            TextRole::Highlight(0),
            TextRole::Highlight(1),
            TextRole::Highlight(2),
            TextRole::Highlight(3),
            TextRole::Highlight(4),
            TextRole::Highlight(5),
        ],
    ];

    #[test]
    fn distinct_roles_differ_in_every_colour_depth() {
        for palette in [ThemePalette::Dark, ThemePalette::Light] {
            for depth in [ColorDepth::None, ColorDepth::Sixteen, ColorDepth::Full] {
                let theme = Theme::new(palette, depth, LineCharacters::Unicode);
                for group in APART {
                    for (at, one) in group.iter().enumerate() {
                        for other in &group[at + 1..] {
                            let styles = (theme.role_style(*one), theme.role_style(*other));
                            assert_ne!(styles.0, styles.1, "{palette:?} {depth:?} {one:?} {other:?}");
                        }
                    }
                }
                assert_ne!(
                    theme.selection_style(true),
                    theme.selection_style(false),
                    "{palette:?} {depth:?}"
                );
                assert_ne!(
                    theme.selection_style(false),
                    theme.role_style(TextRole::Text),
                    "{palette:?} {depth:?}"
                );
            }
        }
    }

    fn every_role() -> Vec<TextRole> {
        let mut roles = vec![TextRole::Header];
        roles.extend(APART.iter().copied().flatten().copied());
        roles
    }

    #[test]
    fn no_colour_means_no_colour() {
        let theme = Theme::new(ThemePalette::Dark, ColorDepth::None, LineCharacters::Unicode);
        for role in every_role() {
            let style = theme.role_style(role);
            assert_eq!((style.fg, style.bg), (None, None), "{role:?}");
        }
    }

    #[test]
    fn sixteen_colours_are_the_named_ones() {
        for palette in [ThemePalette::Dark, ThemePalette::Light] {
            let theme = Theme::new(palette, ColorDepth::Sixteen, LineCharacters::Unicode);
            for role in every_role() {
                let style = theme.role_style(role);
                for colour in [style.fg, style.bg].into_iter().flatten() {
                    assert!(!matches!(colour, Color::Indexed(_) | Color::Rgb(..)), "{role:?}");
                    // Colours close to the background of their palette.
                    let faint = match palette {
                        ThemePalette::Dark => [Color::Blue, Color::Magenta],
                        ThemePalette::Light => [Color::LightYellow, Color::White],
                    };
                    let on_background = style.bg.is_none();
                    assert!(!on_background || !faint.contains(&colour), "{palette:?} {role:?}");
                }
            }
        }
    }

    #[test]
    fn ascii_is_ascii() {
        let theme = Theme::new(ThemePalette::Dark, ColorDepth::Full, LineCharacters::Ascii);
        let set = theme.border_set();
        let glyphs = [Glyph::Arrow, Glyph::Up, Glyph::Down, Glyph::Ellipsis, Glyph::Warning, Glyph::Bar];
        let more = [Glyph::Check, Glyph::Cross, Glyph::Dot, Glyph::Closed, Glyph::Open, Glyph::Vertical];
        let rest = [Glyph::Horizontal, Glyph::Delta];
        for glyph in glyphs.into_iter().chain(more).chain(rest) {
            assert!(theme.glyph(glyph).is_ascii() && theme.glyph(glyph) != "?", "{glyph:?}");
        }
        assert_eq!((set.top_left, set.vertical_right, set.horizontal_top), ("+", "|", "-"));
        assert_eq!(theme.glyph(Glyph::Arrow), "->");
        let unicode = Theme::new(ThemePalette::Dark, ColorDepth::Full, LineCharacters::Unicode);
        assert_eq!((unicode.glyph(Glyph::Arrow), unicode.glyph(Glyph::Ellipsis)), ("→", "…"));
    }
}
