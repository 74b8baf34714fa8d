//! zlib streams (RFC 1950) inside binary captures.

/// What became of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(feature = "gzip"), expect(dead_code, reason = "callers say so in either build"))]
pub(super) enum Inflated {
    /// It ended after so many of its bytes.
    Whole(usize),
    /// It has not ended where its bytes do.
    CutOff,
    /// Something in it is wrong: what came before may be.
    Damaged,
    /// It holds more than was allowed.
    TooLong,
    /// This build leaves out the feature `gzip`.
    #[cfg_attr(feature = "gzip", expect(dead_code, reason = "callers say so in either build"))]
    Unavailable,
}

/// Bytes of room that are added at a time.
#[cfg(feature = "gzip")]
const STEP: usize = 64 * 1024;

/// Adds what `data` holds to `bytes`, at most `limit` of them: how much it is, is found out and not believed.
#[cfg(feature = "gzip")]
pub(super) fn inflate(data: &[u8], bytes: &mut Vec<u8>, limit: usize) -> Inflated {
    let mut stream = flate2::Decompress::new(true);
    let limit = bytes.len().saturating_add(limit);
    loop {
        let (taken, given) = (stream.total_in(), stream.total_out());
        let rest = usize::try_from(taken).ok().and_then(|taken| data.get(taken..)).unwrap_or_default();
        bytes.reserve(STEP);
        let status = stream.decompress_vec(rest, bytes, flate2::FlushDecompress::None);
        if bytes.len() > limit {
            bytes.truncate(limit);
            return Inflated::TooLong;
        }
        match status {
            Ok(flate2::Status::StreamEnd) => {
                return Inflated::Whole(usize::try_from(stream.total_in()).unwrap_or(data.len()));
            }
            Err(_) => return Inflated::Damaged,
            Ok(_) if (taken, given) == (stream.total_in(), stream.total_out()) => return Inflated::CutOff,
            Ok(_) => {}
        }
    }
}

/// Adds nothing.
#[cfg(not(feature = "gzip"))]
pub(super) fn inflate(_data: &[u8], _bytes: &mut Vec<u8>, _limit: usize) -> Inflated {
    Inflated::Unavailable
}

#[cfg(feature = "gzip")]
#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn deflate(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn what_was_deflated_comes_back_behind_what_was_there() {
        let content: Vec<u8> = (0..300_000_u32).map(|n| (n / 7 % 251) as u8).collect();
        let data = deflate(&content);
        let mut bytes = b"before".to_vec();
        let with_more = [&data[..], b"behind"].concat();
        assert_eq!(inflate(&with_more, &mut bytes, 1 << 20), Inflated::Whole(data.len()));
        assert_eq!(bytes, [b"before", &content[..]].concat());
    }

    #[test]
    fn a_bomb_is_stopped() {
        let data = deflate(&vec![0; 10_000_000]);
        let mut bytes = Vec::new();
        assert_eq!(inflate(&data, &mut bytes, 1_000_000), Inflated::TooLong);
        assert_eq!(bytes.len(), 1_000_000);
    }

    #[test]
    fn what_stands_before_the_end_of_a_stream_is_given() {
        let content: Vec<u8> = (0..100_000_u32).flat_map(u32::to_le_bytes).collect();
        let mut data = deflate(&content);
        let mut bytes = Vec::new();
        assert_eq!(inflate(&data[..data.len() / 2], &mut bytes, 1 << 20), Inflated::CutOff);
        assert!(bytes.len() > 100_000 && content.starts_with(&bytes), "{}", bytes.len());
        let last = data.len() - 1;
        data[last] ^= 1;
        bytes.clear();
        assert_eq!(inflate(&data, &mut bytes, 1 << 20), Inflated::Damaged, "the checksum");
        assert_eq!(bytes.len(), content.len());
        assert_eq!(inflate(b"no stream", &mut bytes, 1 << 20), Inflated::Damaged);
        assert_eq!(inflate(b"", &mut bytes, 1 << 20), Inflated::CutOff);
    }
}
