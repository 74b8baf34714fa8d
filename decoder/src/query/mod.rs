//! Events as named fields: the one place that says which key an event has, for JSON, filters and docs.

pub mod record;
