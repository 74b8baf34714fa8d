//! Rows `[[fact]]` of `causes.toml`.

use serde::Deserialize;

use crate::event::{SdoDirection, SdoOutcome, SdoTransfer};

/// One row `[[fact]]` of `causes.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FactRow {
    /// Name for `by`.
    pub(super) name: String,
    pub(super) event: FactEvent,
    /// First step for the reader.
    #[serde(default)]
    pub(super) next: String,
    /// NMT services.
    #[serde(default)]
    pub(super) services: Vec<String>,
    /// First and last object index of writes.
    #[serde(default)]
    objects: Vec<[u16; 2]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum FactEvent {
    NmtCommand,
    Write,
    CanError,
    /// Commands on an identifier without a known consumer; computed when a finding begins.
    NoConsumer,
}

impl FactRow {
    /// Whether the row stands for commands without a consumer.
    pub(super) fn is_no_consumer(&self) -> bool {
        self.event == FactEvent::NoConsumer
    }

    /// Text of a confirmed write to one of the objects: `1005:00 COB-ID SYNC = 40000080h written`.
    pub(super) fn write_text(&self, transfer: &SdoTransfer) -> Option<String> {
        let object = transfer.object?;
        let is_write =
            transfer.direction == Some(SdoDirection::Download) && transfer.outcome == SdoOutcome::Complete;
        let is_meant = self.objects.iter().any(|[first, last]| (*first..=*last).contains(&object.index));
        let meaning = transfer.meaning.as_ref()?;
        let is_known = is_write && is_meant && !transfer.truncated && !transfer.data.is_empty();
        is_known.then(|| {
            let value = meaning.format_value(&meaning.decode(&transfer.data));
            format!("{object} {} = {value} written", meaning.name)
        })
    }
}
