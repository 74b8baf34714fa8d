//! What is shown, apart from the panes: captures, cursor in time, filter, theme.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{Spot, World};
use cobscope_decoder::sink::escape;

use super::{NodeKey, Place, Sought};
use crate::select::Bound;
use crate::theme::{Role, Theme};
use crate::timeline::{Export, Matcher, Order, Row, Search, Survey, Target, Timeline, Window};
use crate::words::unknown_bus;

/// What all panes see, and none of them changes by itself.
pub struct Core {
    /// The captures.
    pub timeline: Timeline,
    /// How things look.
    pub theme: Theme,
    /// Where the cursor is to be.
    pub cursor: Spot,
    /// What is known there, or was at the last place that is known.
    pub window: Option<Window>,
    /// The filter as typed.
    pub filter: String,
    /// Which events are shown.
    pub matcher: Matcher,
    /// What is looked for.
    pub sought: Option<Sought>,
    /// Places with letters.
    pub marks: BTreeMap<char, Spot>,
    /// The node panes tell of.
    pub node: Option<NodeKey>,
    /// What is said below, and how.
    pub said: Option<(Role, String)>,
    /// Goes to the end as more comes.
    pub is_following: bool,
    /// Where a selection of frames begins; it ends at the cursor.
    pub selection: Option<u64>,
    /// Rows a pane has room for.
    pub height: u16,
    /// Columns it has.
    pub width: u16,
    /// Buses the user names, and by what.
    pub named: Vec<(String, &'static str)>,
    serial: u64,
    target: Target,
    /// A place the user named, until it is gone to: it may be one that is not there.
    asked: Option<Bound>,
    is_waiting: bool,
    /// Exports whose end was not told yet.
    exports: usize,
    /// Frames there were when the end was gone to.
    followed: u64,
}

impl Core {
    /// Looks at captures from their beginning.
    pub fn new(timeline: Timeline, theme: Theme) -> Self {
        Self {
            timeline,
            theme,
            cursor: Spot::default(),
            window: None,
            filter: String::new(),
            matcher: Matcher { only_news: true, ..Matcher::default() },
            sought: None,
            marks: BTreeMap::new(),
            node: None,
            said: None,
            is_following: false,
            selection: None,
            height: 24,
            width: 80,
            named: Vec::new(),
            serial: 0,
            target: Target::Spot(Spot::default()),
            asked: None,
            is_waiting: false,
            exports: 0,
            followed: 0,
        }
    }

    /// Asks for what is at a place.
    pub fn go(&mut self, place: Place) {
        let target = match place {
            Place::Start => Target::Spot(Spot::before(1)),
            Place::End => Target::End,
            Place::Spot(spot) => Target::Spot(spot),
            Place::Frame(frame) => Target::Spot(Spot::behind(frame)),
            Place::Time(time) => Target::Time(time),
        };
        if let Target::Spot(spot) = target {
            self.cursor = spot;
        }
        self.target = target;
        self.asked = None;
        self.ask(None);
    }

    /// Goes to a place the user named; if the captures do not have it to their nearest end, which is said.
    pub fn go_to(&mut self, bound: Bound) {
        let place = match bound {
            Bound::Frame(frame) => Place::Frame(frame),
            Bound::Moment(time) => Place::Time(time),
            Bound::Offset(offset) => match self.zero().or(self.timeline.first()) {
                Some(zero) => Place::Time(zero.plus(offset)),
                None => return self.refuse("this capture has no times; go to a frame as #1234"),
            },
        };
        self.go(place);
        self.asked = Some(bound);
    }

    /// Where a place lies that the captures do not have, and what is to be said of it.
    fn outside(&self, bound: Bound) -> Option<(Ordering, String)> {
        let frames = self.timeline.progress().frames();
        let times = self.timeline.progress().times();
        let (what, side) = match (bound, times) {
            (Bound::Frame(0), _) => ("frame", Ordering::Less),
            (Bound::Frame(frame), _) => ("frame", frame.cmp(&frames).max(Ordering::Equal)),
            (_, None) => return None,
            (Bound::Moment(time), Some((first, last))) => ("time", side(time, first, last)),
            (Bound::Offset(offset), Some((first, last))) => ("time", side(first.plus(offset), first, last)),
        };
        let time = self.seconds(times.map(|(_, last)| last)).map_or(String::new(), |t| format!(", {t:.3} s"));
        let text = match side {
            Ordering::Less => format!("no such {what}: the capture begins here"),
            Ordering::Equal => return None,
            Ordering::Greater => format!("no such {what}: the capture ends here, #{frames}{time}"),
        };
        Some((side, text))
    }

    /// Asks again for what is at the place, since something about it changed.
    pub fn refresh(&mut self) {
        self.ask(None);
    }

    /// Goes to the next row that has what is sought, or to the one before.
    pub fn search(&mut self, is_backward: bool) {
        let Some(sought) = &self.sought else { return self.refuse("nothing is searched for; type / first") };
        let matcher = Matcher { text: Some(sought.pattern.clone()), ..Matcher::default() };
        self.target = Target::Spot(self.row().map_or(self.cursor, |row| row.spot));
        self.asked = None;
        self.ask(Some(Search { matcher, is_backward }));
    }

    fn ask(&mut self, search: Option<Search>) {
        self.serial += 1;
        self.is_waiting = true;
        let rows = usize::from(self.height).max(20);
        self.timeline.order(Order {
            serial: self.serial,
            target: self.target,
            before: rows * 2,
            after: rows * 2,
            matcher: self.matcher.clone(),
            search,
        });
    }

    /// Takes the answer to the last order; older ones are late.
    pub fn answer(&mut self, window: Window) {
        if window.serial != self.serial {
            return;
        }
        self.is_waiting = false;
        if window.is_missed {
            let text = self.sought.as_ref().map_or("", |sought| &sought.text);
            self.refuse(&format!("no further place has {text}"));
        }
        if !window.is_pending {
            self.cursor = window.spot;
            self.target = Target::Spot(window.spot);
        }
        let is_there = !window.is_pending;
        self.window = Some(window);
        let outside = self.asked.take_if(|_| is_there).and_then(|bound| self.outside(bound));
        if let Some((side, text)) = outside {
            if side == Ordering::Less {
                self.go(Place::Start);
            }
            self.refuse(&text);
        }
    }

    /// Changes which events are shown.
    pub fn show(&mut self, matcher: Matcher) {
        self.matcher = matcher;
        self.timeline.search(self.matcher.clone());
        self.refresh();
    }

    /// Whether an answer is on its way.
    pub fn is_waiting(&self) -> bool {
        self.is_waiting || self.exports > 0
    }

    /// Goes on to the end where that is followed, and looks again for a place that was not read yet.
    pub fn follow(&mut self) {
        let frames = self.timeline.progress().frames();
        if self.is_pending() && !self.is_waiting {
            self.refresh();
        }
        if self.is_following && !self.is_waiting && frames > self.followed {
            self.followed = frames;
            self.go(Place::End);
        }
    }

    /// First and last frame selected.
    pub fn selected_frames(&self) -> Option<(u64, u64)> {
        let start = self.selection?;
        let here = self.cursor.frame.min(self.timeline.progress().frames());
        Some((start.min(here), start.max(here)))
    }

    /// Writes what is selected, else everything, to a file.
    pub fn export(&mut self, path: &str) {
        let (first, last) = self.selected_frames().unwrap_or((0, u64::MAX));
        let matcher = self.matcher.clone();
        self.exports += 1;
        self.timeline.export(Export { path: path.into(), first, last, matcher });
        self.say("writing …");
    }

    /// An export ended.
    pub fn exported(&mut self, told: Result<String, String>) {
        self.exports = self.exports.saturating_sub(1);
        match told {
            Ok(text) => self.say(&text),
            Err(text) => self.refuse(&text),
        }
    }

    /// Whether the place wanted is not read yet.
    pub fn is_pending(&self) -> bool {
        self.window.as_ref().is_some_and(|window| window.is_pending)
    }

    /// What is known at the cursor.
    pub fn world(&self) -> Option<&World> {
        self.window.as_ref().map(|window| &*window.world)
    }

    /// The rows around the cursor.
    pub fn rows(&self) -> &[Row] {
        self.window.as_ref().map_or(&[], |window| &window.rows)
    }

    /// Which of them is the cursor's.
    pub fn selected(&self) -> usize {
        if let Some(window) = self.window.as_ref().filter(|window| window.is_pending) {
            return window.selected;
        }
        let behind = self.rows().partition_point(|row| row.spot <= self.cursor);
        behind.saturating_sub(1)
    }

    /// The row of the cursor.
    pub fn row(&self) -> Option<&Row> {
        self.rows().get(self.selected())
    }

    /// Time at the cursor: that of its event, else of the last frame before it.
    pub fn time(&self) -> Option<Timestamp> {
        let is_event = self.cursor.ordinal != u32::MAX;
        // What is known is of the place before while the answer is on its way; its rows may reach the new one.
        let is_late =
            self.is_waiting && self.window.as_ref().is_some_and(|window| window.spot != self.cursor);
        let is_there = |row: &&Row| is_late || (is_event && row.spot == self.cursor);
        let event = match self.target {
            Target::Time(time) if is_late => Some(time),
            _ => {
                let behind = self.rows().partition_point(|row| row.spot <= self.cursor);
                let row = behind.checked_sub(1).and_then(|at| self.rows().get(at));
                row.filter(is_there).and_then(|row| row.event.time)
            }
        };
        event.or_else(|| self.world()?.time()).or_else(|| self.timeline.first())
    }

    /// Time of the first frame.
    pub fn zero(&self) -> Option<Timestamp> {
        self.timeline.progress().times().map(|(zero, _)| zero)
    }

    /// A time as seconds from the first frame.
    pub fn seconds(&self, time: Option<Timestamp>) -> Option<f64> {
        #[expect(clippy::cast_precision_loss, reason = "shown with a few digits")]
        Some(time?.since(self.zero()?) as f64 / 1e9)
    }

    /// What a finding says.
    pub fn finding_text(&self, id: u64) -> String {
        let survey = self.timeline.survey();
        if let Some(group) = survey.findings.as_ref().and_then(|findings| findings.group(id)) {
            return escape(&format!("{} {}: {}", group.severity.name(), group.rule, group.text)).into_owned();
        }
        let news = survey.news.iter().find(|opened| opened.news.id == id).map(|opened| &opened.news);
        let text = news.map(|news| format!("{} {}: {}", news.severity.name(), news.rule, news.text));
        escape(&text.unwrap_or_default()).into_owned()
    }

    /// What is said of buses that the user names and the captures do not have, once all of them are known.
    pub fn unknown_buses(&self, survey: &Survey) -> Vec<String> {
        if !survey.is_complete || self.named.is_empty() {
            return Vec::new();
        }
        let captures: Vec<&str> = self.timeline.lanes().iter().map(|lane| lane.store.name()).collect();
        let (captures, has) =
            (captures.join(", "), survey.buses.iter().map(String::as_str).collect::<Vec<_>>());
        self.named.iter().filter_map(|(name, by)| unknown_bus(&captures, name, by, &has)).collect()
    }

    /// Says once which buses there are not, behind what is said already.
    pub fn tell_unknown_buses(&mut self) {
        let unknown = self.unknown_buses(&self.timeline.survey());
        if !unknown.is_empty() {
            let said = self.said.take().map(|(_, text)| text);
            self.refuse(&said.into_iter().chain(unknown).collect::<Vec<_>>().join("; "));
        }
    }

    /// Says something below.
    pub fn say(&mut self, text: &str) {
        self.said = Some((Role::Note, text.to_owned()));
    }

    /// Says that something is not possible.
    pub fn refuse(&mut self, text: &str) {
        self.said = Some((Role::Caution, text.to_owned()));
    }
}

/// On which side of the captures a time lies.
fn side(time: Timestamp, first: Timestamp, last: Timestamp) -> Ordering {
    if time < first { Ordering::Less } else { time.cmp(&last).max(Ordering::Equal) }
}
