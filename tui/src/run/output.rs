//! Output files and stdout; input files are protected from being overwritten.

use std::io::{self, BufWriter, ErrorKind, IsTerminal as _, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use cobscope_decoder::sink::{EventFormat, Output, OutputFiles, SpoolFile};

use super::input::files_named;
use super::messages::{print_error, print_note};
use crate::exit_code::ExitStatus;
use crate::file_identity::StorageIdentity;
use crate::output_file::{self, ExistingFile, FinalName};
use crate::path_text::path_text;
use crate::record::format::part_of;
use crate::run::arguments::{Color, InputArgs};

/// Size of output buffers, in bytes.
const BUFFER: usize = 64 * 1024;

/// Name of stdout in errors.
const STDOUT: &str = "stdout";

/// Files that a command reads: captures, bus file, device files and databases.
pub fn files_read(input: &InputArgs) -> Vec<PathBuf> {
    // Without a file name, stdin is read.
    let stdin = input.captures.is_empty().then(|| PathBuf::from("-"));
    input.captures.iter().cloned().chain(stdin).chain(files_known(input)).collect()
}

/// Files that describe the buses: bus file, device files and databases, including those named in the bus
/// file.
pub fn files_known(input: &InputArgs) -> impl Iterator<Item = PathBuf> {
    let named = input.bus.as_deref().map(files_named).unwrap_or_default();
    let files = input.bus.iter().chain(&input.dbc);
    files.chain(input.eds.iter().map(|of_node| &of_node.file)).cloned().chain(named)
}

/// Checks that an output file is not also an input.
///
/// # Errors
/// If `path` is one of the files `read`, even under another name.
pub fn ensure_not_read<'a>(path: &Path, read: impl IntoIterator<Item = &'a PathBuf>) -> anyhow::Result<()> {
    let is_read = read.into_iter().any(|read| is_same(read, path));
    ensure!(!is_read, "{}: is also an input; choose another output file", path_text(path));
    Ok(())
}

/// Whether two paths are the same file; `-` is stdin.
fn is_same(one: &Path, other: &Path) -> bool {
    // A terminal or a pipe can be input and output.
    let is_stdin = one.as_os_str() == "-";
    let identity = if is_stdin { StorageIdentity::of_stdin() } else { StorageIdentity::of_regular(one) };
    identity.is_some() && StorageIdentity::of_regular(other) == identity
}

/// An output of a command.
pub struct CommandOutput {
    writer: Output,
    name: FinalName,
}

impl CommandOutput {
    /// Writes the last bytes; a file receives its name.
    ///
    /// # Errors
    /// If they cannot be written; the file keeps the name of a part.
    pub fn finish(mut self) -> io::Result<()> {
        self.writer.flush()?;
        drop(self.writer);
        self.name.finish_file()
    }
}

impl Write for CommandOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// Opens an output: a file not among the files `read`, else stdout. Write errors contain the file
/// name.
///
/// # Errors
/// If the file is an input, exists and is to be kept, or cannot be created.
pub fn open_output<'a>(
    path: Option<&Path>,
    naming: NamePolicy,
    read: impl IntoIterator<Item = &'a PathBuf> + Clone,
) -> anyhow::Result<CommandOutput> {
    // As everywhere, `-` is not a file.
    Ok(match path.filter(|path| path.as_os_str() != "-") {
        Some(path) => {
            ensure_not_read(path, read.clone())?;
            ensure_not_read(&output_file::part_of(path), read)?;
            let name = path_text(path);
            let NamePolicy { existing, is_at_once } = naming;
            let created = if is_at_once {
                output_file::create_at_once(path, existing).map(|file| (file, FinalName::at_once()))
            } else {
                output_file::create_output(path, existing)
            };
            let (file, final_name) = created.map_err(|error| creation_error(path, &error))?;
            let writer = Box::new(BufWriter::with_capacity(BUFFER, NamedOutput { name, output: file }));
            CommandOutput { writer, name: final_name }
        }
        // Large blocks for a pipe or a file; on a terminal each line is visible immediately.
        None if io::stdout().is_terminal() => {
            CommandOutput { writer: Box::new(open_stdout()), name: FinalName::at_once() }
        }
        None => {
            let writer = Box::new(BufWriter::with_capacity(BUFFER, open_stdout()));
            CommandOutput { writer, name: FinalName::at_once() }
        }
    })
}

/// Message for a file that cannot be created.
pub fn creation_error(path: &Path, error: &io::Error) -> anyhow::Error {
    let name = path_text(path);
    match error.kind() {
        ErrorKind::AlreadyExists => anyhow::anyhow!("{name}: file exists; use --force to overwrite it"),
        _ => match output_file::folder_problem(path) {
            Some(problem) => anyhow::anyhow!("{name}: {problem}"),
            None => anyhow::anyhow!("{name}: cannot be created: {error}"),
        },
    }
}

/// Checks that the folder of an output file exists, before the work for the file begins.
///
/// # Errors
/// If there is no such folder.
pub fn ensure_folder(path: &Path) -> anyhow::Result<()> {
    match output_file::folder_problem(path) {
        Some(problem) => bail!("{}: {problem}", path_text(path)),
        None => Ok(()),
    }
}

/// Whether to colour the output.
pub fn is_colored(color: Color, is_file: bool) -> bool {
    match color {
        Color::Always => {
            enable_colors();
            true
        }
        Color::Never => false,
        Color::Auto => {
            let wanted = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
            wanted && !is_file && io::stdout().is_terminal() && enable_colors()
        }
    }
}

/// Lets a console of Windows interpret escape sequences; whether it does.
#[cfg(windows)]
pub fn enable_colors() -> bool {
    crossterm::ansi_support::supports_ansi()
}

/// Terminals interpret escape sequences.
#[cfg(not(windows))]
pub const fn enable_colors() -> bool {
    true
}

/// Output files of an event format.
pub struct SinkFiles<'a> {
    format: &'static EventFormat,
    to: Option<&'a Path>,
    naming: NamePolicy,
    read: &'a [PathBuf],
    parts: Vec<PathBuf>,
    names: FinalNames,
}

/// When an output file receives its name, and what happens to a file with this name.
#[derive(Debug, Clone, Copy)]
pub struct NamePolicy {
    pub existing: ExistingFile,
    /// The file has its name from the start, because others read it while it grows.
    pub is_at_once: bool,
}

/// Names of the output files of one command.
#[derive(Debug, Default)]
pub struct FinalNames(Vec<FinalName>);

impl FinalNames {
    /// Gives the files their names; all of them were written.
    ///
    /// # Errors
    /// If one cannot be renamed.
    pub fn finish(self) -> io::Result<()> {
        self.0.into_iter().try_for_each(FinalName::finish_file)
    }
}

impl<'a> SinkFiles<'a> {
    /// Creates files named after `to`; none of them may be one of the files `read`.
    pub fn new(
        format: &'static EventFormat,
        to: Option<&'a Path>,
        naming: NamePolicy,
        read: &'a [PathBuf],
    ) -> Self {
        Self { format, to, naming, read, parts: Vec::new(), names: FinalNames::default() }
    }

    /// Names of the opened files.
    pub fn into_names(self) -> FinalNames {
        self.names
    }

    /// Prints the names of the files of a format with several files.
    pub fn report_parts(&self) {
        let names: Vec<_> = self.parts.iter().map(|path| path_text(path)).collect();
        if !names.is_empty() {
            print_note(&format!("writing {}", names.join(" and ")));
        }
    }

    fn open_file(&mut self, path: Option<&Path>) -> anyhow::Result<Output> {
        let CommandOutput { writer, name } = open_output(path, self.naming, self.read)?;
        self.names.0.push(name);
        Ok(writer)
    }

    fn open_whole(&mut self) -> anyhow::Result<Output> {
        ensure!(
            !self.format.is_binary || self.to.is_some() || !io::stdout().is_terminal(),
            "binary format on a terminal; give a file with -o"
        );
        self.open_file(self.to)
    }

    fn open_part(&mut self, content: &str) -> anyhow::Result<Output> {
        let to = self.to.context("format with two files; give a name with -o NAME")?;
        let path = part_of(to, content, self.format.suffix)
            .with_context(|| format!("{}: not a file name", path_text(to)))?;
        let output = self.open_file(Some(&path))?;
        self.parts.push(path);
        Ok(output)
    }
}

impl OutputFiles for SinkFiles<'_> {
    fn whole_file(&mut self) -> io::Result<Output> {
        self.open_whole().map_err(|error| in_one(&error))
    }

    fn part_file(&mut self, content: &str) -> io::Result<Output> {
        self.open_part(content).map_err(|error| in_one(&error))
    }

    fn spool_file(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        let spool =
            tempfile::tempfile().context("cannot create a temporary file").map_err(|error| in_one(&error))?;
        Ok(Box::new(spool))
    }
}

/// An I/O error that contains the message with all its context.
fn in_one(error: &anyhow::Error) -> io::Error {
    io::Error::other(format!("{error:#}"))
}

/// Writes a text to stdout; returns the exit status.
pub fn print_text(text: &[u8]) -> ExitStatus {
    let mut output = open_stdout();
    write_result(output.write_all(text).and_then(|()| output.flush()))
}

/// Reports a write error; returns the exit status. A closed pipe is not an error.
pub fn write_result(written: io::Result<()>) -> ExitStatus {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            print_error(&error.into());
            ExitStatus::Capture
        }
        _ => ExitStatus::Clean,
    }
}

fn open_stdout() -> NamedOutput<io::Stdout> {
    NamedOutput { name: STDOUT.to_owned(), output: io::stdout() }
}

/// An output that adds its name to errors.
struct NamedOutput<W> {
    name: String,
    output: W,
}

impl<W> NamedOutput<W> {
    fn write_result<T>(&self, result: io::Result<T>) -> io::Result<T> {
        result.map_err(|error| match error.kind() {
            // The caller retries.
            ErrorKind::Interrupted => error,
            kind => io::Error::new(kind, format!("{}: {error}", self.name)),
        })
    }
}

impl<W: Write> Write for NamedOutput<W> {
    #[inline]
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.output.write(bytes);
        self.write_result(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.output.flush();
        self.write_result(flushed)
    }
}
