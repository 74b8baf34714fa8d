//! Rules, output and triggers of live buses.

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::Severity;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{FrameDemand, ReadingPart, bit_rate_change};
use cobscope_decoder::session::Bus;

use super::arguments::LiveArgs;
use super::triggers::LiveTriggers;
use crate::run::messages::print_note;
use crate::run::print::{EventPrinter, prints_findings};

/// Kinds of events that are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PrintedKinds {
    /// All events.
    All,
    /// All events without findings; rules run for triggers only.
    AllButFindings,
    /// Findings only.
    Findings,
    /// None; only triggers are printed.
    Nothing,
}

/// Prints events, raises triggers, and ends the session.
pub(super) struct LiveViewer {
    pub(super) printer: EventPrinter,
    /// Triggers of captures.
    pub(super) triggers: LiveTriggers,
    prints: PrintedKinds,
    /// Lowest severity of a finding that ends the session.
    ends_at: Option<Severity>,
    has_found: bool,
}

impl LiveViewer {
    pub(super) fn new(arguments: &LiveArgs, printer: EventPrinter) -> Self {
        let prints = match (arguments.print, arguments.check) {
            (true, false) if !prints_findings(&arguments.lines) => PrintedKinds::AllButFindings,
            (true, _) => PrintedKinds::All,
            (false, true) => PrintedKinds::Findings,
            (false, false) => PrintedKinds::Nothing,
        };
        Self {
            printer,
            triggers: LiveTriggers::new(&arguments.triggers),
            prints,
            ends_at: arguments.fail_on.lowest_severity().filter(|_| arguments.until_finding),
            has_found: false,
        }
    }

    /// Whether rules run.
    pub(super) fn needs_rules(&self, arguments: &LiveArgs) -> bool {
        arguments.check
            || (arguments.print && prints_findings(&arguments.lines))
            || self.triggers.needs_rules()
    }

    /// Whether the output failed or its reader is gone.
    pub(super) fn has_failed(&self) -> bool {
        self.printer.is_done()
    }

    /// Whether the session ends, if no window is open.
    pub(super) fn is_over(&self) -> bool {
        self.printer.is_done() || (self.has_found && self.ends_at.is_some())
    }

    pub(super) fn begin(&mut self, first: &Frame) {
        // A live bus has timestamps, and a time of day is one of today, so selection by time cannot fail.
        let today = first.time.map(|time| (time, time));
        let _ = self.printer.begin(first, &mut || today);
    }

    pub(super) fn flush(&mut self) {
        let _ = self.printer.flush();
    }
}

impl ReadingPart for LiveViewer {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if let Some(change) = bit_rate_change(event) {
            let name = bus.name();
            print_note(&format!(
                "{name}: {change}; set the new bit rate here too (ip link set {name} down; ip link set {name} up type \
                 can bitrate RATE; for a serial adapter @RATE)"
            ));
        }
        if matches!(self.prints, PrintedKinds::All | PrintedKinds::AllButFindings) {
            self.printer.event(event, bus);
        }
        self.triggers.event(event, bus);
    }

    fn finding(&mut self, event: &Event, bus: &Bus) {
        if let EventKind::FindingOpened(finding) = &event.kind {
            self.has_found |= self.ends_at.is_some_and(|least| finding.severity >= least);
        }
        if matches!(self.prints, PrintedKinds::All | PrintedKinds::Findings) {
            self.printer.finding(event, bus);
        }
        self.triggers.event(event, bus);
    }

    fn demand(&self) -> FrameDemand {
        self.printer.demand()
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) {
        self.printer.frame(frame, names);
    }

    fn notice(&mut self, notice: &Notice, names: &BusNames) {
        self.printer.notice(notice, names);
    }
}
