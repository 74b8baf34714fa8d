//! Status of a capture being written.

use std::fmt;
use std::path::PathBuf;

use cobscope_decoder::capture::Notice;
use cobscope_decoder::words::count_noun;

use crate::path_text::path_text;
use cobscope_decoder::figures::format_bytes;

/// A kind of notice that a format cannot store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnstoredKind {
    /// Link state changes.
    Links,
    /// Numbers of lost frames.
    Losses,
    /// Unreadable input.
    Unreadable,
    /// Forward steps of the clock.
    ClockSteps,
}

impl UnstoredKind {
    /// Kind of a notice; None for notices without use in a capture.
    pub(super) fn kind_of(notice: &Notice) -> Option<Self> {
        match notice {
            Notice::Link { .. } => Some(Self::Links),
            Notice::LostFrames { .. } => Some(Self::Losses),
            Notice::Unreadable { .. } | Notice::CutOff { .. } => Some(Self::Unreadable),
            Notice::ClockSet { .. } => Some(Self::ClockSteps),
            // The time of the next frame contains the same information.
            Notice::Assumption(_) | Notice::Quiet(_) => None,
        }
    }

    /// Name for messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Links => "link state changes",
            Self::Losses => "lost frames",
            Self::Unreadable => "unreadable input",
            Self::ClockSteps => "steps of the clock",
        }
    }
}

/// Failure to write a part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordFailure {
    /// Path of the part.
    pub path: PathBuf,
    /// Error of the system.
    pub reason: String,
    /// Number of frames not written because of it.
    pub missing: u64,
    /// Whether writing resumed in another part.
    pub is_over: bool,
}

/// Status so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordStatus {
    /// The current part, or the last one.
    pub path: PathBuf,
    /// Title of its format.
    pub format: &'static str,
    /// Number of parts, including removed ones.
    pub parts: u32,
    /// Number of parts removed because of the limit.
    pub removed: u32,
    /// Number of frames passed to the system; they are on the disk within a second.
    pub frames: u64,
    /// Bytes of all parts, including removed ones.
    pub bytes: u64,
    /// Kinds of notices that the format cannot store.
    pub unheld: Vec<UnstoredKind>,
    /// Properties of frames that the format cannot store, with their number; known at the end.
    pub losses: Vec<String>,
    /// Number of frames not written, for any reason.
    pub missing: u64,
    /// Number of frames not written because the disk was too slow.
    pub too_fast: u64,
    /// Number of triggers not recorded because the disk was too slow.
    pub lost_triggers: u64,
    /// The last failure.
    pub failure: Option<RecordFailure>,
    /// The last failure to write a file other than the capture: its bus file, the ring on disk.
    pub other_failure: Option<RecordFailure>,
    /// No further frames are written.
    pub has_ended: bool,
}

impl RecordStatus {
    /// Whether the capture lacks frames that arrived, or some that were written may not be on the disk.
    pub fn is_incomplete(&self) -> bool {
        self.missing > 0 || self.lost_triggers > 0 || self.failure.is_some() || self.other_failure.is_some()
    }

    /// Total of captures around triggers: `day: 12345 frames, 1.2 MB in 3 captures`.
    pub fn of_cuts(&self) -> String {
        let captures = count_noun(u64::from(self.parts), "capture");
        let total =
            format!("{}: {}, {}", path_text(&self.path), frames_text(self.frames), format_bytes(self.bytes));
        format!("{total} in {captures}{}", self.missing_words())
    }

    fn missing_words(&self) -> String {
        if self.missing > 0 { format!("; {} missing", frames_text(self.missing)) } else { String::new() }
    }

    /// Failures and losses, one sentence each.
    pub fn remark_texts(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if let Some(failure) = &self.failure {
            let RecordFailure { path, reason, missing, is_over } = failure;
            let path = path_text(path);
            remarks.push(if *missing == 0 {
                format!("{path}: {reason}")
            } else if *is_over {
                let now = path_text(&self.path);
                let how = if self.has_ended { "continued" } else { "continuing" };
                format!("{path}: {reason}: {} not written; {how} in {now}", frames_text(*missing))
            } else if self.has_ended {
                format!("{path}: {reason}: {} not written", frames_text(*missing))
            } else {
                format!("{path}: {reason}: {} not written so far; retrying", frames_text(*missing))
            });
        }
        if let Some(RecordFailure { path, reason, .. }) = &self.other_failure {
            remarks.push(format!("{}: {reason}", path_text(path)));
        }
        if self.too_fast > 0 {
            let count = frames_text(self.too_fast);
            remarks.push(format!("{count} not written: the disk is too slow"));
        }
        if self.lost_triggers > 0 {
            let count = count_noun(self.lost_triggers, "trigger");
            remarks.push(format!("{count} not recorded: the disk is too slow"));
        }
        if !self.unheld.is_empty() {
            let names: Vec<_> = self.unheld.iter().map(|unheld| unheld.name()).collect();
            let (format, names) = (self.format, names.join(", "));
            remarks.push(format!("{format} cannot store: {names}; .pcapng stores more"));
        }
        if !self.losses.is_empty() {
            let (format, losses) = (self.format, self.losses.join("; "));
            remarks.push(format!("{format} cannot store: {losses}"));
        }
        remarks
    }

    pub(super) fn leave_out(&mut self, unheld: UnstoredKind) {
        if !self.unheld.contains(&unheld) {
            self.unheld.push(unheld);
        }
    }
}

/// `run-0003.log: 12345 frames, 1.2 MB in 3 parts`.
impl fmt::Display for RecordStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}, {}", path_text(&self.path), frames_text(self.frames), format_bytes(self.bytes))?;
        if self.parts > 1 {
            write!(f, " in {} parts", self.parts)?;
        }
        if self.removed > 0 {
            write!(f, ", {} removed", self.removed)?;
        }
        f.write_str(&self.missing_words())
    }
}

fn frames_text(count: u64) -> String {
    count_noun(count, "frame")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_frames_and_failures_make_it_incomplete() {
        let mut status = RecordStatus::default();
        assert!(!status.is_incomplete());
        status.missing = 1;
        assert!(status.is_incomplete());
        status.missing = 0;
        let (path, reason) = ("run.log".into(), "Input/output error".to_owned());
        // A failed sync: the number of frames that are not on the disk is unknown.
        status.failure = Some(RecordFailure { path, reason, missing: 0, is_over: false });
        assert!(status.is_incomplete());
        assert_eq!(status.remark_texts(), ["run.log: Input/output error"]);
    }

    #[test]
    fn it_says_what_went_wrong() {
        let mut status = RecordStatus {
            path: "run-0002.log".into(),
            format: "candump log",
            parts: 2,
            frames: 1,
            bytes: 1_240_000,
            ..RecordStatus::default()
        };
        assert_eq!(status.to_string(), "run-0002.log: 1 frame, 1.2 MB in 2 parts");
        assert!(status.remark_texts().is_empty());

        let reason = "No space left on device (os error 28)".to_owned();
        let path = "a\u{1b}[2J.log".into();
        status.failure = Some(RecordFailure { path, reason, missing: 7, is_over: false });
        (status.missing, status.too_fast, status.removed) = (9, 2, 1);
        status.leave_out(UnstoredKind::Links);
        status.leave_out(UnstoredKind::Losses);
        status.leave_out(UnstoredKind::Links);
        assert_eq!(
            status.to_string(),
            "run-0002.log: 1 frame, 1.2 MB in 2 parts, 1 removed; 9 frames missing"
        );
        let failing = "a\\u{1b}[2J.log: No space left on device (os error 28): 7 frames not written";
        let others = [
            "2 frames not written: the disk is too slow",
            "candump log cannot store: link state changes, lost frames; .pcapng stores more",
        ];
        let so_far = format!("{failing} so far; retrying");
        assert_eq!(status.remark_texts(), [&so_far, others[0], others[1]]);
        status.failure.as_mut().unwrap().is_over = true;
        let over = format!("{failing}; continuing in run-0002.log");
        assert_eq!(status.remark_texts(), [&over, others[0], others[1]]);
        status.has_ended = true;
        let over = format!("{failing}; continued in run-0002.log");
        assert_eq!(status.remark_texts(), [&over, others[0], others[1]]);
        status.failure.as_mut().unwrap().is_over = false;
        assert_eq!(status.remark_texts(), [failing, others[0], others[1]]);
        status.losses = vec!["1 a".to_owned(), "2 b".to_owned()];
        assert_eq!(status.remark_texts().last().unwrap(), "candump log cannot store: 1 a; 2 b");
    }
}
