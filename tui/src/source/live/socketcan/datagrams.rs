//! Reads a socket in batches: frames with timestamps, direction and losses.
//!
//! A wake-up costs a thousand times as much as decoding a frame. Frames therefore stay in the buffer of the
//! socket for some milliseconds and are then read together; the kernel has already added their timestamps.

use std::io::IoSliceMut;
use std::os::fd::RawFd;
use std::time::{SystemTime, UNIX_EPOCH};

use cobscope_decoder::frame::Timestamp;
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, MultiHeaders, RecvMsg, Timestamps, recvmmsg};
use nix::sys::time::TimeSpec;

/// Number of frames per call.
const BATCH: usize = 64;

/// Size of `struct canfd_frame`.
const LARGEST: usize = 72;

/// Flag of frames sent by a program of this computer (MSG_DONTROUTE, linux/can/raw.h); nix has no name for
/// it.
const OWN: MsgFlags = MsgFlags::from_bits_retain(0x04);

/// Maximum drift between hardware and kernel timestamps before the hardware clock is adjusted, in ns.
const DRIFT: i64 = 20_000_000;

/// A frame as read from the socket.
pub(super) struct Datagram<'a> {
    /// `struct can_frame` or `struct canfd_frame`.
    pub(super) bytes: &'a [u8],
    /// Time of reception, in ns since 1970.
    pub(super) time: Timestamp,
    /// Sent by a program on this computer.
    pub(super) is_own: bool,
    /// Number of frames lost before it.
    pub(super) lost: u32,
}

/// State between two reads of a socket.
#[derive(Default)]
pub(super) struct DatagramState {
    /// Number of frames lost since the socket was opened (SO_RXQ_OVFL, a wrapping counter).
    lost: u32,
    /// Kernel time minus hardware time; None before the first hardware timestamp.
    hardware: Option<i64>,
}

impl DatagramState {
    /// Whether the timestamps are those of the hardware.
    pub(super) fn has_hardware_stamps(&self) -> bool {
        self.hardware.is_some()
    }

    /// Reads the buffer of the socket, at most `most` frames.
    ///
    /// # Errors
    /// Error of the kernel; frames read before it are delivered.
    pub(super) fn read(
        &mut self,
        socket: RawFd,
        most: usize,
        mut see: impl FnMut(Datagram<'_>),
    ) -> nix::Result<()> {
        let mut buffers = [[0u8; LARGEST]; BATCH];
        let mut left = most;
        while left > 0 {
            // The headers are rebuilt for each call, because the kernel shortens their space for control
            // messages.
            let space = cmsg_space!(Timestamps, u32);
            let mut headers = MultiHeaders::<()>::preallocate(BATCH, Some(space));
            let mut slices: Vec<[IoSliceMut<'_>; 1]> =
                buffers.iter_mut().map(|buffer| [IoSliceMut::new(buffer)]).collect();
            let read = match recvmmsg(socket, &mut headers, &mut slices, MsgFlags::MSG_DONTWAIT, None) {
                Ok(read) => read,
                Err(Errno::EAGAIN | Errno::EINTR) => return Ok(()),
                Err(error) => return Err(error),
            };
            let mut count = 0;
            for message in read {
                count += 1;
                let (time, lost) = self.read_controls(&message);
                let is_own = message.flags.contains(OWN);
                let bytes = message.iovs().next().unwrap_or_default();
                see(Datagram { bytes, time, is_own, lost });
            }
            if count < BATCH {
                return Ok(());
            }
            left = left.saturating_sub(count);
        }
        Ok(())
    }

    /// Time of a message, and number of frames lost before it.
    fn read_controls(&mut self, message: &RecvMsg<'_, '_, ()>) -> (Timestamp, u32) {
        let (mut stamps, mut lost) = (None, self.lost);
        for control in message.cmsgs().into_iter().flatten() {
            match control {
                ControlMessageOwned::ScmTimestampsns(found) => stamps = Some(found),
                ControlMessageOwned::RxqOvfl(count) => lost = count,
                _ => {}
            }
        }
        let newly = lost.wrapping_sub(std::mem::replace(&mut self.lost, lost));
        let time = stamps.map_or_else(now, |Timestamps { system, hw_raw, .. }| {
            self.hardware_time(to_nanoseconds(system).unwrap_or_else(now), to_nanoseconds(hw_raw))
        });
        (time, newly)
    }

    /// The hardware timestamp on the clock of this computer, else the kernel timestamp. The kernel timestamp
    /// is never earlier, so the smallest difference is the best estimate.
    fn hardware_time(&mut self, kernel: Timestamp, hardware: Option<Timestamp>) -> Timestamp {
        let Some(hardware) = hardware else { return kernel };
        let difference = kernel.since(hardware);
        let known = self.hardware.filter(|known| (0..DRIFT).contains(&difference.saturating_sub(*known)));
        let offset = *self.hardware.insert(known.unwrap_or(difference));
        hardware.plus(offset)
    }
}

/// Converts a kernel timestamp; all zeros mean none.
fn to_nanoseconds(stamp: TimeSpec) -> Option<Timestamp> {
    let time = stamp.tv_sec().saturating_mul(1_000_000_000).saturating_add(stamp.tv_nsec());
    (time != 0).then_some(Timestamp(time))
}

/// The clock of this computer.
pub(super) fn now() -> Timestamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::os::fd::AsRawFd as _;

    use nix::sys::socket::{setsockopt, sockopt};

    use super::*;

    #[test]
    fn hardware_stamps_are_put_on_this_computers_clock() {
        let mut datagrams = DatagramState::default();
        let mut time = |kernel, hardware: Option<i64>| {
            datagrams.hardware_time(Timestamp(kernel), hardware.map(Timestamp)).0
        };
        assert_eq!(time(1_000, None), 1_000);
        // The hardware clock is 900 ns slow, and the kernel timestamp was 50 ns late.
        assert_eq!(time(1_000, Some(100)), 1_000);
        assert_eq!(time(1_550, Some(700)), 1_550, "the kernel was less late: nearer to the truth");
        assert_eq!(time(9_000, Some(1_000)), 1_850, "and now later");
        assert_eq!(time(90_000_000, Some(2_000)), 90_000_000, "clocks too far apart begin anew");
    }

    /// Datagrams replace frames: this kernel may have no CAN.
    #[test]
    fn what_a_small_buffer_loses_is_counted_exactly() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        setsockopt(&receiver, sockopt::RxqOvfl, &1).unwrap();
        setsockopt(&receiver, sockopt::RcvBuf, &4096).unwrap();
        setsockopt(&receiver, sockopt::ReceiveTimestampns, &true).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(receiver.local_addr().unwrap()).unwrap();
        let (mut datagrams, mut seen, mut lost) = (DatagramState::default(), Vec::new(), 0);
        for number in 0..200u32 {
            sender.send(&[&number.to_ne_bytes()[..], &[0; 12]].concat()).unwrap();
        }
        let mut read = |seen: &mut Vec<u32>, lost: &mut u32| {
            datagrams
                .read(receiver.as_raw_fd(), usize::MAX, |datagram| {
                    seen.push(u32::from_ne_bytes(*datagram.bytes.first_chunk().unwrap()));
                    *lost += datagram.lost;
                })
                .unwrap();
        };
        read(&mut seen, &mut lost);
        assert!(seen.len() < 200 && lost == 0, "the kernel tells with the next frame: {lost}");
        sender.send(&[&200u32.to_ne_bytes()[..], &[0; 12]].concat()).unwrap();
        read(&mut seen, &mut lost);
        assert_eq!(seen.last(), Some(&200));
        assert_eq!(seen.len() + lost as usize, 201);
    }
}
