//! Comparison of two captures by meaning: configuration, nodes, states, set points, timing, faults and load.
//!
//! ```text
//! frames, events ─Recorder─▶ notes ─finish (Bus, findings, stories)─▶ CaptureRecord ─┐
//!                                                                  CaptureRecord ─┴─compare─▶ Comparison ─▶ text, JSON
//! ```
//!
//! Captures are aligned by role and not by time. Everything that one capture never showed is `UnobservedSubject`, not a `Difference`.

mod alignment;
mod compare;
mod configuration;
mod difference;
mod faults;
mod finish;
mod following;
mod load;
mod marks;
mod nodes;
mod objects;
mod points;
mod ranking;
mod record;
mod recorder;
mod scope;
mod sequence;
mod states;
mod steps;
pub mod text;
mod times;
mod timing;
mod tolerance;

pub use compare::compare_captures;
pub use difference::{
    CaptureComparison, ComparedSide, Difference, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
    UnobservedSubject,
};
pub use finish::CaptureEnding;
pub use marks::DifferenceMarks;
pub use record::{
    BusRecord, CaptureRecord, CodeRecord, EventSequence, EvidenceMark, FindingRecord, MOST_STEPS,
    MOST_SUBJECTS, MappingRecord, MessageRecord, MessageRole, NodeBehaviour, Occurrences, ParameterRecord,
    PointRecord, RecordedCode, SequenceStep, StateRecord, StateTime, StoryRecord, WrittenValue,
};
pub use recorder::BehaviourRecorder;
