//! Events as named fields: the single definition of event keys for JSON, filters and documentation.
//!
//! ```text
//! text ─lexer─▶ tokens ─parser─▶ expression ─compile (fields, kinds, literal)─▶ Filter ─record─▶ yes or no
//! ```

mod cell_filters;
mod compile;
mod completion;
mod error;
mod expression;
pub mod fields;
mod filter;
mod lexer;
mod literal;
mod parser;
pub mod record;

pub use cell_filters::{kind_filter, subject_filter};
pub use completion::{Completion, ExpectedWord, complete_filter};
pub use error::FilterError;
pub use filter::{Filter, MAX_TESTS};
pub use parser::{MAX_DEPTH, MAX_LENGTH};
