//! The application: state, panes and input mode.

use cobscope_decoder::comparison::DifferenceMarks;
use ratatui::crossterm::event::KeyEvent;

use super::added::Reassign;
use super::candidates::PromptRow;
use super::history::ViewHistory;
use super::jumps::{ResultJumps, story_target};
use super::preferences::{Preferences, RememberedView};
use super::requests::{Compare, ReportOrders, TerminalRequest};
use super::shown_panes::ShownPanes;
use crate::keymap::Keymap;
use crate::state::{JumpPlace, NodeKey, UiState};
use crate::timeline::TimelineNews;
use crate::widgets::prompt::LinePrompt;

/// The application, without the terminal.
pub struct App {
    pub(super) core: UiState,
    pub(super) panes: ShownPanes,
    /// The mouse was pressed in the strip and not released.
    pub(super) is_dragging: bool,
    pub(super) mode: InputMode,
    /// Filters, searches and sort orders before and after the present ones.
    pub(super) history: ViewHistory,
    /// The row above a prompt.
    pub(super) prompt_row: PromptRow,
    /// Filter before the filter prompt was opened.
    pub(super) filter_before: String,
    /// Prompt history by purpose.
    pub(super) typed: Vec<(PromptPurpose, String)>,
    pub(super) outputs: Vec<TerminalRequest>,
    pub(super) keymap: Keymap,
    pub(super) remembered: RememberedView,
    /// Evaluates options that are added while the program runs.
    pub(super) reassign: Reassign,
    /// Node to which the open prompt assigns something.
    pub(super) assigning: Option<NodeKey>,
    pub(super) reports: ReportOrders,
    /// Starts the comparison with another capture, if one was requested.
    pub(super) compare: Option<Compare>,
    /// Command line with the captures, to print the command for this view.
    pub(super) command: String,
    /// Position of the last click, to detect a double click.
    pub(super) clicked: Option<(u16, u16)>,
    /// Keys pressed before the position they act on was known.
    pub(super) early: Vec<KeyEvent>,
    pub(super) jumps: ResultJumps,
}

/// Input mode: the meaning of keys.
pub(super) enum InputMode {
    /// Keys are actions.
    Panes,
    /// Keys edit the text of a prompt.
    Prompt(PromptPurpose, LinePrompt),
    /// The next key names a mark to set or to go to.
    Letter { is_new: bool },
    /// The help is open, scrolled to this line.
    Help(usize),
}

/// Purpose of a prompt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PromptPurpose {
    Filter,
    Search,
    GoTo,
    Export,
    Report,
    Assign,
    Columns,
}

impl App {
    /// Handles a message of the background threads.
    pub fn on_news(&mut self, news: TimelineNews) {
        match news {
            TimelineNews::Window(window) => {
                self.core.take_window(*window);
                for key in std::mem::take(&mut self.early) {
                    self.on_key(key);
                }
                // The window may be older than the index and arrive after the message that the index is
                // complete.
                if self.core.is_pending() && self.is_indexed() {
                    self.core.refresh_window();
                }
            }
            TimelineNews::Exported(reported) => self.core.on_exported(reported),
            TimelineNews::Compared(result) => self.on_compared(result),
            TimelineNews::Changed(text) | TimelineNews::Failed(text) => self.core.show_refusal(&text),
            TimelineNews::Filtered => self.core.refresh_window(),
            TimelineNews::Grew => self.core.timeline.see_growth(),
            TimelineNews::Indexed if self.core.is_pending() => self.core.refresh_window(),
            TimelineNews::Surveyed => {
                self.jumps.is_surveyed = true;
                if std::mem::take(&mut self.jumps.opens_at_story)
                    && let Some((frame, _)) = story_target(&self.core, 0)
                {
                    self.core.jump_to(JumpPlace::Frame(frame));
                }
                self.core.report_unknown_buses();
            }
            TimelineNews::Indexed | TimelineNews::Traced => {}
        }
        // A jump that was requested before its target was known.
        if let Some(action) = self.jumps.awaited.take() {
            self.perform_action(action);
        }
        self.panes.refresh_panes(&self.core);
    }

    /// Compares with the other capture, if one was requested, with the present options of the decoder.
    pub(super) fn start_comparison(&mut self) {
        let Some(compare) = &mut self.compare else { return };
        if let Some(against) = &mut self.core.against.0 {
            against.result = None;
        }
        if let Err(error) = compare(self.core.timeline.options()) {
            self.on_compared(Err(format!("{error:#}")));
        }
    }

    fn on_compared(&mut self, result: Result<Box<DifferenceMarks>, String>) {
        if let Err(reason) = &result {
            self.core.show_refusal(&format!("--against: {reason}"));
        }
        if let Some(against) = &mut self.core.against.0 {
            against.result = Some(result);
        }
    }

    /// Called regularly; moves the cursor to new frames while following.
    pub fn on_tick(&mut self) {
        self.core.follow_end();
    }

    /// Removes and returns the requests to the terminal.
    pub fn take_outputs(&mut self) -> Vec<TerminalRequest> {
        std::mem::take(&mut self.outputs)
    }

    /// Whether the content at the cursor is still being read.
    pub fn is_seeking(&self) -> bool {
        self.core.is_waiting()
    }

    /// Whether the captures are read to their end.
    pub fn is_indexed(&self) -> bool {
        self.core.timeline.progress().is_complete()
    }

    /// Number of frames read so far.
    pub fn frames(&self) -> u64 {
        self.core.timeline.progress().frames()
    }

    /// Whether live buses are connected, whose state may change without new frames.
    pub fn is_live(&self) -> bool {
        self.core.timeline.live().is_some_and(|live| !live.get().has_ended)
    }

    /// Layout, strip and colours as they are now; None if the user discarded the remembered view and changed
    /// nothing since.
    pub fn changed_preferences(&self) -> Option<Preferences> {
        self.remembered.changed_preferences(&self.panes, &self.core)
    }

    /// Whether the user discarded the remembered view.
    pub fn is_forgotten(&self) -> bool {
        self.remembered.is_forgotten
    }

    /// Whether background work will change the screen, except the growth of a capture.
    pub fn is_busy(&self) -> bool {
        let timeline = &self.core.timeline;
        let is_searching = timeline.search_matches().is_some_and(|matches| !matches.is_complete());
        self.core.is_waiting()
            || self.core.is_pending()
            || self.core.against.is_comparing()
            || self.core.is_previewing()
            || is_searching
            || timeline.is_tracing()
            || !(timeline.may_grow() || timeline.progress().is_complete() && self.jumps.is_surveyed)
    }
}

#[cfg(test)]
mod tests {
    use std::io::BufWriter;
    use std::sync::Arc;
    use std::sync::mpsc::{Receiver, channel};
    use std::time::Duration;

    use cobscope_decoder::capture::{FrameWriter, Notice, WRITABLE, WriteOptions};
    use cobscope_decoder::frame::{BusIndex, CanId, Frame, LinkState, Timestamp};
    use ratatui::buffer::Buffer;
    use ratatui::layout::Rect;

    use super::super::start::ViewSettings;
    use super::*;
    use crate::action::Action;
    use crate::panes::PaneId;
    use crate::source::DecompressedBytes;
    use crate::source::live::SharedLiveState;
    use crate::theme::{ColorDepth, LineCharacters, Theme, ThemePalette};
    use crate::timeline::{JoinOptions, LiveBuses, Timeline, TimelineCaptures};

    /// Time limit of a test step on a busy machine.
    const LIMIT: Duration = Duration::from_mins(1);

    /// A live view, and the writer of its bus.
    struct LiveView {
        app: App,
        news: Receiver<TimelineNews>,
        writer: Box<dyn FrameWriter>,
    }

    impl LiveView {
        fn new() -> Self {
            let (store, written) = DecompressedBytes::for_live("live".into(), 0).unwrap();
            let format = WRITABLE.iter().find(|format| format.name == "pcapng").unwrap();
            let mut writer = (format.writer)(Box::new(BufWriter::new(written)), &WriteOptions::default());
            writer.flush().unwrap();
            let (sender, news) = channel();
            let captures = TimelineCaptures {
                paths: Vec::new(),
                align: false,
                join: JoinOptions::OFF,
                read: cobscope_decoder::capture::ReadOptions::default(),
                session: cobscope_decoder::session::SessionOptions::default(),
                rules: Arc::default(),
                live: Some(LiveBuses { store, state: SharedLiveState::default() }),
            };
            let timeline = Timeline::open(captures, sender).unwrap();
            let start = ViewSettings {
                command: "cobscope live can0".into(),
                pane: PaneId::Events,
                preferences: Preferences::default(),
                defaults: Preferences::default(),
                keymap: Keymap::default(),
                reassign: Box::new(|_, _| anyhow::bail!("not needed here")),
                write_report: Box::new(|_, _| anyhow::bail!("not needed here")),
                at: None,
                filter: None,
                all: false,
                follows: true,
                named: Vec::new(),
                against: None,
            };
            let theme = Theme::new(ThemePalette::Dark, ColorDepth::None, LineCharacters::Unicode);
            let mut app = App::new(timeline, theme, start);
            app.on_resize(80, 24);
            Self { app, news, writer }
        }

        fn frame(&mut self, millis: i64, id: u16, data: &[u8]) {
            let time = Some(Timestamp(millis * 1_000_000));
            let frame = Frame { time, ..Frame::data_frame(CanId::from_standard(id), data) };
            self.writer.write(&frame, "can0").unwrap();
            self.writer.flush().unwrap();
        }

        fn screen(&mut self) -> String {
            let area = Rect::new(0, 0, 80, 24);
            let mut buffer = Buffer::empty(area);
            self.app.draw(area, &mut buffer);
            let cells = (0..area.height).flat_map(|y| (0..area.width).map(move |x| (x, y)));
            cells.filter_map(|cell| buffer.cell(cell)).map(ratatui::buffer::Cell::symbol).collect()
        }

        /// Handles messages until the screen contains a text.
        fn wait(&mut self, text: &str) -> String {
            loop {
                let screen = self.screen();
                if screen.contains(text) {
                    return screen;
                }
                let news = self.news.recv_timeout(LIMIT).unwrap_or_else(|_| panic!("no {text}:\n{screen}"));
                self.app.on_news(news);
                self.app.on_tick();
            }
        }
    }

    #[test]
    fn a_live_view_shows_links_and_stories_as_they_happen() {
        let mut view = LiveView::new();
        for number in 0..300 {
            view.frame(number * 7 + number % 3, 0x701 + u16::try_from(number % 4).unwrap(), &[5]);
        }
        view.wait("#300/300");
        let (bus, time) = (BusIndex(0), Timestamp(2_200_000_000));
        let link = Notice::Link { bus, time, state: LinkState::Down, bit_rate: None };
        view.writer.notice(&link, "can0").unwrap();
        view.writer.flush().unwrap();
        assert!(view.wait("LINK").contains("2.200"));
        // The cursor stays with the user.
        view.app.perform_action(Action::Top);
        view.wait("#1/300");
        view.frame(2_300, 0x81, &[0x10, 0x23, 1, 0, 0, 0, 0, 0]);
        view.wait("1 warning so far: 1/01");
        view.wait("#1/301");
    }
}
