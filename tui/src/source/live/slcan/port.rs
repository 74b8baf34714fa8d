//! A serial port with an adapter. Only a [`Command`] can be written to it.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::adapter::slcan::{Command, Reader, Reply};
use serial2::SerialPort;

/// Bit rate of the serial line in bit/s; USB adapters ignore it.
pub const BAUD_RATE: u32 = 115_200;

/// Maximum time to write a command; commands are short.
const WRITING: Duration = Duration::from_millis(200);

/// Number of bytes per read, the maximum of a Linux terminal.
const CHUNK: usize = 4_096;

/// Result of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// Executed.
    Done,
    /// Refused.
    Refused,
    /// No response within the time limit.
    Nothing,
}

/// An open port. Dropping it closes the channel.
pub struct Port {
    serial: SerialPort,
    reader: Reader,
    buffer: Vec<u8>,
}

impl Port {
    /// Opens the port `device`.
    ///
    /// # Errors
    /// Port missing or in use.
    pub fn open(device: &str) -> io::Result<Self> {
        let mut serial = SerialPort::open(device, BAUD_RATE)?;
        serial.set_write_timeout(WRITING)?;
        Ok(Self { serial, reader: Reader::default(), buffer: vec![0; CHUNK] })
    }

    /// Sends a command.
    ///
    /// # Errors
    /// The port is gone.
    pub fn send(&self, command: Command) -> io::Result<()> {
        self.serial.write_all(command.bytes())
    }

    /// Reads once, waiting at most `wait`; returns whether anything arrived.
    ///
    /// # Errors
    /// The port is gone.
    pub fn listen(&mut self, wait: Duration, give: impl FnMut(Reply)) -> io::Result<bool> {
        // The port rounds to milliseconds: without rounding up, short waits would become a busy loop.
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

    /// Sends `command` and waits for its response; other replies in the meantime are dropped.
    ///
    /// # Errors
    /// The port is gone.
    pub fn ask(&mut self, command: Command, wait: Duration) -> io::Result<Answer> {
        self.send(command)?;
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

    /// Reads until nothing arrives for `pause`, at most ten times as long, so that old replies are not
    /// mistaken for the response to the next command.
    ///
    /// # Errors
    /// The port is gone.
    pub fn settle(&mut self, pause: Duration) -> io::Result<()> {
        let begin = Instant::now();
        while begin.elapsed() < pause * 10 && self.listen(pause, |_| {})? {}
        self.reader.reset();
        Ok(())
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        // A port that is gone has no channel to close.
        let _ = self.send(Command::Close);
    }
}
