//! Findings and verdicts, as `cobscope check -f jsonl` prints them.

pub use crate::sink::findings::records::{
    CaseTally, CheckRecord, ConformanceVerdict, FindingCounts, GroupRecord, OccurrenceRecord, ReportedPart,
    RuleVerdict, SummaryRecord, SuppressionRecord, TallyRecord, TotalRecord, WorstOccurrence,
};
