//! Adapters and servers: the result must not depend on the sizes of the pieces received, must contain only
//! valid frames, and must contain no terminal control characters.

use cobscope_decoder::capture::adapter::{slcan as serial, socketcand as server};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length};

use super::reader::Random;

/// Reads `data` at once and in pieces with `read`, which returns the result of all pieces.
fn in_pieces<T: PartialEq + std::fmt::Debug>(data: &[u8], read: impl Fn(&[&[u8]]) -> Vec<T>) -> Vec<T> {
    let whole = read(&[data]);
    let mut random = Random::new(data);
    let mut pieces = Vec::new();
    let mut rest = data;
    while !rest.is_empty() {
        let (piece, behind) = rest.split_at(random.up_to(97).min(rest.len()));
        pieces.push(piece);
        rest = behind;
    }
    assert_eq!(whole, read(&pieces), "in one piece and in several");
    whole
}

fn is_possible(frame: &Frame) {
    let flags = frame.flags;
    assert_eq!((frame.number, frame.bus.0), (0, 0));
    assert!(usize::from(frame.length) <= MAX_DATA && (frame.length <= 8 || flags.contains(FrameFlags::FD)));
    assert!((0..=15).any(|dlc| fd_length(dlc) == frame.length) || frame.length <= 8);
    assert!(frame.raw_dlc == 0 || (9..=15).contains(&frame.raw_dlc) && frame.length == 8, "{frame:?}");
    assert!(!(flags.contains(FrameFlags::FD) && flags.contains(FrameFlags::REMOTE)));
    match frame.id {
        CanId::Standard(id) => assert!(id <= 0x7FF),
        CanId::Extended(id) => assert!(id <= 0x1FFF_FFFF),
    }
}

fn is_printable(text: &str) {
    assert!(text.chars().all(|letter| !letter.is_control()), "{text:?}");
    // An excerpt has at most 60 bytes, each escaped in at most four characters.
    assert!(text.len() < 512 * 4 + 256, "{} bytes", text.len());
}

/// Fuzzes the output of an slcan adapter.
pub fn slcan(data: &[u8]) {
    let replies = in_pieces(data, |pieces| {
        let (mut reader, mut replies) = (serial::SlcanReader::default(), Vec::new());
        for piece in pieces {
            reader.read_input(piece, |reply| replies.push(reply));
        }
        replies
    });
    let ends = data.iter().filter(|byte| matches!(byte, b'\r' | 0x07)).count();
    assert!(replies.len() <= 2 * ends, "{} replies of {ends} lines", replies.len());
    for reply in &replies {
        match reply {
            serial::SlcanReply::Frame(frame, _) => {
                assert_eq!(frame.time, None);
                is_possible(frame);
            }
            serial::SlcanReply::Unreadable(reason) => is_printable(reason),
            serial::SlcanReply::Flags(flags) => is_printable(&flags.to_string()),
            serial::SlcanReply::State(state) => {
                assert!(state.receive_errors.max(state.transmit_errors) < 1_000);
            }
            serial::SlcanReply::Done | serial::SlcanReply::Refused => {}
        }
    }
}

/// Fuzzes the output of a socketcand server.
pub fn socketcand(data: &[u8]) {
    let replies = in_pieces(data, |pieces| {
        let (mut reader, mut replies) = (server::SocketcandReader::default(), Vec::new());
        for piece in pieces {
            reader.read_input(piece, |reply| replies.push(reply));
        }
        replies
    });
    let brackets = data.iter().filter(|byte| matches!(byte, b'<' | b'>')).count();
    assert!(replies.len() <= brackets, "{} replies of {brackets} brackets", replies.len());
    for reply in &replies {
        match reply {
            server::SocketcandReply::Frame(frame) => {
                assert!(frame.time.is_some());
                is_possible(frame);
            }
            server::SocketcandReply::Error(text) | server::SocketcandReply::Unreadable(text) => {
                is_printable(text);
            }
            server::SocketcandReply::Hi | server::SocketcandReply::Ok | server::SocketcandReply::Echo => {}
        }
    }
    // A bus may have any name that can be typed; the request must still be a single element.
    if let Ok(name) = std::str::from_utf8(data)
        && let Some(bus) = server::BusName::new(name)
    {
        let text = server::SocketcandRequest::Open(bus).to_text();
        assert_eq!(text, format!("< open {name} >"));
        assert!(text.matches(['<', '>']).count() == 2 && text.split(' ').count() == 4);
    }
}
