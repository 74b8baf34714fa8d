//! zlib streams (RFC 1950), zstd frames (RFC 8878) and LZ4 frames inside binary captures.

#[cfg(any(feature = "zstd", feature = "mcap", feature = "rust-codecs"))]
use std::io::Read;

/// Outcome of decompressing a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(dead_code, reason = "callers match on it in any build")]
pub(super) enum Decompression {
    /// Complete; number of compressed bytes used.
    Whole(usize),
    /// The data ends before the stream does.
    CutOff,
    /// The stream is corrupt; the output before the error may be wrong.
    Damaged,
    /// The content exceeds the limit.
    TooLong,
    /// This build lacks the feature.
    Unavailable,
}

/// Compression of data inside a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    Zlib,
    Zstd,
    Lz4,
}

impl Codec {
    /// Feature of this library that contains the decompressor.
    pub(super) const fn required_feature(self) -> &'static str {
        match self {
            Self::Zlib => "gzip",
            Self::Zstd => "zstd",
            Self::Lz4 => "mcap",
        }
    }

    /// Appends the decompressed content of `data` to `bytes`, at most `limit` bytes.
    pub(super) fn decompress(self, data: &[u8], bytes: &mut Vec<u8>, limit: usize) -> Decompression {
        match self {
            Self::Zlib => inflate(data, bytes, limit),
            #[cfg(feature = "zstd")]
            Self::Zstd => {
                read_decompressed(zstd::stream::read::Decoder::with_buffer(data), data, bytes, limit)
            }
            #[cfg(feature = "mcap")]
            Self::Lz4 => read_decompressed(lz4::Decoder::new(data), data, bytes, limit),
            #[cfg(all(feature = "rust-codecs", not(feature = "zstd")))]
            Self::Zstd => {
                read_decompressed(Ok(super::rust_codecs::ZstdFrames::new(data)), data, bytes, limit)
            }
            #[cfg(all(feature = "rust-codecs", not(feature = "mcap")))]
            Self::Lz4 => read_decompressed(Ok(super::rust_codecs::Lz4Frames::new(data)), data, bytes, limit),
            #[cfg(not(all(
                any(feature = "zstd", feature = "rust-codecs"),
                any(feature = "mcap", feature = "rust-codecs")
            )))]
            _ => Decompression::Unavailable,
        }
    }
}

/// Reads a decompressor; its output grows with the data, not with the declared size.
#[cfg(any(feature = "zstd", feature = "mcap", feature = "rust-codecs"))]
fn read_decompressed(
    source: std::io::Result<impl Read>,
    data: &[u8],
    bytes: &mut Vec<u8>,
    limit: usize,
) -> Decompression {
    let Ok(source) = source else { return Decompression::Damaged };
    let end = bytes.len().saturating_add(limit);
    let outcome = source.take((limit as u64).saturating_add(1)).read_to_end(bytes);
    if bytes.len() > end {
        bytes.truncate(end);
        return Decompression::TooLong;
    }
    match outcome {
        Ok(_) => Decompression::Whole(data.len()),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Decompression::CutOff,
        Err(_) => Decompression::Damaged,
    }
}

/// Growth step of the output buffer in bytes.
#[cfg(feature = "gzip")]
const STEP: usize = 64 * 1024;

/// Appends the decompressed content of `data` to `bytes`, at most `limit` bytes. Sizes that a capture
/// declares are not trusted.
#[cfg(feature = "gzip")]
pub(super) fn inflate(data: &[u8], bytes: &mut Vec<u8>, limit: usize) -> Decompression {
    let mut stream = flate2::Decompress::new(true);
    let limit = bytes.len().saturating_add(limit);
    loop {
        let (taken, given) = (stream.total_in(), stream.total_out());
        let rest = usize::try_from(taken).ok().and_then(|taken| data.get(taken..)).unwrap_or_default();
        bytes.reserve(STEP);
        let status = stream.decompress_vec(rest, bytes, flate2::FlushDecompress::None);
        if bytes.len() > limit {
            bytes.truncate(limit);
            return Decompression::TooLong;
        }
        match status {
            Ok(flate2::Status::StreamEnd) => {
                return Decompression::Whole(usize::try_from(stream.total_in()).unwrap_or(data.len()));
            }
            Err(_) => return Decompression::Damaged,
            Ok(_) if (taken, given) == (stream.total_in(), stream.total_out()) => {
                return Decompression::CutOff;
            }
            Ok(_) => {}
        }
    }
}

/// Appends nothing.
#[cfg(not(feature = "gzip"))]
pub(super) fn inflate(_data: &[u8], _bytes: &mut Vec<u8>, _limit: usize) -> Decompression {
    Decompression::Unavailable
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
        assert_eq!(inflate(&with_more, &mut bytes, 1 << 20), Decompression::Whole(data.len()));
        assert_eq!(bytes, [b"before", &content[..]].concat());
    }

    #[cfg(feature = "mcap")]
    #[test]
    fn zstd_and_lz4_give_what_was_packed_and_no_more_than_the_limit() {
        let content: Vec<u8> =
            (0..300_000_u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
        encoder.write_all(&content).unwrap();
        let (lz4, outcome) = encoder.finish();
        outcome.unwrap();
        for (codec, data) in
            [(Codec::Zstd, zstd::stream::encode_all(&content[..], 1).unwrap()), (Codec::Lz4, lz4)]
        {
            let mut bytes = Vec::new();
            let whole = codec.decompress(&data, &mut bytes, content.len());
            assert_eq!((whole, bytes == content), (Decompression::Whole(data.len()), true), "{codec:?}");
            bytes.clear();
            assert_eq!(codec.decompress(&data, &mut bytes, 1_000), Decompression::TooLong, "{codec:?}");
            assert_eq!(bytes, content[..1_000], "{codec:?}");
            bytes.clear();
            let cut = codec.decompress(&data[..data.len() / 2], &mut bytes, content.len());
            assert!(
                !matches!(cut, Decompression::Whole(_)) || bytes.len() < content.len(),
                "{codec:?}: {cut:?}"
            );
            assert!(content.starts_with(&bytes), "{codec:?}");
            bytes.clear();
            assert_eq!(codec.decompress(b"no stream", &mut bytes, 9), Decompression::Damaged, "{codec:?}");
        }
    }

    #[test]
    fn a_bomb_is_stopped() {
        let data = deflate(&vec![0; 10_000_000]);
        let mut bytes = Vec::new();
        assert_eq!(inflate(&data, &mut bytes, 1_000_000), Decompression::TooLong);
        assert_eq!(bytes.len(), 1_000_000);
    }

    #[test]
    fn data_before_the_end_of_a_stream_is_returned() {
        let content: Vec<u8> = (0..100_000_u32).flat_map(u32::to_le_bytes).collect();
        let mut data = deflate(&content);
        let mut bytes = Vec::new();
        assert_eq!(inflate(&data[..data.len() / 2], &mut bytes, 1 << 20), Decompression::CutOff);
        assert!(bytes.len() > 100_000 && content.starts_with(&bytes), "{}", bytes.len());
        let last = data.len() - 1;
        data[last] ^= 1;
        bytes.clear();
        assert_eq!(inflate(&data, &mut bytes, 1 << 20), Decompression::Damaged, "the checksum");
        assert_eq!(bytes.len(), content.len());
        assert_eq!(inflate(b"no stream", &mut bytes, 1 << 20), Decompression::Damaged);
        assert_eq!(inflate(b"", &mut bytes, 1 << 20), Decompression::CutOff);
    }
}
