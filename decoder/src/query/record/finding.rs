//! Fields of finding events.

use super::{FieldValue, Fields};
use crate::event::FindingNews;

pub(super) fn finding(news: &FindingNews, fields: &mut dyn Fields) {
    fields.field("finding", FieldValue::Unsigned(news.id));
    fields.field("rule", FieldValue::Text(&news.rule));
    fields.field("severity", FieldValue::Text(news.severity.name()));
    fields.field("text", FieldValue::Text(&news.text));
    if let Some(object) = news.object {
        fields.field("object", FieldValue::Object(object));
    }
    if let Some(pgn) = news.pgn {
        fields.field("pgn", FieldValue::Unsigned(u64::from(pgn)));
    }
    if let Some(about) = &news.about {
        fields.field("about", FieldValue::Text(about));
    }
    if let Some(cause) = news.cause {
        fields.field("cause_finding", FieldValue::Unsigned(cause));
    }
    if let Some(id) = news.member_of {
        fields.field("member_of", FieldValue::Unsigned(id));
    }
    if let Some(reason) = &news.downgraded {
        fields.field("downgraded", FieldValue::Text(reason));
    }
    fields.field("count", FieldValue::Unsigned(news.count));
    if news.is_at_end {
        fields.field("at_end", FieldValue::Bool(true));
    }
    if let Some(source) = &news.source {
        fields.field("source", FieldValue::Text(source));
    }
}
