//! Index of a lake: one file per capture, with its files, verdict and stories.

use std::fs;
use std::path::Path;

use anyhow::ensure;
use cobscope_decoder::diagnosis::Diagnosis;
use cobscope_decoder::finding::Severity;
use cobscope_decoder::report::fleet::{FleetCapture, FleetStory};
use cobscope_decoder::session::Buses;
use cobscope_decoder::sink::findings::{CaptureOutcome, CaptureResult};
use cobscope_decoder::sink::lake::TABLES;
use cobscope_decoder::wire::NodeId;
use serde::{Deserialize, Serialize};

use super::input::limited;
use crate::path_text::path_text;

/// Length of a hash in file names: 128 bits.
const NAME_DIGITS: usize = 32;

/// Number of stories that the index contains per capture.
const STORIES: usize = 20;

/// Folder of the index in a lake.
pub const FOLDER: &str = "_index";

/// Folder of the wide layout in a lake.
pub const WIDE: &str = "wide";

/// A capture in the lake.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LakeEntry {
    /// Name of the capture.
    pub capture: String,
    /// Name of the machine.
    pub machine: String,
    /// Verdict and stories.
    pub summary: EntrySummary,
    /// Files, relative to the lake, with `/` between folders; those of `captures` last.
    pub files: Vec<String>,
}

/// Verdict and stories of a capture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct EntrySummary {
    frames: u64,
    verdict: CaptureOutcome,
    failure: Option<String>,
    /// Most important first.
    stories: Vec<EntryStory>,
}

/// A story of a capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct EntryStory {
    rule: String,
    node: String,
    title: String,
    severity: String,
    rank: f64,
}

impl EntrySummary {
    /// Summary of the results of a capture; `least` is the lowest severity that counts as a failure.
    pub fn summary_of(
        judged: &CaptureResult,
        diagnosis: &Diagnosis,
        buses: Buses<'_>,
        least: Option<Severity>,
    ) -> Self {
        let stories = diagnosis.stories.iter().take(STORIES).map(|story| {
            let bus = buses.iter().find(|bus| bus.index() == story.bus);
            let name = bus.zip(story.node).and_then(|(bus, node)| bus.node(node)?.name().map(str::to_owned));
            let parts = [story.node.map(NodeId::label), name];
            EntryStory {
                rule: story.rules.first().map_or_else(String::new, ToString::to_string),
                node: parts.into_iter().flatten().collect::<Vec<_>>().join(" "),
                title: story.title.clone(),
                severity: story.severity.name().to_owned(),
                rank: story.rank(),
            }
        });
        Self {
            frames: judged.frames,
            verdict: judged.overall_outcome(least),
            failure: judged.failure.clone(),
            stories: stories.collect(),
        }
    }
}

impl LakeEntry {
    /// The entry as JSON.
    pub fn entry_json(&self) -> String {
        // A structure of texts and numbers always has a text.
        serde_json::to_string(self).unwrap_or_default()
    }

    /// The entry in a file; `None` if there is none, or it is not valid for the hash.
    pub fn read_entry(path: &Path, hash: &str) -> Option<Self> {
        let entry: Self = serde_json::from_slice(&limited::read_bytes(path).ok()?).ok()?;
        entry.files.iter().all(|file| is_file_of(file, hash)).then_some(entry)
    }

    fn into_fleet(self) -> FleetCapture {
        let EntrySummary { frames, verdict, failure, stories } = self.summary;
        // The row of the capture is in the partition of its first day.
        let day =
            self.files.last().and_then(|file| file.split("/day=").nth(1)?.split('/').next()?.parse().ok());
        let stories = stories.into_iter().map(|story| FleetStory {
            rule: story.rule,
            node: story.node,
            title: story.title,
            severity: match story.severity.as_str() {
                "error" => Severity::Error,
                "warning" => Severity::Warning,
                _ => Severity::Note,
            },
            rank: story.rank,
        });
        FleetCapture {
            machine: self.machine,
            capture: self.capture,
            day,
            frames,
            verdict,
            failure,
            stories: stories.collect(),
        }
    }
}

/// Whether a path has the form of a file of this hash, so that nothing outside the lake is touched.
fn is_file_of(path: &str, hash: &str) -> bool {
    let is_plain =
        |part: &&str| !part.is_empty() && *part != "." && *part != ".." && !part.contains(['\\', ':', '\0']);
    let parts: Vec<_> = path.split('/').collect();
    let is_own = |name: &str| name.starts_with(file_stem(hash)) && name.ends_with(".parquet");
    let is_known = match parts.as_slice() {
        [table, machine, day, name] => {
            TABLES.contains(table)
                && machine.starts_with("machine=")
                && day.starts_with("day=")
                && is_own(name)
        }
        [WIDE, _, _, .., name] => is_own(name),
        _ => false,
    };
    is_known && parts.iter().all(is_plain)
}

/// Start of the names of all files of a capture.
pub fn file_stem(hash: &str) -> &str {
    hash.get(..NAME_DIGITS).unwrap_or(hash)
}

/// Captures of a lake, without the tables.
///
/// # Errors
/// The folder is not a lake.
pub fn read_all(lake: &Path) -> anyhow::Result<Vec<FleetCapture>> {
    let index = lake.join(FOLDER);
    ensure!(index.is_dir(), "{}: not a lake; cobscope lake add creates one", path_text(lake));
    let mut all = Vec::new();
    for group in fs::read_dir(&index)?.flatten() {
        for file in fs::read_dir(group.path()).into_iter().flatten().flatten() {
            let path = file.path();
            let hash = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
            if path.extension().is_some_and(|suffix| suffix == "json") {
                all.extend(LakeEntry::read_entry(&path, hash).map(LakeEntry::into_fleet));
            }
        }
    }
    Ok(all)
}
