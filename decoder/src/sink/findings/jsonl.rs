//! JSON Lines: one object per finding, one per capture, and a total, with the keys of
//! `docs/check.schema.json`. Times and objects are written as in `decode -f jsonl`.

use std::io::{self, Write};

use super::format::FindingFormat;
use super::report::FindingsReport;
use crate::sink::escape_json;

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "jsonl",
    help: "One JSON object per finding and per capture, and a total (docs/check.schema.json)",
    mark: "{\"kind\":\"total\",",
    has_lines: false,
    write: |report, _, out| write_jsonl(report, out),
};

/// Writes all captures line by line, because the text of thousands of findings needs more memory than the
/// findings.
fn write_jsonl(report: &FindingsReport, out: &mut dyn Write) -> io::Result<()> {
    for record in report.records() {
        let line = serde_json::to_string(&record)?;
        out.write_all(escape_json(&line).as_bytes())?;
        out.write_all(b"\n")?;
    }
    Ok(())
}
