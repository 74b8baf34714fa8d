//! State shared by all panes: captures, cursor, filter, marks, theme.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{EventPosition, ReplayState};
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;

use super::against::CaptureDifferences;
use super::place::PositionPreview;
use super::{JumpPlace, NodeKey, SearchPattern, TimeDisplay};
use crate::select::{RangeBound, spans_days, wall_clock};
use crate::theme::{TextRole, Theme};
use crate::timeline::{
    ExportRequest, ReplayRow, RowMatcher, RowWindow, SeekTarget, SurveyResults, TextSearch, Timeline,
    WindowRequest,
};
use crate::words::{unheard_note, unknown_bus};
use cobscope_decoder::figures::seconds_to;

/// State that all panes read; only the application changes it.
pub struct UiState {
    /// The captures with their background threads.
    pub timeline: Timeline,
    /// Colours and characters.
    pub theme: Theme,
    /// Requested position of the cursor.
    pub cursor: EventPosition,
    /// Content at the cursor; of its previous position while the new one is being read.
    pub window: Option<RowWindow>,
    /// Filter as typed.
    pub filter: String,
    /// Selection of the shown events.
    pub matcher: RowMatcher,
    /// Text of the last search.
    pub sought: Option<SearchPattern>,
    /// Marks by letter.
    pub marks: BTreeMap<char, EventPosition>,
    /// The selected node.
    pub node: Option<NodeKey>,
    /// Message in the status line with its role.
    pub stated: Option<(TextRole, String)>,
    /// The cursor moves to the end as the capture grows.
    pub is_following: bool,
    /// First frame of the selection; it ends at the cursor.
    pub selection: Option<u64>,
    /// Display of times.
    pub clock: TimeDisplay,
    /// Height of the terminal.
    pub screen_height: u16,
    /// Height of the focused pane.
    pub height: u16,
    /// Width of the focused pane.
    pub width: u16,
    /// Titles of the columns that the user chose, by name of the pane.
    pub columns: BTreeMap<String, Vec<String>>,
    /// Buses named by the user, with the option that names them.
    pub named: Vec<(String, &'static str)>,
    /// Comparison with another capture.
    pub against: CaptureDifferences,
    pub(super) serial: u64,
    pub(super) preview: Option<PositionPreview>,
    target: SeekTarget,
    /// Position requested by the user until it is reached; it may not exist.
    asked: Option<RangeBound>,
    is_waiting: bool,
    /// The outstanding window is the result of a search.
    is_searching: bool,
    /// Number of running exports.
    exports: usize,
    /// Last event when the cursor last moved to the end.
    followed: EventPosition,
}

impl UiState {
    /// A view of captures at their start.
    pub fn new(timeline: Timeline, theme: Theme) -> Self {
        Self {
            timeline,
            theme,
            cursor: EventPosition::default(),
            window: None,
            filter: String::new(),
            matcher: RowMatcher { only_news: true, ..RowMatcher::default() },
            sought: None,
            marks: BTreeMap::new(),
            node: None,
            stated: None,
            is_following: false,
            selection: None,
            clock: TimeDisplay::default(),
            screen_height: 24,
            height: 24,
            width: 80,
            columns: BTreeMap::new(),
            named: Vec::new(),
            against: CaptureDifferences::default(),
            serial: 0,
            preview: None,
            target: SeekTarget::Event(EventPosition::default()),
            asked: None,
            is_waiting: false,
            is_searching: false,
            exports: 0,
            followed: EventPosition::default(),
        }
    }

    /// Moves the cursor and requests the content there.
    pub fn jump_to(&mut self, place: JumpPlace) {
        if place != JumpPlace::End {
            self.pause_following();
        }
        let target = match place {
            JumpPlace::Start => SeekTarget::Event(EventPosition::before_frame(1)),
            JumpPlace::End => SeekTarget::End,
            JumpPlace::Event(spot) => SeekTarget::Event(spot),
            JumpPlace::Frame(frame) => SeekTarget::Event(EventPosition::after_frame(frame)),
            JumpPlace::Time(time) => SeekTarget::Time(time),
        };
        if let SeekTarget::Event(spot) = target {
            self.cursor = spot;
        }
        self.target = target;
        self.asked = None;
        self.ask_window(None);
    }

    /// Ends following: the cursor stays where the user moves it.
    fn pause_following(&mut self) {
        if std::mem::take(&mut self.is_following) {
            self.show_message("paused at the cursor; space follows again");
        }
    }

    /// Moves the cursor to a position named by the user. Outside the captures it stops at their end with a
    /// message.
    pub fn go_to(&mut self, bound: RangeBound) {
        match self.place_of(bound) {
            Ok((bound, place)) => {
                self.jump_to(place);
                self.asked = Some(bound);
            }
            Err(reason) => self.show_refusal(&reason),
        }
    }

    /// Requests the content at the cursor again after a change.
    pub fn refresh_window(&mut self) {
        self.ask_window(None);
    }

    /// Searches for the next or previous matching row.
    pub fn search_row(&mut self, is_backward: bool) {
        let Some(sought) = &self.sought else { return self.show_refusal("no search text; press / first") };
        let matcher = RowMatcher { text: Some(sought.pattern.clone()), ..RowMatcher::default() };
        self.pause_following();
        self.target = SeekTarget::Event(self.cursor_row().map_or(self.cursor, |row| row.spot));
        self.asked = None;
        self.ask_window(Some(TextSearch { matcher, is_backward }));
    }

    fn ask_window(&mut self, search: Option<TextSearch>) {
        self.serial += 1;
        self.preview = None;
        self.is_waiting = true;
        self.is_searching = search.is_some();
        let rows = usize::from(self.screen_height).max(20);
        self.timeline.request_window(WindowRequest {
            serial: self.serial,
            target: self.target,
            before: rows * 2,
            after: rows * 2,
            matcher: self.matcher.clone(),
            search,
        });
    }

    /// Takes a requested window; windows of older requests are ignored.
    pub fn take_window(&mut self, window: RowWindow) {
        // A window that is not awaited belongs to a preview that has ended.
        if self.take_preview(&window) || window.serial != self.serial || !self.is_waiting {
            return;
        }
        self.is_waiting = false;
        if window.is_missed {
            let text = self.sought.as_ref().map_or("", |sought| &sought.text);
            self.show_refusal(&format!("no further match for {text}"));
        }
        if !window.is_pending {
            self.cursor = window.spot;
            self.target = SeekTarget::Event(window.spot);
        }
        let is_there = !window.is_pending;
        self.window = Some(window);
        let outside = self.asked.take_if(|_| is_there).and_then(|bound| self.position_outside(bound));
        if let Some((side, text)) = outside {
            if side == Ordering::Less {
                self.jump_to(JumpPlace::Start);
            }
            self.show_refusal(&text);
        }
    }

    /// Changes the selection of shown events.
    pub fn show_events(&mut self, matcher: RowMatcher) {
        self.matcher = matcher;
        self.timeline.start_search(self.matcher.clone());
        self.refresh_window();
    }

    /// Decodes the captures with other options and requests the content at the cursor again.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn replace_options(&mut self, options: SessionOptions) -> anyhow::Result<()> {
        self.timeline.reopen_with(options)?;
        self.timeline.start_search(self.matcher.clone());
        self.refresh_window();
        Ok(())
    }

    /// Whether a window or an export is outstanding.
    pub fn is_waiting(&self) -> bool {
        self.is_waiting || self.exports > 0
    }

    /// Whether the cursor is about to move to an unread row.
    pub fn is_moving(&self) -> bool {
        let rows = self.shown_rows();
        let is_read = |first: &ReplayRow, last: &ReplayRow| (first.spot..=last.spot).contains(&self.cursor);
        let is_read = rows.first().zip(rows.last()).is_some_and(|(first, last)| is_read(first, last));
        let is_known = is_read && matches!(self.target, SeekTarget::Event(_));
        self.is_waiting && (self.is_searching || !is_known)
    }

    /// Whether a search for a text is running.
    pub fn is_searching(&self) -> bool {
        self.is_waiting && self.is_searching
    }

    /// Ends a search for a text; the cursor stays.
    pub fn end_search(&mut self) {
        self.target = SeekTarget::Event(self.cursor);
        self.asked = None;
        self.ask_window(None);
    }

    /// Moves to the end while following, and requests a position again that was not read yet.
    pub fn follow_end(&mut self) {
        if self.is_pending() && !self.is_waiting {
            self.refresh_window();
        }
        // Events without a frame count too: a link that closes, a node that is lost.
        let end = self.timeline.progress().last_position();
        if self.is_following && !self.is_waiting && end != self.followed {
            self.followed = end;
            self.jump_to(JumpPlace::End);
        }
    }

    /// First and last frame of the selection.
    pub fn selected_frames(&self) -> Option<(u64, u64)> {
        let start = self.selection?;
        let here = self.cursor.frame.min(self.timeline.progress().frames());
        Some((start.min(here), start.max(here)))
    }

    /// Exports the selection, or everything, to a file.
    pub fn export_file(&mut self, path: &str) {
        let (first, last) = self.selected_frames().unwrap_or((0, u64::MAX));
        let matcher = self.matcher.clone();
        self.timeline.start_export(ExportRequest { path: path.into(), first, last, matcher });
        self.begin_export();
    }

    /// Counts a file that a thread writes; its result arrives as [`News::Exported`](crate::timeline::News::Exported).
    pub fn begin_export(&mut self) {
        self.exports += 1;
        self.show_message("writing …");
    }

    /// Shows the result of an export.
    pub fn on_exported(&mut self, reported: Result<String, String>) {
        self.exports = self.exports.saturating_sub(1);
        match reported {
            Ok(text) => self.show_message(&text),
            Err(text) => self.show_refusal(&text),
        }
    }

    /// Whether the requested position is not read yet.
    pub fn is_pending(&self) -> bool {
        self.window.as_ref().is_some_and(|window| window.is_pending)
    }

    /// State of the buses at the cursor.
    pub fn bus_state(&self) -> Option<&ReplayState> {
        self.window.as_ref().map(|window| &*window.world)
    }

    /// Rows around the cursor.
    pub fn shown_rows(&self) -> &[ReplayRow] {
        self.window.as_ref().map_or(&[], |window| &window.rows)
    }

    /// Index of the row at the cursor.
    pub fn selected_index(&self) -> usize {
        if let Some(window) = self.window.as_ref().filter(|window| window.is_pending) {
            return window.selected;
        }
        let behind = self.shown_rows().partition_point(|row| row.spot <= self.cursor);
        behind.saturating_sub(1)
    }

    /// The row at the cursor.
    pub fn cursor_row(&self) -> Option<&ReplayRow> {
        self.shown_rows().get(self.selected_index())
    }

    /// Time at the cursor: of its event, else of the last frame before it.
    pub fn cursor_time(&self) -> Option<Timestamp> {
        let is_event = self.cursor.ordinal != u32::MAX;
        // Until the requested window arrives, the state is that of the previous position; its rows may
        // include the new one.
        let is_late =
            self.is_waiting && self.window.as_ref().is_some_and(|window| window.spot != self.cursor);
        let is_there = |row: &&ReplayRow| is_late || (is_event && row.spot == self.cursor);
        let event = match self.target {
            SeekTarget::Time(time) if is_late => Some(time),
            _ => {
                let behind = self.shown_rows().partition_point(|row| row.spot <= self.cursor);
                let row = behind.checked_sub(1).and_then(|at| self.shown_rows().get(at));
                row.filter(is_there).and_then(|row| row.event.time)
            }
        };
        // Without a state, only the start has a known time.
        let first = || self.timeline.first_time().filter(|_| self.cursor.frame <= 1);
        event.or_else(|| self.bus_state()?.last_time()).or_else(first)
    }

    /// Time of the first frame.
    pub fn first_time(&self) -> Option<Timestamp> {
        self.timeline.progress().time_range().map(|(zero, _)| zero)
    }

    /// A time in the chosen display, with `decimals` of a second; None without a time.
    pub fn time_text(&self, time: Option<Timestamp>, decimals: u32) -> Option<String> {
        let (first, last) = self.timeline.progress().time_range()?;
        let time = time?;
        let is_local = match self.clock {
            TimeDisplay::Relative => return Some(seconds_to(time.since(first), decimals)),
            TimeDisplay::Utc => false,
            TimeDisplay::Local => true,
        };
        Some(wall_clock(time, is_local, spans_days(first, last, is_local), decimals))
    }

    /// As [`Self::time_text`], with the unit of seconds.
    pub fn time_words(&self, time: Option<Timestamp>, decimals: u32) -> Option<String> {
        let unit = if self.clock == TimeDisplay::Relative { " s" } else { "" };
        Some(self.time_text(time, decimals)? + unit)
    }

    /// Switches to the next display of times; only captures with dates have wall-clock times.
    pub fn next_clock(&mut self) {
        match self.first_time() {
            None => self.show_refusal("this capture has no timestamps"),
            Some(zero) if !zero.has_date() => {
                self.show_refusal("times count from the start of the capture; no wall-clock time");
            }
            Some(_) => {
                self.clock = self.clock.next();
                self.show_message(self.clock.change_text());
            }
        }
    }

    /// A time as seconds from the first frame.
    pub fn seconds_of(&self, time: Option<Timestamp>) -> Option<f64> {
        #[expect(clippy::cast_precision_loss, reason = "shown with a few digits")]
        Some(time?.since(self.first_time()?) as f64 / 1e9)
    }

    /// Severity, rule and text of a finding.
    pub fn finding_text(&self, id: u64) -> String {
        let survey = self.timeline.survey();
        if let Some(group) = survey.findings.as_ref().and_then(|findings| findings.group_by_id(id)) {
            return escape(&format!("{} {}: {}", group.severity.name(), group.rule, group.text)).into_owned();
        }
        let news =
            survey.overview.opened.iter().find(|opened| opened.news.id == id).map(|opened| &opened.news);
        let text = news.map(|news| format!("{} {}: {}", news.severity.name(), news.rule, news.text));
        escape(&text.unwrap_or_default()).into_owned()
    }

    /// Messages about buses that the user named and the captures do not contain; empty until all buses are
    /// known.
    pub fn unknown_buses(&self, survey: &SurveyResults) -> Vec<String> {
        if !survey.is_complete || self.named.is_empty() {
            return Vec::new();
        }
        let captures = self.capture_names();
        let has: Vec<&str> = survey.buses.iter().map(String::as_str).collect();
        self.named.iter().filter_map(|(name, by)| unknown_bus(&captures, name, by, &has)).collect()
    }

    /// Message about nodes that the user named and that sent no frame; `None` until the captures are read.
    fn unheard_nodes(&self) -> Option<String> {
        let end = self.timeline.end_state().filter(|_| self.timeline.live().is_none())?;
        unheard_note(&self.capture_names(), end.buses(), self.timeline.options())
    }

    /// Names of the captures.
    fn capture_names(&self) -> String {
        let names: Vec<&str> = self.timeline.open_captures().iter().map(|lane| lane.store.name()).collect();
        names.join(", ")
    }

    /// Adds these messages to the status line.
    pub fn report_unknown_buses(&mut self) {
        let mut unknown = self.unknown_buses(&self.timeline.survey());
        unknown.extend(self.unheard_nodes());
        if !unknown.is_empty() {
            let stated = self.stated.take().map(|(_, text)| text);
            self.show_refusal(&stated.into_iter().chain(unknown).collect::<Vec<_>>().join("; "));
        }
    }

    /// Shows a message in the status line.
    pub fn show_message(&mut self, text: &str) {
        self.stated = Some((TextRole::Note, text.to_owned()));
    }

    /// Shows in the status line that something is not possible.
    pub fn show_refusal(&mut self, text: &str) {
        self.stated = Some((TextRole::Caution, text.to_owned()));
    }
}
