//! Differences between two captures, in order of importance.

use std::collections::{BTreeMap, BTreeSet};

use strum::{IntoStaticStr, VariantArray};

use super::ranking::load_ranking;
use super::record::EvidenceMark;

/// Section of the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[non_exhaustive]
pub enum DifferenceSection {
    /// Steps after an event.
    Sequence,
    /// Findings and codes.
    Faults,
    /// Parameters and mappings.
    Configuration,
    /// Nodes, identities, boot-ups and losses.
    Nodes,
    /// States of NMT and of devices.
    States,
    /// Set points and their effect.
    SetPoints,
    /// Periods, gaps and latencies.
    Timing,
    /// Bus load and error frames.
    Load,
}

impl DifferenceSection {
    /// All sections.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Name in JSON and in `--only`.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Kind of a difference; its weight is in `ranking.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the names are explained in docs/diff.schema.json")]
pub enum DifferenceKind {
    Sequence,
    Machine,
    NodeMissing,
    NewNode,
    NodeId,
    Identity,
    Device,
    Parameter,
    ParameterLost,
    Mapping,
    Write,
    WriteInOperation,
    BootUps,
    Lost,
    HeartbeatSilent,
    MessageSilent,
    MessageMissing,
    NewMessage,
    Emcy,
    TroubleCode,
    Abort,
    NoResponse,
    UdsResponse,
    Finding,
    FaultState,
    State,
    Effect,
    SetPoint,
    Following,
    Period,
    LongestGap,
    Jitter,
    Latency,
    Reaction,
    FindingRate,
    Load,
    ErrorFrames,
    StoryEnded,
    FindingEnded,
    CodeEnded,
}

impl DifferenceKind {
    /// All kinds.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Name in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// One of the two captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ComparedSide {
    /// The first capture.
    Good,
    /// The second capture.
    Bad,
}

/// Value in one capture, with its evidence.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Observation {
    /// Value as text.
    pub text: String,
    /// Frame and time; frame 0 for a value without a frame.
    pub mark: EvidenceMark,
}

impl Observation {
    /// A value with its evidence.
    pub fn new(text: impl Into<String>, mark: EvidenceMark) -> Self {
        Self { text: text.into(), mark }
    }
}

/// A difference between the captures.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Difference {
    /// Section.
    pub section: DifferenceSection,
    /// Kind.
    pub kind: DifferenceKind,
    /// Bus, node or identifier.
    pub subject: String,
    /// Object, message, state or code.
    pub aspect: String,
    /// Value in the first capture; `None` if it has none.
    pub good: Option<Observation>,
    /// Value in the second capture; `None` if it has none.
    pub bad: Option<Observation>,
    /// Further facts; empty for none.
    pub note: String,
    /// Importance.
    pub weight: f64,
}

impl Difference {
    /// A difference with the weight of its kind, without a note.
    pub fn new(
        (section, kind): (DifferenceSection, DifferenceKind),
        (subject, aspect): (impl Into<String>, impl Into<String>),
        (good, bad): (Option<Observation>, Option<Observation>),
    ) -> Self {
        let weight = load_ranking().difference_weight(kind.name());
        let (subject, aspect) = (subject.into(), aspect.into());
        Self { section, kind, subject, aspect, good, bad, note: String::new(), weight }
    }
}

/// Noun of a subject, for counts; in the order in which counts are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr)]
#[non_exhaustive]
pub enum SubjectNoun {
    /// Contents of a PDO.
    #[strum(serialize = "PDO mapping")]
    PdoMapping,
    /// Period of a PDO.
    #[strum(serialize = "PDO period")]
    PdoPeriod,
    /// Boot-up of a node.
    #[strum(serialize = "boot-up")]
    BootUp,
    /// Bus.
    #[strum(serialize = "bus")]
    Bus,
    /// Load of a bus.
    #[strum(serialize = "bus load")]
    BusLoad,
    /// Error or trouble code.
    #[strum(serialize = "code")]
    Code,
    /// Error frames of a bus.
    #[strum(serialize = "error frame")]
    ErrorFrame,
    /// Their rate.
    #[strum(serialize = "error frame rate")]
    ErrorFrameRate,
    /// Finding or story.
    #[strum(serialize = "finding")]
    Finding,
    /// CAN identifier without a name.
    #[strum(serialize = "identifier")]
    Identifier,
    /// Number that identifies a device.
    #[strum(serialize = "identity value")]
    IdentityValue,
    /// Node.
    #[strum(serialize = "node")]
    Node,
    /// Value of an object.
    #[strum(serialize = "object")]
    Object,
    /// Period of another message.
    #[strum(serialize = "period")]
    Period,
    /// Response time of a node.
    #[strum(serialize = "response time")]
    ResponseTime,
    /// Set point.
    #[strum(serialize = "set point")]
    SetPoint,
    /// State machine of a node or device.
    #[strum(serialize = "state machine")]
    StateMachine,
    /// Step after an event.
    #[strum(serialize = "step")]
    Step,
}

impl SubjectNoun {
    /// Name in the singular.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Something that one capture never showed.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct UnobservedSubject {
    /// Section.
    pub section: DifferenceSection,
    /// Capture that did not show it.
    pub by: ComparedSide,
    /// Noun for the count.
    pub noun: SubjectNoun,
    /// Bus, node or identifier.
    pub subject: String,
    /// Object, message, state or code, with its value in the other capture.
    pub aspect: String,
    /// Evidence in the other capture.
    pub mark: EvidenceMark,
    /// Importance; 0 for a subject that is only counted.
    pub weight: f64,
}

/// Result of a comparison.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct CaptureComparison {
    /// Differences, most important first.
    pub differences: Vec<Difference>,
    /// What one capture never showed.
    pub not_seen: Vec<UnobservedSubject>,
    /// Number of equal subjects by section and noun.
    pub equal: BTreeMap<(DifferenceSection, SubjectNoun), u64>,
    /// Reasons why something was not compared, by section.
    pub limits: Vec<(DifferenceSection, String)>,
    /// Ids of findings of the second capture that the first one does not have.
    pub(super) new_findings: BTreeSet<u64>,
}

impl CaptureComparison {
    /// Whether subjects were compared, and no difference was found.
    pub fn is_equal(&self) -> bool {
        self.differences.is_empty() && !self.is_void()
    }

    /// Whether nothing was compared, for the reasons in `limits`.
    pub fn is_void(&self) -> bool {
        self.differences.is_empty() && self.equal.is_empty() && !self.limits.is_empty()
    }

    /// Keeps these sections only.
    pub fn keep_sections(&mut self, sections: &[DifferenceSection]) {
        self.differences.retain(|it| sections.contains(&it.section));
        self.not_seen.retain(|it| sections.contains(&it.section));
        self.equal.retain(|(section, _), _| sections.contains(section));
        self.limits.retain(|(section, _)| sections.contains(section));
    }

    /// Counts an equal subject.
    pub(super) fn add_equal(&mut self, section: DifferenceSection, noun: SubjectNoun) {
        *self.equal.entry((section, noun)).or_default() += 1;
    }

    /// Adds a difference with the weight of its kind.
    pub(super) fn add_difference(
        &mut self,
        place: (DifferenceSection, DifferenceKind),
        subject: (impl Into<String>, impl Into<String>),
        values: (Option<Observation>, Option<Observation>),
        note: impl Into<String>,
    ) {
        self.differences.push(Difference { note: note.into(), ..Difference::new(place, subject, values) });
    }

    /// Adds something that one capture never showed.
    pub(super) fn add_not_seen(
        &mut self,
        (section, noun): (DifferenceSection, SubjectNoun),
        by: ComparedSide,
        (subject, aspect): (impl Into<String>, impl Into<String>),
        mark: EvidenceMark,
    ) {
        let (subject, aspect) = (subject.into(), aspect.into());
        self.not_seen.push(UnobservedSubject { section, by, noun, subject, aspect, mark, weight: 0.0 });
    }

    /// Sets the weight of the subject that was added last, so that it is printed among the differences.
    pub(super) fn raise_not_seen(&mut self, weight: f64) {
        if let Some(last) = self.not_seen.last_mut() {
            last.weight = weight;
        }
    }

    /// Sorts the differences by importance.
    pub(super) fn sort_by_weight(&mut self) {
        let order = |it: &Difference| {
            let mark = it.bad.as_ref().or(it.good.as_ref()).map_or(0, |value| value.mark.frame);
            (it.section, mark)
        };
        self.not_seen.sort_by(|one, other| other.weight.total_cmp(&one.weight));
        self.differences.sort_by(|one, other| {
            other.weight.total_cmp(&one.weight).then_with(|| order(one).cmp(&order(other)))
        });
    }
}
