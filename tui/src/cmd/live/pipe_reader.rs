//! Whether the program at the other end of a pipe is still there.

/// The reader of a pipe. A write would notice that it is gone, but a silent bus has nothing to write.
pub(super) struct PipeReader {
    #[cfg(unix)]
    pipe: Option<std::os::fd::OwnedFd>,
}

#[cfg(unix)]
impl PipeReader {
    /// The reader of an output.
    pub(super) fn of(output: &impl std::os::fd::AsFd) -> Self {
        Self { pipe: output.as_fd().try_clone_to_owned().ok() }
    }

    /// Whether all readers have closed the pipe; never for other outputs.
    pub(super) fn is_gone(&self) -> bool {
        use rustix::event::{PollFd, PollFlags, poll};
        let Some(pipe) = &self.pipe else { return false };
        // POLLERR is reported without being asked for.
        let mut watched = [PollFd::new(pipe, PollFlags::empty())];
        let now = rustix::event::Timespec { tv_sec: 0, tv_nsec: 0 };
        poll(&mut watched, Some(&now)).is_ok()
            && watched.iter().any(|watched| watched.revents().contains(PollFlags::ERR))
    }
}

/// On Windows only a write shows it.
#[cfg(not(unix))]
impl PipeReader {
    /// The reader of an output.
    pub(super) fn of<Output>(_output: &Output) -> Self {
        Self {}
    }

    /// Always `false`.
    pub(super) fn is_gone(&self) -> bool {
        false
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_reader_is_gone_when_it_closes_the_pipe() {
        let (reader, writer) = std::io::pipe().unwrap();
        let other = PipeReader::of(&writer);
        assert!(!other.is_gone());
        drop(reader);
        assert!(other.is_gone());
    }

    #[test]
    fn a_file_is_never_gone() {
        let file = tempfile::tempfile().unwrap();
        assert!(!PipeReader::of(&file).is_gone());
    }
}
