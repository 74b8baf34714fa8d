//! Tests of the prompt.

use ratatui::crossterm::event::{KeyCode, KeyEventKind, KeyModifiers};

use super::*;
use crate::theme::LineCharacters;
use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

fn press(prompt: &mut LinePrompt, code: KeyCode, modifiers: KeyModifiers) -> PromptEvent {
    prompt.on_key(KeyEvent::new(code, modifiers))
}

fn typed(prompt: &mut LinePrompt, text: &str) {
    for letter in text.chars() {
        assert_eq!(press(prompt, KeyCode::Char(letter), KeyModifiers::NONE), PromptEvent::Changed);
    }
}

fn control(prompt: &mut LinePrompt, letter: char) -> PromptEvent {
    press(prompt, KeyCode::Char(letter), KeyModifiers::CONTROL)
}

/// The text with a bar at the cursor.
fn line(prompt: &LinePrompt) -> String {
    let (before, after) = prompt.text().split_at(prompt.cursor());
    format!("{before}|{after}")
}

#[test]
fn typing_and_deleting() {
    let mut prompt = LinePrompt::new("filter:");
    typed(&mut prompt, "nöde = 5");
    assert_eq!(line(&prompt), "nöde = 5|");
    for _ in 0..6 {
        press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
    }
    assert_eq!(line(&prompt), "nö|de = 5");
    press(&mut prompt, KeyCode::Backspace, KeyModifiers::NONE);
    press(&mut prompt, KeyCode::Delete, KeyModifiers::NONE);
    assert_eq!(line(&prompt), "n|e = 5");
    typed(&mut prompt, "日");
    assert_eq!(line(&prompt), "n日|e = 5");
    press(&mut prompt, KeyCode::End, KeyModifiers::NONE);
    press(&mut prompt, KeyCode::Delete, KeyModifiers::NONE);
    press(&mut prompt, KeyCode::Right, KeyModifiers::NONE);
    assert_eq!(line(&prompt), "n日e = 5|");
    press(&mut prompt, KeyCode::Home, KeyModifiers::NONE);
    press(&mut prompt, KeyCode::Backspace, KeyModifiers::NONE);
    press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
    assert_eq!(line(&prompt), "|n日e = 5");
}

#[test]
fn words() {
    let mut prompt = LinePrompt::new("");
    prompt.set_text("sdo.index == 0x6040  ");
    control(&mut prompt, 'w');
    assert_eq!(line(&prompt), "sdo.index == |");
    control(&mut prompt, 'w');
    assert_eq!(line(&prompt), "sdo.|");
    prompt.set_text("state = läuft gut");
    press(&mut prompt, KeyCode::Left, KeyModifiers::CONTROL);
    press(&mut prompt, KeyCode::Char('b'), KeyModifiers::ALT);
    assert_eq!(line(&prompt), "state = |läuft gut");
    press(&mut prompt, KeyCode::Right, KeyModifiers::CONTROL);
    assert_eq!(line(&prompt), "state = läuft| gut");
    press(&mut prompt, KeyCode::Char('d'), KeyModifiers::ALT);
    assert_eq!(line(&prompt), "state = läuft|");
    control(&mut prompt, 'a');
    press(&mut prompt, KeyCode::Char('f'), KeyModifiers::ALT);
    control(&mut prompt, 'k');
    assert_eq!(line(&prompt), "state|");
    control(&mut prompt, 'u');
    assert_eq!(line(&prompt), "|");
    assert_eq!(control(&mut prompt, 'w'), PromptEvent::Changed);
}

#[test]
fn history_goes_back_to_what_was_typed() {
    let mut prompt = LinePrompt::new("").with_history(["first".to_owned(), "second".to_owned()]);
    typed(&mut prompt, "dra");
    let up = |prompt: &mut LinePrompt| press(prompt, KeyCode::Up, KeyModifiers::NONE);
    let down = |prompt: &mut LinePrompt| press(prompt, KeyCode::Down, KeyModifiers::NONE);
    down(&mut prompt);
    assert_eq!(line(&prompt), "dra|");
    let older = [(); 3].map(|()| {
        up(&mut prompt);
        line(&prompt)
    });
    assert_eq!(older, ["second|", "first|", "first|"]);
    let newer = [(); 3].map(|()| {
        down(&mut prompt);
        line(&prompt)
    });
    assert_eq!(newer, ["second|", "dra|", "dra|"]);
    up(&mut prompt);
    up(&mut prompt);
    assert_eq!(press(&mut prompt, KeyCode::Enter, KeyModifiers::NONE), PromptEvent::Submitted);
    assert_eq!(prompt.history(), ["second", "first"]);
    prompt.set_text("");
    assert_eq!(control(&mut prompt, 'm'), PromptEvent::Submitted);
    assert_eq!(prompt.history().len(), 2);
    // An edited line of the history becomes a new draft.
    up(&mut prompt);
    typed(&mut prompt, "!");
    up(&mut prompt);
    down(&mut prompt);
    assert_eq!(line(&prompt), "first!|");
    let mut empty = LinePrompt::new("");
    typed(&mut empty, "x");
    up(&mut empty);
    assert_eq!(line(&empty), "x|");
}

#[test]
fn keys_for_somebody_else() {
    let mut prompt = LinePrompt::new("");
    assert_eq!(press(&mut prompt, KeyCode::Esc, KeyModifiers::NONE), PromptEvent::Cancelled);
    assert_eq!(control(&mut prompt, 'c'), PromptEvent::Cancelled);
    assert_eq!(press(&mut prompt, KeyCode::Tab, KeyModifiers::NONE), PromptEvent::Ignored);
    assert_eq!(press(&mut prompt, KeyCode::F(1), KeyModifiers::NONE), PromptEvent::Ignored);
    assert_eq!(control(&mut prompt, 'z'), PromptEvent::Ignored);
    let mut released = KeyEvent::new(KeyCode::Char('a'), KeyModifiers::NONE);
    released.kind = KeyEventKind::Release;
    assert_eq!(prompt.on_key(released), PromptEvent::Ignored);
    assert_eq!(prompt.text(), "");
}

#[test]
fn what_is_pasted_becomes_one_line() {
    let mut prompt = LinePrompt::new("");
    prompt.set_text("ab");
    press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
    assert_eq!(prompt.paste_text("x\ty\r\nz\x1b[2J\r\n"), PromptEvent::Changed);
    assert_eq!(line(&prompt), "ax y z[2J|b");
}

fn drawn(prompt: &LinePrompt, width: u16) -> Vec<String> {
    let mut buf = Buffer::empty(Rect::new(0, 0, width, 2));
    prompt.render(&plain_theme(LineCharacters::Unicode), buf.area, &mut buf);
    buffer_lines(&buf)
}

#[test]
fn the_caret_is_under_what_is_wrong() {
    let mut prompt = LinePrompt::new("filter:");
    prompt.set_text("nö == 0x6z");
    prompt.set_error(10, "not a digit");
    assert_eq!(drawn(&prompt, 40), ["filter: nö == 0x6z", "                 ^ not a digit"]);
    assert_eq!(drawn(&prompt, 24), ["filter: nö == 0x6z", "     not a digit ^"]);
    // Inside a character, after the end: never a panic.
    prompt.set_error(2, "?");
    assert_eq!(drawn(&prompt, 24)[1], "        ^ ?");
    prompt.set_error(99, "more is wanted");
    assert_eq!(drawn(&prompt, 40)[1], "                  ^ more is wanted");
    typed(&mut prompt, "1");
    assert_eq!(drawn(&prompt, 40)[1], "");
    prompt.set_error(0, "no");
    prompt.clear_error();
    assert_eq!(drawn(&prompt, 40)[1], "");
}

#[test]
fn the_cursor_stays_in_view() {
    let mut prompt = LinePrompt::new("filter:");
    prompt.set_text("0123456789abcdef");
    assert_eq!(drawn(&prompt, 18), ["filter: 789abcdef", ""]);
    assert_eq!(drawn(&prompt, 10), ["789abcdef", ""]);
    control(&mut prompt, 'a');
    assert_eq!(drawn(&prompt, 10), ["0123456789", ""]);
    prompt.set_text("日本語日本語");
    assert_eq!(drawn(&prompt, 7), ["日本語", ""]);
    let mut buf = Buffer::empty(Rect::new(0, 0, 7, 1));
    let theme = plain_theme(LineCharacters::Unicode);
    prompt.render(&theme, buf.area, &mut buf);
    assert_eq!(buf[(6, 0)].modifier, theme.role_style(TextRole::Cursor).add_modifier);
}

#[test]
fn every_small_size() {
    let mut prompt = LinePrompt::new("filter:");
    prompt.set_text("日本語 0123456789");
    prompt.set_error(3, "日本語日本語日本語");
    in_every_small_size(|area, buf| prompt.render(&plain_theme(LineCharacters::Ascii), area, buf));
}

#[test]
fn the_first_typed_key_replaces_a_proposal() {
    let proposed = || {
        let mut prompt = LinePrompt::new("write to");
        prompt.propose_text("pve-export.log");
        prompt
    };
    let mut prompt = proposed();
    typed(&mut prompt, "a.csv");
    assert_eq!(line(&prompt), "a.csv|");
    let mut prompt = proposed();
    press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
    typed(&mut prompt, "x");
    assert_eq!(line(&prompt), "pve-export.lox|g");
    let mut prompt = proposed();
    prompt.paste_text("b.csv");
    assert_eq!(line(&prompt), "b.csv|");
    let mut prompt = proposed();
    press(&mut prompt, KeyCode::Backspace, KeyModifiers::NONE);
    assert_eq!(line(&prompt), "pve-export.lo|");
}

#[test]
fn a_word_is_completed_up_to_the_cursor() {
    let mut prompt = LinePrompt::new("filter");
    prompt.set_text("kind == em && node");
    (0..8).for_each(|_| {
        press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
    });
    prompt.complete_word(8, "emcy");
    assert_eq!(line(&prompt), "kind == emcy| && node");
    // A start after the cursor or inside a character changes nothing.
    prompt.complete_word(99, "x");
    assert_eq!(line(&prompt), "kind == emcy| && node");
}
