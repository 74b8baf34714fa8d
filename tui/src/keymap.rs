//! Keys for input, help and key bar: default tables, which the config file may change. The registry of panes
//! supplies the digits.

use cobscope_decoder::query::fields::edit_distance;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::action::Action;
use crate::panes::PaneId;

/// Maximum number of wrong letters in a name for which another one is proposed.
const MOST_EDITS: usize = 3;

/// Keys of an action.
#[derive(Clone, Copy)]
pub struct KeyBinding {
    /// Key names for [`parse_key`]; the key bar shows the first one.
    pub keys: &'static [&'static str],
    /// Action of the keys.
    pub action: Action,
    /// One or two words for the key bar.
    pub short: &'static str,
    /// One line for the help.
    pub help: &'static str,
    /// Heading in the help.
    pub group: HelpGroup,
}

/// Headings of the help.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HelpGroup {
    /// Movement within a pane.
    Move,
    /// Movement in time.
    Time,
    /// Filter and search.
    Show,
    /// Actions on the selected item.
    Do,
    /// Panes and program.
    Program,
}

impl HelpGroup {
    /// All headings in the order of the help.
    pub const ALL: [Self; 5] = [Self::Move, Self::Time, Self::Show, Self::Do, Self::Program];

    /// Text of the heading.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Move => "Movement",
            Self::Time => "Time",
            Self::Show => "Filter and search",
            Self::Do => "Actions",
            Self::Program => "Panes and program",
        }
    }
}

const fn define_key(
    keys: &'static [&'static str],
    action: Action,
    short: &'static str,
    help: &'static str,
    group: HelpGroup,
) -> KeyBinding {
    KeyBinding { keys, action, short, help, group }
}

/// Keys of the panes.
const DIGITS: [&[&str]; 10] =
    [&["0"], &["1"], &["2"], &["3"], &["4"], &["5"], &["6"], &["7"], &["8"], &["9"]];

/// Keys of actions.
const ACTIONS: &[KeyBinding] = &[
    define_key(&["j", "down"], Action::Down, "down", "go down one line", HelpGroup::Move),
    define_key(&["k", "up"], Action::Up, "up", "go up one line", HelpGroup::Move),
    define_key(
        &["right"],
        Action::Right,
        "move",
        "next visible column, next bit; later in time in a plot",
        HelpGroup::Move,
    ),
    define_key(
        &["left"],
        Action::Left,
        "move",
        "previous visible column, previous bit; earlier in time in a plot",
        HelpGroup::Move,
    ),
    define_key(&["pgdn", "ctrl-f"], Action::PageDown, "page down", "go down one page", HelpGroup::Move),
    define_key(&["pgup", "ctrl-b"], Action::PageUp, "page up", "go up one page", HelpGroup::Move),
    define_key(&["g", "home"], Action::Top, "start", "go to the start", HelpGroup::Move),
    define_key(&["G", "end"], Action::Bottom, "end", "go to the end", HelpGroup::Move),
    define_key(
        &["enter"],
        Action::Open,
        "open",
        "open the selected row: detail, evidence, gates",
        HelpGroup::Move,
    ),
    define_key(
        &["esc", "backspace"],
        Action::Back,
        "back",
        "close, or go to the previous pane",
        HelpGroup::Move,
    ),
    define_key(
        &["x"],
        Action::Toggle,
        "expand",
        "expand, collapse or choose the selected row; Objects: next node; Why: events of the row",
        HelpGroup::Move,
    ),
    define_key(&["]"], Action::NextFinding, "finding", "go to the next finding", HelpGroup::Time),
    define_key(&["["], Action::PreviousFinding, "finding", "go to the previous finding", HelpGroup::Time),
    define_key(
        &["}"],
        Action::NextStory,
        "story",
        "go to the next story of the diagnosis; to the first one from a cursor at no story",
        HelpGroup::Time,
    ),
    define_key(
        &["{"],
        Action::PreviousStory,
        "story",
        "go to the previous story of the diagnosis; to the first one from a cursor at no story",
        HelpGroup::Time,
    ),
    define_key(&["e"], Action::NextError, "error", "go to the next error event", HelpGroup::Time),
    define_key(&["E"], Action::PreviousError, "error", "go to the previous error event", HelpGroup::Time),
    define_key(
        &[":"],
        Action::GoTo,
        "go to",
        "go to 12.5 (seconds), #1234 (frame), -0.05 or +0.05 (relative), 22:13:25, a date and time",
        HelpGroup::Time,
    ),
    define_key(
        &["t"],
        Action::Clock,
        "clock",
        "show times in seconds, in UTC or in local time",
        HelpGroup::Time,
    ),
    define_key(
        &["m"],
        Action::SetMark,
        "mark",
        "set a mark, named by a letter, at the cursor",
        HelpGroup::Time,
    ),
    define_key(&["'"], Action::ToMark, "to mark", "go to a mark", HelpGroup::Time),
    define_key(&["space"], Action::Pause, "pause", "pause or resume following new frames", HelpGroup::Time),
    define_key(
        &["f", "f3"],
        Action::Filter,
        "filter",
        "show only events and findings that match a filter",
        HelpGroup::Show,
    ),
    define_key(
        &["="],
        Action::FilterCell,
        "like this",
        "filter by the selected cell: number, bus, ID, node, kind, object, PGN, severity, rule, outcome; \
         other cells: by node or kind of the row",
        HelpGroup::Show,
    ),
    define_key(
        &["c"],
        Action::Clear,
        "clear",
        "clear filter and search, and the search, highlight or plot of the focused pane",
        HelpGroup::Show,
    ),
    define_key(
        &["u"],
        Action::Undo,
        "undo",
        "undo the last change of filter, search, sort order, columns or v",
        HelpGroup::Show,
    ),
    define_key(&["U"], Action::Redo, "redo", "redo the change that u undid", HelpGroup::Show),
    define_key(&["v"], Action::News, "all/changes", "show all events, or only changes", HelpGroup::Show),
    define_key(
        &["/", "f7"],
        Action::Search,
        "search",
        "search for a regular expression; in Objects for words of address and name",
        HelpGroup::Show,
    ),
    define_key(&["n"], Action::SearchNext, "next", "go to the next match", HelpGroup::Show),
    define_key(&["N"], Action::SearchPrevious, "previous", "go to the previous match", HelpGroup::Show),
    define_key(
        &["s"],
        Action::Sort,
        "sort",
        "sort by the selected column (Frames, Transfers, Objects, Findings): ascending, descending, off; \
         Nodes: worst first, name, device, number",
        HelpGroup::Show,
    ),
    define_key(
        &["h"],
        Action::Highlight,
        "highlight",
        "highlight the selected value in Events, the row in Frames",
        HelpGroup::Show,
    ),
    define_key(
        &["p"],
        Action::Plot,
        "plot",
        "plot the signals of the selected row (Nodes, Events, Frames, Detail, Signals)",
        HelpGroup::Do,
    ),
    define_key(&["+"], Action::ZoomIn, "zoom in", "show half the time range (Signals, Bus)", HelpGroup::Do),
    define_key(
        &["-"],
        Action::ZoomOut,
        "zoom out",
        "show twice the time range (Signals, Bus)",
        HelpGroup::Do,
    ),
    define_key(
        &["b"],
        Action::SetCursor,
        "cursor b",
        "set or remove cursor B of the plot (Signals)",
        HelpGroup::Do,
    ),
    define_key(
        &["a"],
        Action::Assign,
        "assign",
        "assign a profile, EDS or DBC to the selected node",
        HelpGroup::Do,
    ),
    define_key(&["y"], Action::Copy, "copy", "copy the selected line", HelpGroup::Do),
    define_key(
        &["V"],
        Action::Select,
        "select",
        "start or clear the selection of frames to export",
        HelpGroup::Do,
    ),
    define_key(
        &["w", "f2"],
        Action::Export,
        "export",
        "write the selection, or everything, to a file",
        HelpGroup::Do,
    ),
    define_key(
        &["R"],
        Action::Report,
        "report",
        "write a report page of the selected finding (not of a note) or story (HTML, Markdown)",
        HelpGroup::Do,
    ),
    define_key(
        &["tab"],
        Action::NextPane,
        "pane",
        "go to the next pane, of those that are shown together",
        HelpGroup::Program,
    ),
    define_key(&["shift-tab"], Action::PreviousPane, "pane", "go to the previous pane", HelpGroup::Program),
    define_key(&["|"], Action::Layout, "layout", "show the panes of the next layout", HelpGroup::Program),
    define_key(
        &["\\"],
        Action::Zoom,
        "zoom",
        "show only this pane, or all panes of the layout again",
        HelpGroup::Program,
    ),
    define_key(
        &["<"],
        Action::SplitLeft,
        "split",
        "move the border between the panes to the left",
        HelpGroup::Program,
    ),
    define_key(
        &[">"],
        Action::SplitRight,
        "split",
        "move the border between the panes to the right",
        HelpGroup::Program,
    ),
    define_key(&["o"], Action::Columns, "columns", "choose the columns of the pane", HelpGroup::Show),
    define_key(&["i"], Action::Strip, "strip", "show or hide the strip of time", HelpGroup::Program),
];

/// Keys of the program; the help lists them after the panes.
const PROGRAM: &[KeyBinding] = &[
    define_key(
        &["T"],
        Action::Theme,
        "theme",
        "switch colours: dark, light (256, then 16 colours), none",
        HelpGroup::Program,
    ),
    define_key(
        &["ctrl-r"],
        Action::Forget,
        "forget",
        "discard the remembered layout, split, strip, columns and colours",
        HelpGroup::Program,
    ),
    define_key(&["?", "f1"], Action::Help, "help", "explain the pane and list all keys", HelpGroup::Program),
    define_key(&["q", "f10", "ctrl-c"], Action::Quit, "quit", "quit the program", HelpGroup::Program),
];

/// Default bindings in the order of the help.
pub fn default_bindings() -> impl Iterator<Item = KeyBinding> {
    let panes = DIGITS.into_iter().zip(PaneId::ALL).zip(0..).map(|((keys, pane), number)| {
        define_key(keys, Action::Pane(number), "pane", pane.title(), HelpGroup::Program)
    });
    ACTIONS.iter().copied().chain(panes).chain(PROGRAM.iter().copied())
}

impl KeyBinding {
    /// Name of the action in the config file: `next-finding`, `pane-events`.
    pub fn name(&self) -> String {
        match self.action {
            Action::Pane(number) => {
                let pane = PaneId::ALL.get(usize::from(number)).map_or("", |pane| pane.name());
                format!("pane-{pane}")
            }
            action => {
                let mut name = String::new();
                for letter in format!("{action:?}").chars() {
                    if letter.is_ascii_uppercase() && !name.is_empty() {
                        name.push('-');
                    }
                    name.push(letter.to_ascii_lowercase());
                }
                name
            }
        }
    }
}

/// Keys of one action.
#[derive(Debug, Clone)]
struct ActionKeys {
    action: Action,
    names: Vec<String>,
    pressed: Vec<(KeyCode, KeyModifiers)>,
}

/// The keys of all actions: the defaults with the changes of the config file.
#[derive(Debug, Clone)]
pub struct Keymap(Vec<ActionKeys>);

impl Default for Keymap {
    fn default() -> Self {
        let keys = |binding: KeyBinding| ActionKeys {
            action: binding.action,
            names: binding.keys.iter().map(|name| (*name).to_owned()).collect(),
            pressed: binding.keys.iter().filter_map(|name| parse_key(name)).collect(),
        };
        Self(default_bindings().map(keys).collect())
    }
}

impl Keymap {
    /// Gives an action these keys instead of its own. A key that another action had is taken from it.
    ///
    /// # Errors
    /// Unknown name of an action or of a key.
    pub fn bind_action(&mut self, action: &str, names: &[String]) -> Result<(), String> {
        let binding = default_bindings().find(|binding| binding.name() == action);
        let Some(binding) = binding else {
            let known: Vec<String> = default_bindings().map(|binding| binding.name()).collect();
            let near = known.iter().map(|name| (edit_distance(action, name), name)).min();
            let near = near.filter(|(edits, _)| *edits <= MOST_EDITS);
            let hint = near.map_or(String::new(), |(_, name)| format!("; did you mean {name}?"));
            return Err(format!("no action {action:?}{hint}"));
        };
        let key = |name: &String| parse_key(name).ok_or_else(|| format!("{action}: no key {name:?}"));
        let pressed: Vec<_> = names.iter().map(key).collect::<Result<_, _>>()?;
        for keys in &mut self.0 {
            if keys.action == binding.action {
                (keys.names, keys.pressed) = (names.to_vec(), pressed.clone());
            } else {
                keys.names.retain(|name| parse_key(name).is_none_or(|key| !pressed.contains(&key)));
                keys.pressed.retain(|key| !pressed.contains(key));
            }
        }
        Ok(())
    }

    /// Actions without any key.
    pub fn unbound_actions(&self) -> impl Iterator<Item = Action> {
        self.0.iter().filter(|keys| keys.pressed.is_empty()).map(|keys| keys.action)
    }

    /// The action of a key.
    pub fn action_for(&self, event: &KeyEvent) -> Option<Action> {
        let pressed = normalise_key(*event);
        self.0.iter().find(|keys| keys.pressed.contains(&pressed)).map(|keys| keys.action)
    }

    /// Names of the keys of an action.
    pub fn keys_for(&self, action: Action) -> &[String] {
        self.0.iter().find(|keys| keys.action == action).map_or(&[], |keys| &keys.names)
    }
}

/// The default binding of an action.
pub fn default_binding(action: Action) -> Option<KeyBinding> {
    default_bindings().find(|binding| binding.action == action)
}

/// Normalises a key: some terminals report shift in addition to the capital letter.
fn normalise_key(event: KeyEvent) -> (KeyCode, KeyModifiers) {
    let modifiers = match event.code {
        KeyCode::Char(_) | KeyCode::BackTab => event.modifiers.difference(KeyModifiers::SHIFT),
        _ => event.modifiers,
    };
    (event.code, modifiers)
}

/// A key by its name: `j`, `G`, `ctrl-f`, `pgdn`, `f3`.
pub fn parse_key(name: &str) -> Option<(KeyCode, KeyModifiers)> {
    if let Some(rest) = name.strip_prefix("ctrl-").filter(|rest| !rest.is_empty()) {
        let (code, modifiers) = parse_key(rest)?;
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

/// Parses consecutive keys, special ones in angle brackets: `jj<enter>/705<enter><ctrl-f>`. `<<>` is the
/// character `<`.
///
/// # Errors
/// Unknown key name in brackets.
pub fn parse_sequence(text: &str) -> Result<Vec<KeyEvent>, String> {
    let mut keys = Vec::new();
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        let (name, behind) = match rest.strip_prefix('<').and_then(|inner| inner.split_once('>')) {
            Some((name, behind)) => (name, behind),
            None => rest.split_at(character.len_utf8()),
        };
        let (code, modifiers) = parse_key(name).ok_or_else(|| format!("unknown key <{name}>"))?;
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
        for name in default_bindings().flat_map(|binding| binding.keys) {
            let key = parse_key(name).unwrap_or_else(|| panic!("{name}"));
            assert!(!seen.contains(&key), "{name} twice");
            seen.push(key);
        }
    }

    #[test]
    fn keys_are_written_one_behind_the_other() {
        let keys = parse_sequence("j<enter>/<<><ctrl-f>").unwrap();
        let codes: Vec<_> = keys.iter().map(|key| key.code).collect();
        let expected =
            [KeyCode::Char('j'), KeyCode::Enter, KeyCode::Char('/'), KeyCode::Char('<'), KeyCode::Char('f')];
        assert_eq!(codes, expected);
        assert_eq!(Keymap::default().action_for(&keys[4]), Some(Action::PageDown));
        assert_eq!(parse_sequence("<nokey>").unwrap_err(), "unknown key <nokey>");
    }

    #[test]
    fn a_capital_letter_is_a_key_of_its_own_with_or_without_shift() {
        let shifted = KeyEvent::new(KeyCode::Char('G'), KeyModifiers::SHIFT);
        assert_eq!(Keymap::default().action_for(&shifted), Some(Action::Bottom));
        assert_eq!(
            Keymap::default().action_for(&KeyEvent::new(KeyCode::BackTab, KeyModifiers::SHIFT)),
            Some(Action::PreviousPane)
        );
    }

    #[test]
    fn actions_have_names_and_can_have_other_keys() {
        let mut names: Vec<String> = default_bindings().map(|binding| binding.name()).collect();
        let count = names.len();
        assert!(names.contains(&"next-finding".to_owned()) && names.contains(&"pane-why".to_owned()));
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count);
        let mut keymap = Keymap::default();
        keymap.bind_action("plot", &["F".into(), "f".into()]).unwrap();
        let key = |letter| KeyEvent::new(KeyCode::Char(letter), KeyModifiers::NONE);
        assert_eq!(keymap.action_for(&key('f')), Some(Action::Plot));
        assert_eq!(keymap.action_for(&key('p')), None);
        // The other key of the filter stays.
        assert_eq!(keymap.keys_for(Action::Filter), ["f3"]);
        assert_eq!(keymap.unbound_actions().count(), 0);
        assert_eq!(keymap.bind_action("plod", &[]).unwrap_err(), "no action \"plod\"; did you mean plot?");
        assert_eq!(keymap.bind_action("plot", &["hyper-f".into()]).unwrap_err(), "plot: no key \"hyper-f\"");
    }
}
