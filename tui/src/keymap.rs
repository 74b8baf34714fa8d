//! All keys: tables from which help and footers are made. The registry of panes gives the digits.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::action::Action;
use crate::panes::PaneId;

/// Keys for one action.
#[derive(Clone, Copy)]
pub struct Binding {
    /// Keys, as [`parse`] reads them; the first one is shown in footers.
    pub keys: &'static [&'static str],
    /// What they do.
    pub action: Action,
    /// One or two words for the footer.
    pub short: &'static str,
    /// A line for the help.
    pub help: &'static str,
    /// Heading it stands under.
    pub group: Group,
}

/// Headings of the help.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Moving in a pane.
    Move,
    /// Moving in time.
    Time,
    /// Choosing what is shown.
    Show,
    /// Doing something with it.
    Do,
    /// Panes and program.
    Program,
}

impl Group {
    /// All, in the order of the help.
    pub const ALL: [Self; 5] = [Self::Move, Self::Time, Self::Show, Self::Do, Self::Program];

    /// Its heading.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Move => "Moving",
            Self::Time => "Time",
            Self::Show => "What is shown",
            Self::Do => "Doing",
            Self::Program => "Panes and program",
        }
    }
}

const fn key(
    keys: &'static [&'static str],
    action: Action,
    short: &'static str,
    help: &'static str,
    group: Group,
) -> Binding {
    Binding { keys, action, short, help, group }
}

/// Keys of panes, in their order; a tenth pane has none.
const DIGITS: [&[&str]; 9] = [&["1"], &["2"], &["3"], &["4"], &["5"], &["6"], &["7"], &["8"], &["9"]];

/// Keys of actions.
const ACTIONS: &[Binding] = &[
    key(&["j", "down"], Action::Down, "down", "one line down", Group::Move),
    key(&["k", "up"], Action::Up, "up", "one line up", Group::Move),
    key(&["right"], Action::Right, "right", "next column; on in time in a plot", Group::Move),
    key(&["left"], Action::Left, "left", "previous column; back in time in a plot", Group::Move),
    key(&["pgdn", "ctrl-f"], Action::PageDown, "page down", "one screen down", Group::Move),
    key(&["pgup", "ctrl-b"], Action::PageUp, "page up", "one screen up", Group::Move),
    key(&["g", "home"], Action::Top, "begin", "to the beginning", Group::Move),
    key(&["G", "end"], Action::Bottom, "end", "to the end", Group::Move),
    key(&["enter"], Action::Open, "open", "into what is selected: its detail, its evidence", Group::Move),
    key(&["esc", "backspace"], Action::Back, "back", "back out of it", Group::Move),
    key(&["x"], Action::Toggle, "unfold", "unfold, fold or choose what is selected", Group::Move),
    key(&["]"], Action::NextFinding, "finding", "next finding", Group::Time),
    key(&["["], Action::PreviousFinding, "finding", "previous finding", Group::Time),
    key(&["e"], Action::NextError, "error", "next event that tells of an error", Group::Time),
    key(&["E"], Action::PreviousError, "error", "previous event that tells of an error", Group::Time),
    key(
        &[":"],
        Action::GoTo,
        "go to",
        "go to 12.5 (seconds), #1234 (frame), -0.05 or +0.05 (from here), a date and time",
        Group::Time,
    ),
    key(&["m"], Action::SetMark, "mark", "give this place a letter", Group::Time),
    key(&["'"], Action::ToMark, "to mark", "go to the place of a letter", Group::Time),
    key(&["space"], Action::Pause, "pause", "stay here, or follow what comes", Group::Time),
    key(&["f", "f3"], Action::Filter, "filter", "show only events and findings a filter means", Group::Show),
    key(
        &["="],
        Action::FilterCell,
        "like this",
        "show only what has the value of the selected cell",
        Group::Show,
    ),
    key(&["c"], Action::Clear, "clear", "no filter, no search, no highlight", Group::Show),
    key(&["v"], Action::News, "all/news", "all events, or only what says something new", Group::Show),
    key(&["/", "f7"], Action::Search, "search", "look for a text (regular expression)", Group::Show),
    key(&["n"], Action::SearchNext, "next", "next place that has it", Group::Show),
    key(&["N"], Action::SearchPrevious, "previous", "previous place that has it", Group::Show),
    key(&["s"], Action::Sort, "sort", "sort by the selected column: up, down, as it was", Group::Show),
    key(&["h"], Action::Highlight, "highlight", "highlight what is like the selected", Group::Show),
    key(&["p"], Action::Plot, "plot", "plot the signals of what is selected", Group::Do),
    key(&["+"], Action::ZoomIn, "zoom in", "look closer", Group::Do),
    key(&["-"], Action::ZoomOut, "zoom out", "look from further away", Group::Do),
    key(&["b"], Action::SetCursor, "cursor b", "set the second cursor of the plot here", Group::Do),
    key(&["y"], Action::Copy, "copy", "copy the selected line", Group::Do),
    key(
        &["V"],
        Action::Select,
        "select",
        "select from here to the cursor, for export; again: nothing",
        Group::Do,
    ),
    key(&["w", "f2"], Action::Export, "export", "write the selection, else everything, to a file", Group::Do),
    key(&["tab"], Action::NextPane, "pane", "next pane", Group::Program),
    key(&["shift-tab"], Action::PreviousPane, "pane", "previous pane", Group::Program),
];

/// Keys of the program, which the help lists after those of the panes.
const PROGRAM: &[Binding] = &[
    key(&["T"], Action::Theme, "theme", "dark, light, no colours", Group::Program),
    key(&["?", "f1"], Action::Help, "help", "this", Group::Program),
    key(&["q", "f10", "ctrl-c"], Action::Quit, "quit", "leave the program", Group::Program),
];

/// All keys, in the order of the help.
pub fn keymap() -> impl Iterator<Item = Binding> {
    let panes =
        DIGITS.into_iter().zip(PaneId::ALL).zip(1..).map(|((keys, pane), number)| {
            key(keys, Action::Pane(number), "pane", pane.title(), Group::Program)
        });
    ACTIONS.iter().copied().chain(panes).chain(PROGRAM.iter().copied())
}

/// The action of a key.
pub fn action(event: &KeyEvent) -> Option<Action> {
    let pressed = normal(*event);
    keymap().find(|binding| binding.keys.iter().any(|name| parse(name) == Some(pressed))).map(|b| b.action)
}

/// The binding of an action.
pub fn binding(action: Action) -> Option<Binding> {
    keymap().find(|binding| binding.action == action)
}

/// Without what terminals differ in: shift is in the character already.
fn normal(event: KeyEvent) -> (KeyCode, KeyModifiers) {
    let modifiers = match event.code {
        KeyCode::Char(_) | KeyCode::BackTab => event.modifiers.difference(KeyModifiers::SHIFT),
        _ => event.modifiers,
    };
    (event.code, modifiers)
}

/// A key by its name: `j`, `G`, `ctrl-f`, `pgdn`, `f3`.
pub fn parse(name: &str) -> Option<(KeyCode, KeyModifiers)> {
    if let Some(rest) = name.strip_prefix("ctrl-").filter(|rest| !rest.is_empty()) {
        let (code, modifiers) = parse(rest)?;
        return Some((code, modifiers.union(KeyModifiers::CONTROL)));
    }
    let mut characters = name.chars();
    if let (Some(character), None) = (characters.next(), characters.next()) {
        return Some((KeyCode::Char(character), KeyModifiers::NONE));
    }
    let code = match name {
        "down" => KeyCode::Down,
        "up" => KeyCode::Up,
        "left" => KeyCode::Left,
        "right" => KeyCode::Right,
        "pgdn" => KeyCode::PageDown,
        "pgup" => KeyCode::PageUp,
        "home" => KeyCode::Home,
        "end" => KeyCode::End,
        "enter" => KeyCode::Enter,
        "esc" => KeyCode::Esc,
        "backspace" => KeyCode::Backspace,
        "delete" => KeyCode::Delete,
        "space" => KeyCode::Char(' '),
        "tab" => KeyCode::Tab,
        "shift-tab" => KeyCode::BackTab,
        _ => KeyCode::F(name.strip_prefix('f')?.parse().ok()?),
    };
    Some((code, KeyModifiers::NONE))
}

/// Keys written one behind the other, special ones in angle brackets: `jj<enter>/705<enter><ctrl-f>`.
/// `<<>` is the character `<`.
///
/// # Errors
/// A name in brackets that is none of a key.
pub fn sequence(text: &str) -> Result<Vec<KeyEvent>, String> {
    let mut keys = Vec::new();
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        let (name, behind) = match rest.strip_prefix('<').and_then(|inner| inner.split_once('>')) {
            Some((name, behind)) => (name, behind),
            None => rest.split_at(character.len_utf8()),
        };
        let (code, modifiers) = parse(name).ok_or_else(|| format!("<{name}> is no key"))?;
        keys.push(KeyEvent::new(code, modifiers));
        rest = behind;
    }
    Ok(keys)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_one_action_and_can_be_read() {
        let mut seen = Vec::new();
        for name in keymap().flat_map(|binding| binding.keys) {
            let key = parse(name).unwrap_or_else(|| panic!("{name}"));
            assert!(!seen.contains(&key), "{name} twice");
            seen.push(key);
        }
    }

    #[test]
    fn keys_are_written_one_behind_the_other() {
        let keys = sequence("j<enter>/<<><ctrl-f>").unwrap();
        let codes: Vec<_> = keys.iter().map(|key| key.code).collect();
        let expected =
            [KeyCode::Char('j'), KeyCode::Enter, KeyCode::Char('/'), KeyCode::Char('<'), KeyCode::Char('f')];
        assert_eq!(codes, expected);
        assert_eq!(action(&keys[4]), Some(Action::PageDown));
        assert_eq!(sequence("<nokey>").unwrap_err(), "<nokey> is no key");
    }

    #[test]
    fn a_capital_letter_is_a_key_of_its_own_with_or_without_shift() {
        let shifted = KeyEvent::new(KeyCode::Char('G'), KeyModifiers::SHIFT);
        assert_eq!(action(&shifted), Some(Action::Bottom));
        assert_eq!(action(&KeyEvent::new(KeyCode::BackTab, KeyModifiers::SHIFT)), Some(Action::PreviousPane));
    }
}
