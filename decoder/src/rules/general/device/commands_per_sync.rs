//! Several RPDOs per SYNC interval, of which only the last one is effective.

use crate::event::{DecodedPdo, Event, EventKind, FrameRange, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::profile::PdoName;
use crate::profile::device::PdoEffect;
use crate::rules::general::facts::confirmed_number;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// More than `note-count` RPDOs of one identifier are sent between two SYNCs, although the RPDO takes
    /// effect at SYNC: according to its transmission type (14xx:02 written or read, 0 to 240), otherwise to
    /// the device manual. Only the last one is effective. Transmission types 254 and 255 are exempt.
    ///
    /// # Why it matters
    /// The other commands are lost. A device may also report an overflow.
    ///
    /// # Source
    /// RPDOs that take effect at SYNC: device manual; CiA 301 §7.2.2.2 (synchronous PDOs), §7.5.2.35
    /// (transmission type)
    ///
    /// # What to look at first
    /// Send SYNC and commands in the same controller cycle.
    ///
    /// # Mutation
    /// send the RPDO three times between two SYNCs
    "commands-per-sync", Warning, "several RPDOs in one SYNC interval",
    kinds: [
        Kind::Pdo, Kind::Sync, Kind::SdoTransfer, Kind::BootUp, Kind::Emcy, Kind::NodeIdentified,
        Kind::NodeIdChange,
    ],
    pdos: PdoSubset::Received,
    transfers: TransferSubset::Communication,
    needs: "SYNC, and RPDOs that take effect at SYNC according to 14xx:02 or the profile",
    word: "SYNC",
    tolerances: &[
        define_tolerance("note-count", 1.0, "", "maximum RPDOs of one identifier in a SYNC interval, else a note"),
        define_tolerance("warning-count", 2.0, "", "maximum RPDOs of one identifier in a SYNC interval, else a warning"),
    ],
}

/// Maximum SYNC interval, in nanoseconds; other rules report a SYNC that has stopped.
const ALIVE: i64 = 1_000_000_000;

/// Highest transmission type that waits for SYNC (CiA 301 §7.5.2.35).
const LAST_SYNCHRONOUS: u64 = 240;

/// One RPDO, stored by its index in [`crate::rules::PdoTraffic`].
#[derive(Default)]
struct RpdoCommands {
    /// The RPDO takes effect at SYNC; `None` before the look-up.
    waits: Option<bool>,
    of: Option<(NodeId, PdoName)>,
    count: u32,
    frames: FrameRange,
}

struct CommandsPerSync {
    note: f64,
    warning: f64,
    commands: BySlot<RpdoCommands>,
    /// Indices of the RPDOs that take effect at SYNC.
    waiting: Vec<usize>,
    last: Option<i64>,
    /// At least one device has an RPDO that takes effect at SYNC.
    may_wait: bool,
}

fn new(policy: &RulePolicy) -> CommandsPerSync {
    CommandsPerSync {
        note: policy.tolerance_value(&DECLARATION, "note-count"),
        warning: policy.tolerance_value(&DECLARATION, "warning-count"),
        commands: BySlot::default(),
        waiting: Vec::new(),
        last: None,
        may_wait: true,
    }
}

impl CommandsPerSync {
    #[inline]
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let Some(slot) = context.traffic.current_slot() else { return };
        let Some(commands) = self.commands.entry_of(slot) else { return };
        match commands.waits {
            Some(false) => {}
            Some(true) => commands.take_command(event.frames.last),
            None => {
                self.look_up(event, pdo, slot.place, context);
                context.ask_again();
            }
        }
    }

    #[cold]
    fn look_up(&mut self, event: &Event, pdo: &DecodedPdo, place: usize, context: &RuleContext<'_>) {
        let (Some(commands), Some(id)) = (self.commands.get_mut(place), event.node) else { return };
        let waits = context.event_node(event).is_some_and(|node| waits_for_sync(node, pdo.name));
        commands.waits = Some(waits);
        if waits {
            commands.of = Some((id, pdo.name));
            commands.take_command(event.frames.last);
            self.waiting.push(place);
        }
    }

    fn on_sync(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let before = self.last.replace(context.now);
        let is_alive = before.is_some_and(|before| context.now.saturating_sub(before) <= ALIVE);
        for place in &self.waiting {
            let Some(commands) = self.commands.get_mut(*place) else { continue };
            let (count, frames) = (std::mem::take(&mut commands.count), commands.frames);
            let (Some((node, name)), true, 1..) = (commands.of, is_alive, count) else { continue };
            if f64::from(count) <= self.note {
                context.count_pass();
                continue;
            }
            let most = self.note;
            let severity = if f64::from(count) > self.warning { Severity::Warning } else { Severity::Note };
            let alarm = context
                .start_finding(event)
                .at_node(Some(node))
                .with_subject(FindingSubject::Name(name.to_string().into()));
            let alarm = alarm.with_severity(severity).with_measure(f64::from(count)).with_frames(frames);
            alarm.report_finding(|| {
                format!("{count} {name} in one SYNC interval (max {most}, only the last is effective)")
            });
        }
    }

    fn forget_commands(&mut self, context: &mut RuleContext<'_>) {
        context.ask_again();
        self.waiting.clear();
        self.commands.clear();
    }
}

/// Whether an RPDO takes effect at SYNC. The profile overrides a synchronous transmission type only.
fn waits_for_sync(node: &Node, name: PdoName) -> bool {
    let kind = confirmed_number(node, name.communication_index(), 2);
    let spec = node.device().pdos.iter().find(|spec| spec.pdo == name);
    match (spec.map(|spec| spec.effect).unwrap_or_default(), kind) {
        (PdoEffect::AtOnce, _) => false,
        (PdoEffect::AtSync, None) => true,
        (_, kind) => kind.is_some_and(|kind| kind <= LAST_SYNCHRONOUS),
    }
}

/// Whether an object is the transmission type of an RPDO.
const fn is_type(object: ObjectAddress) -> bool {
    matches!(object.index, 0x1400..=0x15FF) && object.sub == 2
}

/// Whether any device may have an RPDO that takes effect at SYNC.
fn may_wait(bus: &Bus) -> bool {
    let by_profile = |node: &Node| node.device().pdos.iter().any(|spec| spec.effect == PdoEffect::AtSync);
    let by_type = |node: &Node| node.store().sorted().iter().any(|(object, _)| is_type(*object));
    bus.nodes().any(|node| by_profile(node) || by_type(node))
}

impl RpdoCommands {
    fn take_command(&mut self, frame: u64) {
        if self.count == 0 {
            self.frames.first = frame;
        }
        self.frames.last = frame;
        self.count = self.count.saturating_add(1);
    }
}

impl Rule for CommandsPerSync {
    fn begin_bus(&mut self, context: &mut RuleContext<'_>) {
        self.may_wait = may_wait(context.bus);
    }

    fn wants_pdos(&self) -> bool {
        self.may_wait
    }

    fn frame_need(&self, _event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let commands = context.traffic.current_slot().and_then(|slot| self.commands.get(slot.place));
        match commands.and_then(|commands| commands.waits) {
            Some(false) => FrameNeed::NOTHING,
            Some(true) | None => FrameNeed::EACH,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) => self.on_pdo(event, pdo, context),
            EventKind::Sync { .. } => self.on_sync(event, context),
            // Another device may have other PDOs.
            EventKind::NodeIdentified(_) => {
                self.forget_commands(context);
                self.may_wait = may_wait(context.bus);
            }
            EventKind::SdoTransfer(transfer) if transfer.object.is_some_and(is_type) => {
                self.forget_commands(context);
                self.may_wait = true;
            }
            EventKind::BootUp { .. } => self.forget_commands(context),
            EventKind::Emcy(emergency) if emergency.boot.is_some() => self.forget_commands(context),
            EventKind::NodeIdChange { .. } => self.may_wait = may_wait(context.bus),
            _ => {}
        }
    }
}
