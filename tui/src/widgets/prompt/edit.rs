//! Edit commands of keys, with the bindings of shells.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

/// Edit command of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EditCommand {
    Insert(char),
    Move(CursorReach),
    Delete(CursorReach),
    Older,
    Newer,
    Submit,
    Cancel,
}

/// Distance from the cursor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CursorReach {
    CharLeft,
    CharRight,
    WordLeft,
    WordRight,
    Home,
    End,
}

/// A character as it is inserted: blanks become spaces, other control characters are dropped.
pub(super) fn to_typeable(typed: char) -> Option<char> {
    match typed {
        '\t' | '\n' => Some(' '),
        _ => Some(typed).filter(|typed| !typed.is_control()),
    }
}

/// Edit command of a key, with the bindings of shells.
pub(super) fn edit_of(key: KeyEvent) -> Option<EditCommand> {
    use EditCommand::{Cancel, Delete, Insert, Move, Newer, Older, Submit};
    if key.kind == KeyEventKind::Release {
        return None;
    }
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    let alt = key.modifiers.contains(KeyModifiers::ALT);
    Some(match (key.code, control, alt) {
        // Some systems report AltGr as Ctrl and Alt.
        (KeyCode::Char(typed), false, false) | (KeyCode::Char(typed), true, true) => {
            Insert(to_typeable(typed)?)
        }
        (KeyCode::Enter, ..) | (KeyCode::Char('j' | 'm'), true, _) => Submit,
        (KeyCode::Esc, ..) | (KeyCode::Char('c' | 'g'), true, _) => Cancel,
        (KeyCode::Up, ..) | (KeyCode::Char('p'), true, _) => Older,
        (KeyCode::Down, ..) | (KeyCode::Char('n'), true, _) => Newer,
        (KeyCode::Home, ..) | (KeyCode::Char('a'), true, _) => Move(CursorReach::Home),
        (KeyCode::End, ..) | (KeyCode::Char('e'), true, _) => Move(CursorReach::End),
        (KeyCode::Left, false, false) | (KeyCode::Char('b'), true, _) => Move(CursorReach::CharLeft),
        (KeyCode::Right, false, false) | (KeyCode::Char('f'), true, _) => Move(CursorReach::CharRight),
        (KeyCode::Left, ..) | (KeyCode::Char('b'), _, true) => Move(CursorReach::WordLeft),
        (KeyCode::Right, ..) | (KeyCode::Char('f'), _, true) => Move(CursorReach::WordRight),
        (KeyCode::Backspace, false, false) | (KeyCode::Char('h'), true, _) => Delete(CursorReach::CharLeft),
        (KeyCode::Delete, false, false) | (KeyCode::Char('d'), true, _) => Delete(CursorReach::CharRight),
        (KeyCode::Backspace, ..) | (KeyCode::Char('w'), true, _) => Delete(CursorReach::WordLeft),
        (KeyCode::Delete, ..) | (KeyCode::Char('d'), _, true) => Delete(CursorReach::WordRight),
        (KeyCode::Char('u'), true, _) => Delete(CursorReach::Home),
        (KeyCode::Char('k'), true, _) => Delete(CursorReach::End),
        _ => return None,
    })
}
