//! Compressed captures, recognised by their first bytes.

use std::io::{BufRead, Read, Result};

/// First bytes of gzip (RFC 1952).
const GZIP: &[u8] = &[0x1F, 0x8B];

/// First bytes of zstd (RFC 8878).
const ZSTD: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];

/// Whether these first bytes are those of a compressed file, so that its lines are not the capture's lines.
pub fn is_compressed(head: &[u8]) -> bool {
    head.starts_with(GZIP) || head.starts_with(ZSTD)
}

/// Decompresses gzip (RFC 1952, several members) or zstd (RFC 8878); returns other content unchanged.
///
/// # Errors
/// If the source cannot be read, or this build does not support its compression.
pub fn decompress<'a>(mut source: impl BufRead + Send + 'a) -> Result<Box<dyn Read + Send + 'a>> {
    let head = source.fill_buf()?;
    if head.starts_with(GZIP) {
        return gzip(source);
    }
    if head.starts_with(ZSTD) {
        return zstd(source);
    }
    Ok(Box::new(source))
}

/// Decompressor that reports the position at which a compressed file ends early.
#[cfg(any(feature = "gzip", feature = "zstd", feature = "rust-codecs"))]
struct CheckedStream<D> {
    decoder: D,
    /// Compressed unit in the error message: `gzip member` or `zstd frame`.
    what: &'static str,
    /// Returns the number of compressed bytes read so far.
    taken: fn(&D) -> u64,
}

#[cfg(any(feature = "gzip", feature = "zstd", feature = "rust-codecs"))]
impl<D: Read> Read for CheckedStream<D> {
    fn read(&mut self, room: &mut [u8]) -> Result<usize> {
        self.decoder.read(room).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                let place = format!("incomplete {} at byte {}", self.what, (self.taken)(&self.decoder));
                std::io::Error::new(error.kind(), place)
            }
            _ => error,
        })
    }
}

/// Counts the bytes read from a source.
#[cfg(any(feature = "gzip", feature = "zstd", feature = "rust-codecs"))]
struct CountedSource<R> {
    source: R,
    taken: u64,
}

#[cfg(any(feature = "gzip", feature = "zstd", feature = "rust-codecs"))]
impl<R: BufRead> Read for CountedSource<R> {
    fn read(&mut self, room: &mut [u8]) -> Result<usize> {
        let count = self.source.read(room)?;
        self.taken = self.taken.saturating_add(count as u64);
        Ok(count)
    }
}

#[cfg(any(feature = "gzip", feature = "zstd", feature = "rust-codecs"))]
impl<R: BufRead> BufRead for CountedSource<R> {
    fn fill_buf(&mut self) -> Result<&[u8]> {
        self.source.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.taken = self.taken.saturating_add(count as u64);
        self.source.consume(count);
    }
}

#[cfg(feature = "gzip")]
#[expect(clippy::unnecessary_wraps, reason = "one signature with and without the feature")]
fn gzip<'a>(source: impl BufRead + Send + 'a) -> Result<Box<dyn Read + Send + 'a>> {
    let counted = CountedSource { source, taken: 0 };
    let decoder = flate2::bufread::MultiGzDecoder::new(counted);
    Ok(Box::new(CheckedStream { decoder, what: "gzip member", taken: |decoder| decoder.get_ref().taken }))
}

#[cfg(not(feature = "gzip"))]
fn gzip<'a>(_source: impl BufRead + Send + 'a) -> Result<Box<dyn Read + Send + 'a>> {
    Err(std::io::Error::other("gzip compression; this build lacks the feature `gzip`"))
}

#[cfg(feature = "zstd")]
fn zstd<'a>(source: impl BufRead + Send + 'a) -> Result<Box<dyn Read + Send + 'a>> {
    let counted = CountedSource { source, taken: 0 };
    let decoder = zstd::stream::read::Decoder::with_buffer(counted)?;
    Ok(Box::new(CheckedStream { decoder, what: "zstd frame", taken: |decoder| decoder.get_ref().taken }))
}

#[cfg(all(feature = "rust-codecs", not(feature = "zstd")))]
#[expect(clippy::unnecessary_wraps, reason = "one signature with and without the feature")]
fn zstd<'a>(source: impl BufRead + Send + 'a) -> Result<Box<dyn Read + Send + 'a>> {
    let counted = CountedSource { source, taken: 0 };
    let decoder = super::rust_codecs::ZstdFrames::new(counted);
    let taken = |decoder: &super::rust_codecs::ZstdFrames<CountedSource<_>>| {
        decoder.get_ref().map_or(0, |source| source.taken)
    };
    Ok(Box::new(CheckedStream { decoder, what: "zstd frame", taken }))
}

#[cfg(not(any(feature = "zstd", feature = "rust-codecs")))]
fn zstd<'a>(_source: impl BufRead + Send + 'a) -> Result<Box<dyn Read + Send + 'a>> {
    Err(std::io::Error::other("zstd compression; this build lacks the feature `zstd`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_content_passes_through() {
        let mut text = String::new();
        decompress(&b"(1.0) can0 1#"[..]).unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "(1.0) can0 1#");
    }

    #[cfg(feature = "gzip")]
    #[test]
    fn two_gzip_members_read_as_one() {
        use std::io::Write;
        let mut bytes = Vec::new();
        for part in ["one ", "two"] {
            let mut encoder = flate2::write::GzEncoder::new(&mut bytes, flate2::Compression::fast());
            encoder.write_all(part.as_bytes()).unwrap();
            encoder.finish().unwrap();
        }
        let mut text = String::new();
        decompress(&bytes[..]).unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "one two");
    }
}
