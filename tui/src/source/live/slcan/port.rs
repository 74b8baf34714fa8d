//! A serial port with an adapter behind it. What can be written to it is a [`Command`], nothing else.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::adapter::slcan::{Command, Reader, Reply};
use serial2::SerialPort;

/// Speed of the serial line in bit/s; adapters on USB have none of their own and take any.
pub const BAUD_RATE: u32 = 115_200;

/// Longest wait for room to write: commands are short, and nothing waits for them.
const WRITING: Duration = Duration::from_millis(200);

/// Bytes taken at a time: what a terminal of Linux gives at most.
const CHUNK: usize = 4_096;

/// What came of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// Carried out.
    Done,
    /// Refused.
    Refused,
    /// Nothing within the time.
    Nothing,
}

/// An open port. When it is dropped, the channel is closed.
pub struct Port {
    serial: SerialPort,
    reader: Reader,
    buffer: Vec<u8>,
}

impl Port {
    /// Opens the port of this name.
    ///
    /// # Errors
    /// When there is none, or it is another's.
    pub fn open(device: &str) -> io::Result<Self> {
        let mut serial = SerialPort::open(device, BAUD_RATE)?;
        serial.set_write_timeout(WRITING)?;
        Ok(Self { serial, reader: Reader::default(), buffer: vec![0; CHUNK] })
    }

    /// Says something to the adapter.
    ///
    /// # Errors
    /// When the port is gone.
    pub fn say(&self, command: Command) -> io::Result<()> {
        self.serial.write_all(command.bytes())
    }

    /// Reads once what has come, waiting at most `wait` for it; whether anything came.
    ///
    /// # Errors
    /// When the port is gone.
    pub fn listen(&mut self, wait: Duration, give: impl FnMut(Reply)) -> io::Result<bool> {
        // The port knows whole milliseconds: part of one is no reason to ask again and again.
        self.serial.set_read_timeout(wait + Duration::from_micros(999))?;
        match self.serial.read(&mut self.buffer) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                self.reader.read(self.buffer.get(..count).unwrap_or_default(), give);
                Ok(true)
            }
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(false),
                _ => Err(error),
            },
        }
    }

    /// Says `command` and waits for its answer; whatever else comes meanwhile is left out.
    ///
    /// # Errors
    /// When the port is gone.
    pub fn ask(&mut self, command: Command, wait: Duration) -> io::Result<Answer> {
        self.say(command)?;
        let begin = Instant::now();
        let mut answer = Answer::Nothing;
        while answer == Answer::Nothing {
            let left = wait.saturating_sub(begin.elapsed());
            self.listen(left, |reply| match reply {
                Reply::Done if answer == Answer::Nothing => answer = Answer::Done,
                Reply::Refused if answer == Answer::Nothing => answer = Answer::Refused,
                _ => {}
            })?;
            if left.is_zero() {
                break;
            }
        }
        Ok(answer)
    }

    /// Reads until nothing has come for `pause`, at most ten times as long: what it said before is not
    /// taken for an answer to what is asked next.
    ///
    /// # Errors
    /// When the port is gone.
    pub fn settle(&mut self, pause: Duration) -> io::Result<()> {
        let begin = Instant::now();
        while begin.elapsed() < pause * 10 && self.listen(pause, |_| {})? {}
        self.reader.reset();
        Ok(())
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        // It may be gone; then there is no channel to close either.
        let _ = self.say(Command::Close);
    }
}
