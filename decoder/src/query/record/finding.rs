//! Fields of finding events.

use super::{FieldConsumer, FieldValue};
use crate::event::FindingNews;

pub(super) fn visit_finding(news: &FindingNews, fields: &mut dyn FieldConsumer) {
    fields.add_field("finding", FieldValue::Unsigned(news.id));
    fields.add_field("rule", FieldValue::Text(&news.rule));
    fields.add_field("severity", FieldValue::Text(news.severity.name()));
    fields.add_field("text", FieldValue::Text(&news.text));
    if let Some(object) = news.object {
        fields.add_field("object", FieldValue::Object(object));
    }
    if let Some(pgn) = news.pgn {
        fields.add_field("pgn", FieldValue::Unsigned(u64::from(pgn)));
    }
    if let Some(about) = &news.about {
        fields.add_field("about", FieldValue::Text(about));
    }
    if let Some(cause) = news.cause {
        fields.add_field("cause_finding", FieldValue::Unsigned(cause));
    }
    if let Some(id) = news.member_of {
        fields.add_field("member_of", FieldValue::Unsigned(id));
    }
    if let Some(reason) = &news.downgraded {
        fields.add_field("downgraded", FieldValue::Text(reason));
    }
    fields.add_field("count", FieldValue::Unsigned(news.count));
    if news.is_at_end {
        fields.add_field("at_end", FieldValue::Bool(true));
    }
    if let Some(source) = &news.source {
        fields.add_field("source", FieldValue::Text(source));
    }
}
