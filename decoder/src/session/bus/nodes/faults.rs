//! State of a J1939 device: NAME and trouble codes.

use crate::event::DtcAction;
use crate::session::limits::ACTIVE_ERROR_LIMIT;
use crate::wire::j1939::{J1939Name, LampStates, ReportedDtc, SpnConversion};

/// State of a J1939 device, independent of its address.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct J1939State {
    /// NAME from the address claim; `None` before it.
    pub(in crate::session) name: Option<J1939Name>,
    /// NAME of a contender for the address and monotonic time of its claim; `None` after the response.
    pub(in crate::session) challenged: Option<(J1939Name, i64)>,
    /// Conversion method of old SPNs, from the bus file.
    pub(in crate::session) conversion: Option<SpnConversion>,
    /// Active and previously active trouble codes.
    pub(in crate::session) faults: DeviceFaults,
}

impl J1939State {
    /// Bytes held by this state.
    pub(in crate::session) fn footprint(&self) -> usize {
        size_of::<Self>() + self.faults.footprint()
    }
}

/// A trouble code with the frames that reported it.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct KnownDtc {
    pub(in crate::session) code: ReportedDtc,
    pub(in crate::session) lamps: LampStates,
    pub(in crate::session) first_frame: u64,
    pub(in crate::session) last_frame: u64,
    /// Monotonic time of the first frame.
    pub(in crate::session) since: i64,
    /// The code is in the list that is being read.
    pub(in crate::session) is_listed: bool,
}

impl KnownDtc {
    pub(in crate::session) fn new(code: ReportedDtc, lamps: LampStates, frame: u64, now: i64) -> Self {
        Self { code, lamps, first_frame: frame, last_frame: frame, since: now, is_listed: true }
    }

    pub(in crate::session) fn is_code(&self, code: ReportedDtc) -> bool {
        (self.code.spn, self.code.fmi) == (code.spn, code.fmi)
    }
}

/// Change of a trouble code.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct DtcChange {
    pub(in crate::session) known: KnownDtc,
    pub(in crate::session) action: DtcAction,
}

/// Trouble codes of one device.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct DeviceFaults {
    /// Codes of the last DM1, in the order of their occurrence.
    pub(in crate::session) active: Vec<KnownDtc>,
    /// Codes that were active before; `is_listed` if DM2 contained them.
    pub(in crate::session) previous: Vec<KnownDtc>,
    /// Monotonic time and frame of the last DM1.
    pub(in crate::session) last: i64,
    pub(in crate::session) last_frame: u64,
    /// The DM1 deadline is in the timer queue.
    pub(in crate::session) is_queued: bool,
    /// Overflow of a list was already reported: active codes, previously active codes.
    pub(in crate::session) is_overflow_reported: [bool; 2],
}

impl DeviceFaults {
    /// SPN and FMI of the active codes.
    pub(in crate::session) fn active_codes(&self) -> impl Iterator<Item = (u32, u8)> {
        self.active.iter().map(|known| (known.code.spn, known.code.fmi))
    }

    /// Moves the time of the last DM1 by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_dm1(&mut self, delay: i64) {
        self.last = self.last.saturating_add(delay);
    }

    /// Applies a DM1: returns the changes, and the number of codes over the limit.
    pub(in crate::session) fn active_list(
        &mut self,
        codes: impl Iterator<Item = ReportedDtc>,
        lamps: LampStates,
        frame: u64,
        now: i64,
    ) -> (Vec<DtcChange>, u64) {
        (self.last, self.last_frame) = (now, frame);
        self.active.iter_mut().for_each(|known| known.is_listed = false);
        let (mut changes, mut refused) = (Vec::new(), 0);
        for code in codes {
            let is_full = self.active.len() >= ACTIVE_ERROR_LIMIT;
            match self.active.iter_mut().find(|known| known.is_code(code)) {
                // A message may contain the same code twice.
                Some(known) if known.is_listed => {}
                Some(known) => {
                    let rose = known.code.count.zip(code.count).is_some_and(|(before, now)| now > before);
                    (known.code, known.lamps) = (code, lamps);
                    (known.last_frame, known.is_listed) = (frame, true);
                    if rose {
                        changes.push(DtcChange { known: *known, action: DtcAction::Recurred });
                    }
                }
                None if is_full => refused += 1,
                None => {
                    let known = KnownDtc::new(code, lamps, frame, now);
                    self.active.push(known);
                    self.previous.retain(|previous| !previous.is_code(code));
                    changes.push(DtcChange { known, action: DtcAction::Raised });
                }
            }
        }
        let ended = self.active.iter().filter(|known| !known.is_listed);
        changes.extend(ended.map(|known| DtcChange { known: *known, action: DtcAction::NoLongerReported }));
        self.active.retain(|known| known.is_listed);
        (changes, refused)
    }

    /// Moves a code to the previously active ones; returns whether to report an overflow, at most once.
    pub(in crate::session) fn was_active(&mut self, known: KnownDtc) -> bool {
        if self.previous.iter().any(|previous| previous.is_code(known.code)) {
            return false;
        }
        if self.previous.len() >= ACTIVE_ERROR_LIMIT {
            return self.should_report_overflow(1, 1);
        }
        self.previous.push(KnownDtc { is_listed: false, ..known });
        false
    }

    /// Applies a DM2: returns codes not in an earlier one, and the number of codes over the limit.
    pub(in crate::session) fn previous_list(
        &mut self,
        codes: impl Iterator<Item = ReportedDtc>,
        lamps: LampStates,
        frame: u64,
        now: i64,
    ) -> (Vec<DtcChange>, u64) {
        let mut before = std::mem::take(&mut self.previous);
        let (mut changes, mut refused) = (Vec::new(), 0);
        for code in codes {
            if self.previous.iter().any(|known| known.is_code(code)) {
                continue;
            }
            let place = before.iter().position(|known| known.is_code(code));
            let known = place.map(|place| before.swap_remove(place));
            if self.previous.len() >= ACTIVE_ERROR_LIMIT {
                refused += 1;
                continue;
            }
            let was_reported = known.is_some_and(|known| known.is_listed);
            let known = known.unwrap_or_else(|| KnownDtc::new(code, lamps, frame, now));
            let known = KnownDtc { code, last_frame: frame, is_listed: true, ..known };
            self.previous.push(known);
            if !was_reported {
                changes.push(DtcChange { known, action: DtcAction::PreviouslyActive });
            }
        }
        (changes, refused)
    }

    /// Clears the previously active codes, or all codes. A code that is still active has not ended when it is cleared as a
    /// previously active one (J1939-73 §5.7.3, DM3).
    pub(in crate::session) fn clear_codes(&mut self, all: bool) -> Vec<DtcChange> {
        let active = if all { std::mem::take(&mut self.active) } else { Vec::new() };
        let mut cleared = std::mem::take(&mut self.previous);
        let is_active =
            |known: &KnownDtc| active.iter().chain(&self.active).any(|active| active.is_code(known.code));
        cleared.retain(|known| !is_active(known));
        let changes = active.into_iter().chain(cleared);
        changes.map(|known| DtcChange { known, action: DtcAction::Cleared }).collect()
    }

    /// Whether an overflow of `list` must be reported now.
    pub(in crate::session) fn should_report_overflow(&mut self, list: usize, refused: u64) -> bool {
        let Some(stated) = self.is_overflow_reported.get_mut(list) else { return false };
        !std::mem::replace(stated, refused > 0) && refused > 0
    }

    /// Bytes held by the lists.
    pub(in crate::session) fn footprint(&self) -> usize {
        (self.active.capacity() + self.previous.capacity()) * size_of::<KnownDtc>()
    }
}
