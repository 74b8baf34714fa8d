//! Decompression of chunks.

use std::borrow::Cow;
use std::io::Read;

/// Maximum size of the decompressed records in bytes. Usual chunks have one to four megabytes.
pub(super) const LARGEST: usize = 64 * 1024 * 1024;

/// The decompressed records, and the reason if they are incomplete.
pub(super) struct ChunkRecords<'a> {
    pub(super) records: Cow<'a, [u8]>,
    pub(super) failure: Option<String>,
}

/// Decompresses a chunk whose records have a declared size of `size` bytes.
pub(super) fn unpack_chunk<'a>(packing: &[u8], packed: &'a [u8], size: u64) -> ChunkRecords<'a> {
    match packing {
        b"" => ChunkRecords { records: Cow::Borrowed(packed), failure: None },
        b"zstd" => zstd(packed, size),
        b"lz4" => lz4(packed, size),
        unknown => {
            let known = "expected none, lz4 or zstd";
            failed_chunk(format!(
                "chunk compression \"{}\"; {known}",
                unknown.get(..16).unwrap_or(unknown).escape_ascii()
            ))
        }
    }
}

fn failed_chunk(reason: String) -> ChunkRecords<'static> {
    ChunkRecords { records: Cow::Borrowed(&[]), failure: Some(reason) }
}

#[cfg(feature = "zstd")]
fn zstd(packed: &[u8], size: u64) -> ChunkRecords<'_> {
    match zstd::stream::read::Decoder::with_buffer(packed) {
        Ok(decoder) => read_records(decoder, size),
        Err(error) => failed_chunk(not_unpacked(&error)),
    }
}

#[cfg(all(feature = "rust-codecs", not(feature = "zstd")))]
fn zstd(packed: &[u8], size: u64) -> ChunkRecords<'_> {
    read_records(crate::capture::rust_codecs::ZstdFrames::new(packed), size)
}

#[cfg(not(any(feature = "zstd", feature = "rust-codecs")))]
fn zstd(_packed: &[u8], _size: u64) -> ChunkRecords<'_> {
    failed_chunk("zstd compression: this build lacks the feature `zstd`".into())
}

#[cfg(feature = "mcap")]
fn lz4(packed: &[u8], size: u64) -> ChunkRecords<'_> {
    match lz4::Decoder::new(packed) {
        Ok(decoder) => read_records(decoder, size),
        Err(error) => failed_chunk(not_unpacked(&error)),
    }
}

#[cfg(all(feature = "rust-codecs", not(feature = "mcap")))]
fn lz4(packed: &[u8], size: u64) -> ChunkRecords<'_> {
    read_records(crate::capture::rust_codecs::Lz4Frames::new(packed), size)
}

#[cfg(not(any(feature = "mcap", feature = "rust-codecs")))]
fn lz4(_packed: &[u8], _size: u64) -> ChunkRecords<'_> {
    failed_chunk("lz4 compression: this build lacks the feature `mcap`".into())
}

/// Error text in parentheses, because the libraries' messages mention frames that are not CAN frames.
fn not_unpacked(error: &std::io::Error) -> String {
    format!("decompression failed ({error})")
}

/// Decompresses in steps: the declared size is not allocated in advance.
#[cfg_attr(
    not(any(feature = "zstd", feature = "rust-codecs")),
    expect(dead_code, reason = "no compression is supported")
)]
fn read_records(mut source: impl Read, size: u64) -> ChunkRecords<'static> {
    let most = usize::try_from(size).unwrap_or(usize::MAX).min(LARGEST);
    let mut records = Vec::new();
    let failure = match source.by_ref().take(most as u64).read_to_end(&mut records) {
        Err(error) => Some(not_unpacked(&error)),
        Ok(_) if (records.len() as u64) < size => {
            Some(format!("decompresses to {} bytes; expected {size}", records.len()))
        }
        Ok(_) => None,
    };
    ChunkRecords { records: Cow::Owned(records), failure }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_packed_stays_where_it_is() {
        let unpacked = unpack_chunk(b"", &[1, 2], 2);
        assert!(matches!(unpacked.records, Cow::Borrowed([1, 2])));
        assert_eq!(unpacked.failure, None);
    }

    #[cfg(feature = "zstd")]
    #[test]
    fn a_chunk_that_is_cut_gives_what_is_there_and_says_so() {
        // Incompressible data, so that the start can be decompressed without the end.
        let bytes: Vec<u8> =
            (0..400_000_u32).map(|number| (number.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let packed = zstd::stream::encode_all(&bytes[..], 1).unwrap();
        let whole = unpack_chunk(b"zstd", &packed, bytes.len() as u64);
        assert_eq!((whole.records.as_ref(), whole.failure), (&bytes[..], None));
        let cut = unpack_chunk(b"zstd", &packed[..packed.len() - 10], bytes.len() as u64);
        assert!(bytes.starts_with(&cut.records));
        assert!(!cut.records.is_empty());
        assert!(cut.failure.is_some());
        let lie = unpack_chunk(b"zstd", &packed, u64::MAX);
        assert_eq!(lie.records.len(), bytes.len());
        assert_eq!(
            lie.failure.unwrap(),
            format!("decompresses to {} bytes; expected {}", bytes.len(), u64::MAX)
        );
    }

    #[test]
    fn unknown_packings_are_named() {
        let failure = unpack_chunk(b"br\x1B", &[1], 1).failure.unwrap();
        assert_eq!(failure, "chunk compression \"br\\x1b\"; expected none, lz4 or zstd");
    }
}
