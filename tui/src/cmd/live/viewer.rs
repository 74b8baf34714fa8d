//! Rules, output and triggers of live buses.

use std::sync::Arc;

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{Findings, Severity};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Buses, Observer};

use super::triggers::Triggers;
use crate::cli::LiveArgs;
use crate::cmd::messages::note;
use crate::cmd::output::write_result;
use crate::cmd::print::Printer;
use crate::exit_code::Exit;
use crate::timeline::bit_rate_change;

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

/// Runs rules and prints events.
pub(super) struct LiveViewer {
    pub(super) engine: Option<Engine>,
    pub(super) printer: Printer,
    /// Triggers of captures.
    pub(super) triggers: Triggers,
    prints: PrintedKinds,
    /// Lowest severity of a finding that ends the session.
    ends_at: Option<Severity>,
    has_found: bool,
}

impl LiveViewer {
    pub(super) fn new(arguments: &LiveArgs, setup: &Arc<Setup>, printer: Printer) -> Self {
        let triggers = Triggers::new(&arguments.triggers);
        let prints_findings = !arguments.lines.no_findings && arguments.lines.format.0.is_some();
        let judges = arguments.check || (arguments.print && prints_findings) || triggers.needs_rules();
        let prints = match (arguments.print, arguments.check) {
            (true, false) if !prints_findings => PrintedKinds::AllButFindings,
            (true, _) => PrintedKinds::All,
            (false, true) => PrintedKinds::Findings,
            (false, false) => PrintedKinds::Nothing,
        };
        Self {
            engine: judges.then(|| Engine::new(Arc::clone(setup))),
            printer,
            triggers,
            prints,
            ends_at: arguments.fail_on.least().filter(|_| arguments.until_finding),
            has_found: false,
        }
    }

    /// Whether the output failed or its reader is gone.
    pub(super) fn has_failed(&self) -> bool {
        self.printer.is_done()
    }

    /// Ends the rules and the output.
    pub(super) fn finish(self, buses: Buses<'_>) -> (Findings, Exit) {
        let Self { engine, mut printer, mut triggers, prints, .. } = self;
        let findings = engine.map(|engine| {
            let mut out = PrintingObserver {
                printer: &mut printer,
                triggers: &mut triggers,
                prints,
                ends_at: None,
                has_found: &mut false,
            };
            engine.finish(buses, &mut out)
        });
        (findings.unwrap_or_default(), write_result(printer.finish()))
    }

    pub(super) fn is_done(&self) -> bool {
        self.printer.is_done() || (self.has_found && self.ends_at.is_some())
    }

    /// Advances the time of rules without a frame.
    pub(super) fn advance(&mut self, buses: Buses<'_>) {
        let Self { engine, printer, triggers, prints, ends_at, has_found } = self;
        let mut out = PrintingObserver { printer, triggers, prints: *prints, ends_at: *ends_at, has_found };
        for bus in buses {
            if let Some(engine) = engine {
                engine.advance(bus, &mut out);
            }
        }
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

/// Forwards events to the printer and checks findings.
struct PrintingObserver<'a> {
    printer: &'a mut Printer,
    triggers: &'a mut Triggers,
    prints: PrintedKinds,
    ends_at: Option<Severity>,
    has_found: &'a mut bool,
}

impl Observer for PrintingObserver<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if let EventKind::FindingOpened(finding) = &event.kind {
            *self.has_found |= self.ends_at.is_some_and(|least| finding.severity >= least);
        }
        if let Some(change) = bit_rate_change(event) {
            let name = bus.name();
            note(&format!(
                "{name}: {change}; set the new bit rate here too (ip link set {name} down; ip link set {name} up type \
                 can bitrate RATE; for a serial adapter @RATE)"
            ));
        }
        let is_finding = matches!(event.kind, EventKind::FindingOpened(_) | EventKind::FindingClosed(_));
        let is_printed = match self.prints {
            PrintedKinds::All => true,
            PrintedKinds::AllButFindings => !is_finding,
            PrintedKinds::Findings => is_finding,
            PrintedKinds::Nothing => false,
        };
        if is_printed {
            self.printer.event(event, bus);
        }
        self.triggers.event(event, bus);
    }
}

impl Observer for LiveViewer {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let Self { engine, printer, triggers, prints, ends_at, has_found } = self;
        let mut out = PrintingObserver { printer, triggers, prints: *prints, ends_at: *ends_at, has_found };
        match engine {
            Some(engine) => Judge { engine, out: &mut out }.event(event, bus),
            None => out.event(event, bus),
        }
    }
}
