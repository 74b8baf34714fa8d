//! A serial port with an adapter. Only a [`SlcanCommand`] can be written to it.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::adapter::slcan::{SlcanCommand, SlcanReader, SlcanReply};
use serial2::SerialPort;

/// Bit rate of the serial line in bit/s; USB adapters ignore it.
pub const BAUD_RATE: u32 = 115_200;

/// Maximum time to write a command; commands are short.
const WRITING: Duration = Duration::from_millis(200);

/// Number of bytes per read, the maximum of a Linux terminal.
const CHUNK: usize = 4_096;

/// Result of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandResult {
    /// Executed.
    Done,
    /// Refused.
    Refused,
    /// No response within the time limit.
    Nothing,
}

/// An open port. Dropping it closes the channel.
pub struct OpenPort {
    serial: SerialPort,
    reader: SlcanReader,
    buffer: Vec<u8>,
}

impl OpenPort {
    /// Opens the port `device`.
    ///
    /// # Errors
    /// Port missing or in use.
    pub fn open(device: &str) -> io::Result<Self> {
        let mut serial = SerialPort::open(device, BAUD_RATE)?;
        serial.set_write_timeout(WRITING)?;
        Ok(Self { serial, reader: SlcanReader::default(), buffer: vec![0; CHUNK] })
    }

    /// Sends a command.
    ///
    /// # Errors
    /// The port is gone.
    pub fn send_command(&self, command: SlcanCommand) -> io::Result<()> {
        self.serial.write_all(command.bytes())
    }

    /// Reads once, waiting at most `wait`; returns whether anything arrived.
    ///
    /// # Errors
    /// The port is gone.
    pub fn read_replies(&mut self, wait: Duration, give: impl FnMut(SlcanReply)) -> io::Result<bool> {
        // The port rounds to milliseconds: without rounding up, short waits would become a busy loop.
        self.serial.set_read_timeout(wait + Duration::from_micros(999))?;
        match self.serial.read(&mut self.buffer) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                self.reader.read_input(self.buffer.get(..count).unwrap_or_default(), give);
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
    pub fn ask_command(&mut self, command: SlcanCommand, wait: Duration) -> io::Result<CommandResult> {
        self.send_command(command)?;
        let begin = Instant::now();
        let mut answer = CommandResult::Nothing;
        while answer == CommandResult::Nothing {
            let left = wait.saturating_sub(begin.elapsed());
            self.read_replies(left, |reply| match reply {
                SlcanReply::Done if answer == CommandResult::Nothing => answer = CommandResult::Done,
                SlcanReply::Refused if answer == CommandResult::Nothing => answer = CommandResult::Refused,
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
    pub fn settle_input(&mut self, pause: Duration) -> io::Result<()> {
        let begin = Instant::now();
        while begin.elapsed() < pause * 10 && self.read_replies(pause, |_| {})? {}
        self.reader.reset();
        Ok(())
    }
}

impl Drop for OpenPort {
    fn drop(&mut self) {
        // A port that is gone has no channel to close.
        let _ = self.send_command(SlcanCommand::Close);
    }
}
