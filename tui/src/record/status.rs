//! What came of recording so far.

use std::fmt;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::Notice;
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::plural;

use crate::figures::bytes;

/// What is known besides frames, where a format has no place for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unheld {
    /// Links that open and close.
    Links,
    /// How many frames were lost.
    Losses,
    /// What of a source could not be read.
    Unreadable,
}

impl Unheld {
    /// Which of them a notice is; none for what is of no use later.
    pub(super) fn of(notice: &Notice) -> Option<Self> {
        match notice {
            Notice::Link { .. } => Some(Self::Links),
            Notice::LostFrames { .. } => Some(Self::Losses),
            Notice::Unreadable { .. } | Notice::CutOff { .. } => Some(Self::Unreadable),
            // The next frame tells as well how long nothing came.
            Notice::Assumption(_) | Notice::Quiet(_) => None,
        }
    }

    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Links => "links up and down",
            Self::Losses => "lost frames",
            Self::Unreadable => "unreadable input",
        }
    }
}

/// That a part could not be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordFailure {
    /// The part.
    pub path: PathBuf,
    /// What the system says.
    pub reason: String,
    /// Frames that were not recorded because of it.
    pub missing: u64,
    /// Whether recording goes on, in another part.
    pub is_over: bool,
}

/// What came of recording so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordStatus {
    /// The part being written, or the last one that was.
    pub path: PathBuf,
    /// Title of its format.
    pub format: &'static str,
    /// Parts so far, with those removed.
    pub parts: u32,
    /// Parts removed because there were too many.
    pub removed: u32,
    /// Frames the system has; on the disk they are within a second.
    pub frames: u64,
    /// Bytes of all parts, with those removed.
    pub bytes: u64,
    /// What came and the format has no place for; each once.
    pub unheld: Vec<Unheld>,
    /// What frames had and the format has no place for, with how often; told at the end.
    pub losses: Vec<String>,
    /// Frames not recorded, for whatever reason.
    pub missing: u64,
    /// Those of them that came faster than they could be written.
    pub too_fast: u64,
    /// The last failure.
    pub failure: Option<RecordFailure>,
}

impl RecordStatus {
    /// What went wrong and what is left out, a sentence each.
    pub fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if let Some(failure) = &self.failure {
            let RecordFailure { path, reason, missing, is_over } = failure;
            let path = shown(path);
            remarks.push(if *is_over {
                let now = shown(&self.path);
                format!("{path}: {reason}: {} not recorded; recording goes on in {now}", frames(*missing))
            } else {
                format!("{path}: {reason}: {} not recorded so far; trying again", frames(*missing))
            });
        }
        if self.too_fast > 0 {
            let count = frames(self.too_fast);
            remarks.push(format!("{count} not recorded: they came faster than the disk took them"));
        }
        if !self.unheld.is_empty() {
            let names: Vec<_> = self.unheld.iter().map(|unheld| unheld.name()).collect();
            let (format, names) = (self.format, names.join(", "));
            remarks.push(format!("{format} has no place for: {names}; a .pcapng has more"));
        }
        if !self.losses.is_empty() {
            let (format, losses) = (self.format, self.losses.join("; "));
            remarks.push(format!("{format} has no place for all of it: {losses}"));
        }
        remarks
    }

    pub(super) fn leave_out(&mut self, unheld: Unheld) {
        if !self.unheld.contains(&unheld) {
            self.unheld.push(unheld);
        }
    }
}

/// `run-0003.log: 12345 frames, 1.2 MB in 3 parts`.
impl fmt::Display for RecordStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}, {}", shown(&self.path), frames(self.frames), bytes(self.bytes))?;
        if self.parts > 1 {
            write!(f, " in {} parts", self.parts)?;
        }
        if self.removed > 0 {
            write!(f, ", {} removed", self.removed)?;
        }
        if self.missing > 0 {
            write!(f, "; {} missing", frames(self.missing))?;
        }
        Ok(())
    }
}

fn frames(count: u64) -> String {
    plural(count, "frame")
}

fn shown(path: &Path) -> String {
    escape(&path.display().to_string()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!(status.remarks().is_empty());

        let reason = "No space left on device (os error 28)".to_owned();
        let path = "a\u{1b}[2J.log".into();
        status.failure = Some(RecordFailure { path, reason, missing: 7, is_over: false });
        (status.missing, status.too_fast, status.removed) = (9, 2, 1);
        status.leave_out(Unheld::Links);
        status.leave_out(Unheld::Losses);
        status.leave_out(Unheld::Links);
        assert_eq!(
            status.to_string(),
            "run-0002.log: 1 frame, 1.2 MB in 2 parts, 1 removed; 9 frames missing"
        );
        let failing = "a\\u{1b}[2J.log: No space left on device (os error 28): 7 frames not recorded";
        let others = [
            "2 frames not recorded: they came faster than the disk took them",
            "candump log has no place for: links up and down, lost frames; a .pcapng has more",
        ];
        let so_far = format!("{failing} so far; trying again");
        assert_eq!(status.remarks(), [&so_far, others[0], others[1]]);
        status.failure.as_mut().unwrap().is_over = true;
        let over = format!("{failing}; recording goes on in run-0002.log");
        assert_eq!(status.remarks(), [&over, others[0], others[1]]);
        status.losses = vec!["1 a".to_owned(), "2 b".to_owned()];
        assert_eq!(status.remarks().last().unwrap(), "candump log has no place for all of it: 1 a; 2 b");
    }
}
