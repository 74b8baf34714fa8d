//! Where lines go, and what must never be written over: the files that are read.

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, IsTerminal as _, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use cobscope_decoder::sink::{EventFormat, Output, OutputFiles, SpoolFile, escape};

use super::input::files_named;
use super::messages::complain;
use crate::cli::{Color, InputArgs};
use crate::exit_code::Exit;
use crate::record::format::part_of;

/// Bytes gathered before they are written.
const BUFFER: usize = 64 * 1024;

/// What standard output is called in errors.
const STDOUT: &str = "standard output";

/// Files that a command reads as its options say: captures, and what is known of the buses.
pub(super) fn files_read(input: &InputArgs) -> Vec<PathBuf> {
    // Without any name standard input is read.
    let stdin = input.captures.is_empty().then(|| PathBuf::from("-"));
    input.captures.iter().cloned().chain(stdin).chain(files_known(input)).collect()
}

/// Those of them that say what is known of the buses, also where the bus file names them.
pub(super) fn files_known(input: &InputArgs) -> impl Iterator<Item = PathBuf> {
    let named = input.bus.as_deref().map(files_named).unwrap_or_default();
    let files = input.bus.iter().chain(&input.dbc);
    files.chain(input.eds.iter().map(|of_node| &of_node.file)).cloned().chain(named)
}

/// Refuses to write over what is read.
///
/// # Errors
/// When `path` is one of the files `read`, under whatever name.
pub(super) fn ensure_not_read<'a>(
    path: &Path,
    read: impl IntoIterator<Item = &'a PathBuf>,
) -> anyhow::Result<()> {
    let is_read = read.into_iter().any(|read| is_same(read, path));
    ensure!(!is_read, "{}: is read and would be written", escape(&path.display().to_string()));
    Ok(())
}

/// Whether both are one file, also where it has two names; `-` is standard input.
fn is_same(one: &Path, other: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let one = if one.as_os_str() == "-" { Path::new("/dev/stdin") } else { one };
        // A terminal or pipe may be both.
        let place = |path: &Path| {
            path.metadata().ok().filter(std::fs::Metadata::is_file).map(|file| (file.dev(), file.ino()))
        };
        place(one).is_some_and(|place_of_one| place(other) == Some(place_of_one))
    }
    #[cfg(not(unix))]
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

/// Where output goes: a file, which is none of those `read`, else standard output. What fails names it.
///
/// # Errors
/// When the file is read, or cannot be written.
pub(super) fn output<'a>(
    path: Option<&Path>,
    read: impl IntoIterator<Item = &'a PathBuf>,
) -> anyhow::Result<Output> {
    Ok(match path {
        Some(path) => {
            ensure_not_read(path, read)?;
            let name = path.display().to_string();
            let file = File::create(path).with_context(|| format!("{name}: cannot be written"))?;
            Box::new(BufWriter::with_capacity(BUFFER, Named { name, output: file }))
        }
        // A pipe or a file takes large pieces; on a terminal each line shows at once.
        None if io::stdout().is_terminal() => Box::new(stdout()),
        None => Box::new(BufWriter::with_capacity(BUFFER, stdout())),
    })
}

/// Whether output is coloured.
pub(super) fn is_colored(color: Color, is_file: bool) -> bool {
    match color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => {
            let wanted = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
            wanted && !is_file && io::stdout().is_terminal()
        }
    }
}

/// The files of one format of events.
pub(super) struct SinkFiles<'a> {
    format: &'static EventFormat,
    to: Option<&'a Path>,
    read: &'a [PathBuf],
    parts: Vec<PathBuf>,
}

impl<'a> SinkFiles<'a> {
    /// Files named after `to`, none of which may be one of those `read`.
    pub(super) fn new(format: &'static EventFormat, to: Option<&'a Path>, read: &'a [PathBuf]) -> Self {
        Self { format, to, read, parts: Vec::new() }
    }

    /// Names the files, where there are several.
    pub(super) fn report_parts(&self) {
        let names: Vec<_> = self.parts.iter().map(|path| path.display().to_string()).collect();
        if !names.is_empty() {
            let _ = writeln!(io::stderr(), "cobscope: writing {}", names.join(" and "));
        }
    }

    fn open_whole(&self) -> anyhow::Result<Output> {
        ensure!(
            !self.format.is_binary || self.to.is_some() || !io::stdout().is_terminal(),
            "this format is not for a terminal; give a file with -o"
        );
        output(self.to, self.read)
    }

    fn open_part(&mut self, content: &str) -> anyhow::Result<Output> {
        let to = self.to.context("this format is two files; name them with -o NAME")?;
        let path = part_of(to, content, self.format.suffix)
            .with_context(|| format!("{}: names no file", to.display()))?;
        let output = output(Some(&path), self.read)?;
        self.parts.push(path);
        Ok(output)
    }
}

impl OutputFiles for SinkFiles<'_> {
    fn whole(&mut self) -> io::Result<Output> {
        self.open_whole().map_err(|error| in_one(&error))
    }

    fn part(&mut self, content: &str) -> io::Result<Output> {
        self.open_part(content).map_err(|error| in_one(&error))
    }

    fn spool(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        let spool =
            tempfile::tempfile().context("no temporary file can be made").map_err(|error| in_one(&error))?;
        Ok(Box::new(spool))
    }
}

/// An error with all its context in one text, for an interface that knows no context.
fn in_one(error: &anyhow::Error) -> io::Error {
    io::Error::other(format!("{error:#}"))
}

/// Writes a whole text to standard output; [`Exit::Clean`], or what failing brings.
pub(super) fn print(text: &[u8]) -> Exit {
    let mut output = stdout();
    told(output.write_all(text).and_then(|()| output.flush()))
}

/// Tells what went wrong with writing. A closed pipe is no failure.
pub(super) fn told(written: io::Result<()>) -> Exit {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            complain(&error.into());
            Exit::Capture
        }
        _ => Exit::Clean,
    }
}

fn stdout() -> Named<io::Stdout> {
    Named { name: STDOUT.to_owned(), output: io::stdout() }
}

/// An output whose errors say what it is.
struct Named<W> {
    name: String,
    output: W,
}

impl<W> Named<W> {
    fn told<T>(&self, result: io::Result<T>) -> io::Result<T> {
        result.map_err(|error| match error.kind() {
            // Is tried again.
            ErrorKind::Interrupted => error,
            kind => io::Error::new(kind, format!("{}: {error}", self.name)),
        })
    }
}

impl<W: Write> Write for Named<W> {
    #[inline]
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.output.write(bytes);
        self.told(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.output.flush();
        self.told(flushed)
    }
}
