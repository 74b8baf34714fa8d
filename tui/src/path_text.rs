//! Paths in messages: a file name may contain line ends and control characters.

use std::path::Path;

use cobscope_decoder::sink::escape;

/// A path as one line of text without control characters.
pub fn path_text(path: &Path) -> String {
    escape(&path.display().to_string()).into_owned()
}
