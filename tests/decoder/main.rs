//! Behaviour of the decoder on captures.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]
#![expect(clippy::disallowed_methods, reason = "tests open files")]

mod absent_nodes;
mod assumed_mapping;
mod both_sides;
mod conclusions;
mod controller;
mod corpus;
mod corpus_conformance;
mod corpus_j1939;
mod coverage;
mod cuts;
mod damaged;
mod dbc;
mod device_files;
mod device_rules;
mod devices;
mod diagnosis;
mod dialects;
mod examples;
mod expectations;
mod expected;
mod findings_explained;
mod formats_adapters;
mod formats_blf;
mod formats_candump;
mod formats_foreign;
mod formats_mcap;
mod formats_mdf4;
mod formats_pcap;
mod formats_text;
mod formats_write;
mod fuzz_replay;
#[path = "../../decoder/fuzz/src/harness/mod.rs"]
mod harness;
mod holes;
mod imported;
mod j1939;
mod j1939_nm;
mod language;
mod layouts;
mod layouts_random;
mod limits;
#[allow(dead_code, reason = "a part of the generator")]
#[path = "../../decoder/benches/machine/mod.rs"]
mod machine;
mod malformed;
mod missing_frames;
mod mutations;
mod mutator;
mod nmea2000;
mod order_of_frames;
mod pieces;
mod profiles;
mod properties;
mod random_changes;
mod replay;
mod rule_grammars;
mod rule_texts;
mod rules;
mod same_events;
mod same_information;
mod scene;
mod schema;
mod sdo_dialogues;
mod sdo_gaps;
mod sdo_in_flight;
mod short_path;
mod standard_tables;
mod statements;
mod stories;
#[path = "../support/mod.rs"]
mod support;
mod tidy;
mod times;
mod uds;
mod variations;
