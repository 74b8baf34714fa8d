//! Compressed captures, and text in UTF-16, recognised by their first bytes.

use std::io::{BufRead, Read, Result};

use encoding_rs::{CoderResult, Decoder, UTF_16BE, UTF_16LE};

/// First bytes of gzip (RFC 1952).
const GZIP: &[u8] = &[0x1F, 0x8B];

/// First bytes of zstd (RFC 8878).
const ZSTD: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];

/// Byte order marks of UTF-16, which `>` of Windows PowerShell writes.
const UTF_16: [&[u8]; 2] = [&[0xFF, 0xFE], &[0xFE, 0xFF]];

/// Whether these first bytes are those of a compressed file or of UTF-16, so that its lines are not the capture's lines.
pub fn is_compressed(head: &[u8]) -> bool {
    head.starts_with(GZIP) || head.starts_with(ZSTD) || UTF_16.iter().any(|mark| head.starts_with(mark))
}

/// Decompresses gzip (RFC 1952, several members) or zstd (RFC 8878), and converts UTF-16 with a byte order mark to UTF-8;
/// returns other content unchanged.
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
    let [little, big] = UTF_16;
    if head.starts_with(little) || head.starts_with(big) {
        let encoding = if head.starts_with(little) { UTF_16LE } else { UTF_16BE };
        return Ok(Box::new(Utf16Text::new(source, encoding.new_decoder_with_bom_removal())));
    }
    Ok(Box::new(source))
}

/// Maximum number of bytes of UTF-16 converted at once.
const CONVERTED: usize = 64 * 1024;

/// Text in UTF-16 as UTF-8. Invalid characters become U+FFFD.
struct Utf16Text<R> {
    source: R,
    decoder: Decoder,
    converted: Vec<u8>,
    /// Number of converted bytes already read.
    taken: usize,
    has_ended: bool,
}

impl<R: BufRead> Utf16Text<R> {
    fn new(source: R, decoder: Decoder) -> Self {
        Self { source, decoder, converted: Vec::new(), taken: 0, has_ended: false }
    }

    /// Converts the next bytes of the source.
    fn convert_more(&mut self) -> Result<()> {
        let input = self.source.fill_buf()?;
        let is_last = input.is_empty();
        let input = input.get(..CONVERTED).unwrap_or(input);
        // A unit of two bytes becomes up to three.
        self.converted.resize(input.len().saturating_mul(2).saturating_add(16), 0);
        let (result, read, written, _) = self.decoder.decode_to_utf8(input, &mut self.converted, is_last);
        self.source.consume(read);
        self.converted.truncate(written);
        self.taken = 0;
        self.has_ended = is_last && result == CoderResult::InputEmpty;
        Ok(())
    }
}

impl<R: BufRead> Read for Utf16Text<R> {
    fn read(&mut self, room: &mut [u8]) -> Result<usize> {
        while self.taken >= self.converted.len() {
            if self.has_ended {
                return Ok(0);
            }
            self.convert_more()?;
        }
        let rest = self.converted.get(self.taken..).unwrap_or_default();
        let count = rest.len().min(room.len());
        if let (Some(target), Some(source)) = (room.get_mut(..count), rest.get(..count)) {
            target.copy_from_slice(source);
        }
        self.taken += count;
        Ok(count)
    }
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

    #[test]
    fn utf_16_becomes_utf_8() {
        let text = "(1.0) can0 1#\r\nÄ€𝄞\n";
        let units: Vec<u16> = std::iter::once(0xFEFF).chain(text.encode_utf16()).collect();
        for bytes in [
            units.iter().flat_map(|unit| unit.to_le_bytes()).collect::<Vec<_>>(),
            units.iter().flat_map(|unit| unit.to_be_bytes()).collect(),
        ] {
            assert!(is_compressed(&bytes));
            // Three bytes at a time separate the halves of units.
            let source = std::io::BufReader::with_capacity(3, &bytes[..]);
            let mut found = String::new();
            decompress(source).unwrap().read_to_string(&mut found).unwrap();
            assert_eq!(found, text);
        }
        let mut cut = String::new();
        decompress(&b"\xFF\xFEa\0b"[..]).unwrap().read_to_string(&mut cut).unwrap();
        assert_eq!(cut, "a\u{FFFD}");
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
