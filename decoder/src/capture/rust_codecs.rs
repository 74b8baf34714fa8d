//! Decompressors of zstd (RFC 8878) and LZ4 frames in Rust, for targets without a C compiler.

use std::io::{Cursor, Error, ErrorKind, Read, Result};

/// First and last magic number of a skippable zstd frame.
const SKIPPABLE: std::ops::RangeInclusive<u32> = 0x184D_2A50..=0x184D_2A5F;

/// A source that notes its end: an error of a decompressor after it means that the data are incomplete.
struct EndNoting<R> {
    source: R,
    has_ended: bool,
}

impl<R> EndNoting<R> {
    fn new(source: R) -> Self {
        Self { source, has_ended: false }
    }
}

impl<R: Read> Read for EndNoting<R> {
    fn read(&mut self, room: &mut [u8]) -> Result<usize> {
        let count = self.source.read(room)?;
        self.has_ended |= count == 0 && !room.is_empty();
        Ok(count)
    }
}

fn cut_off(error: Error, has_ended: bool) -> Error {
    if has_ended { Error::new(ErrorKind::UnexpectedEof, error) } else { error }
}

/// Reader of LZ4 frames.
pub(super) struct Lz4Frames<R: Read>(lz4_flex::frame::FrameDecoder<EndNoting<R>>);

impl<R: Read> Lz4Frames<R> {
    pub(super) fn new(source: R) -> Self {
        Self(lz4_flex::frame::FrameDecoder::new(EndNoting::new(source)))
    }
}

impl<R: Read> Read for Lz4Frames<R> {
    fn read(&mut self, room: &mut [u8]) -> Result<usize> {
        let outcome = self.0.read(room);
        outcome.map_err(|error| cut_off(error, self.0.get_ref().has_ended))
    }
}

/// A source whose first bytes were read already.
type FrameSource<R> = std::io::Chain<Cursor<[u8; 4]>, EndNoting<R>>;

enum ZstdState<R: Read> {
    Between(EndNoting<R>),
    Within(Box<ruzstd::decoding::StreamingDecoder<FrameSource<R>, ruzstd::decoding::FrameDecoder>>),
    Failed,
}

/// Reader of zstd frames, one after the other; skippable frames are ignored.
pub(super) struct ZstdFrames<R: Read>(ZstdState<R>);

impl<R: Read> ZstdFrames<R> {
    pub(super) fn new(source: R) -> Self {
        Self(ZstdState::Between(EndNoting::new(source)))
    }

    /// The source; `None` after an error.
    pub(super) fn get_ref(&self) -> Option<&R> {
        match &self.0 {
            ZstdState::Between(source) => Some(&source.source),
            ZstdState::Within(decoder) => Some(&decoder.get_ref().get_ref().1.source),
            ZstdState::Failed => None,
        }
    }

    /// Starts the next frame; `false` at the end.
    fn begin_frame(&mut self, mut source: EndNoting<R>) -> Result<bool> {
        loop {
            let mut magic = Vec::with_capacity(4);
            source.by_ref().take(4).read_to_end(&mut magic)?;
            if magic.is_empty() {
                self.0 = ZstdState::Between(source);
                return Ok(false);
            }
            let Ok(magic) = <[u8; 4]>::try_from(magic) else { return Err(ErrorKind::UnexpectedEof.into()) };
            if SKIPPABLE.contains(&u32::from_le_bytes(magic)) {
                let mut length = [0; 4];
                source.read_exact(&mut length)?;
                let length = u64::from(u32::from_le_bytes(length));
                std::io::copy(&mut source.by_ref().take(length), &mut std::io::sink())?;
                continue;
            }
            let frame = Cursor::new(magic).chain(source);
            let decoder = ruzstd::decoding::StreamingDecoder::new(frame).map_err(Error::other)?;
            self.0 = ZstdState::Within(Box::new(decoder));
            return Ok(true);
        }
    }
}

impl<R: Read> Read for ZstdFrames<R> {
    fn read(&mut self, room: &mut [u8]) -> Result<usize> {
        if room.is_empty() {
            return Ok(0);
        }
        loop {
            match std::mem::replace(&mut self.0, ZstdState::Failed) {
                ZstdState::Failed => return Err(Error::other("damaged zstd frame")),
                ZstdState::Between(source) => {
                    if !self.begin_frame(source)? {
                        return Ok(0);
                    }
                }
                ZstdState::Within(mut decoder) => {
                    let outcome = decoder.read(room);
                    let has_ended = decoder.get_ref().get_ref().1.has_ended;
                    match outcome {
                        Ok(0) => self.0 = ZstdState::Between(decoder.into_inner().into_inner().1),
                        outcome => {
                            self.0 = ZstdState::Within(decoder);
                            return outcome.map_err(|error| cut_off(error, has_ended));
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `printf 'cobscope cobscope cobscope' | zstd -c`, zstd 1.5.7.
    const ZSTD: &[u8] = &[
        0x28, 0xB5, 0x2F, 0xFD, 0x04, 0x58, 0x7D, 0x00, 0x00, 0x48, 0x63, 0x6F, 0x62, 0x73, 0x63, 0x6F, 0x70,
        0x65, 0x20, 0x01, 0x00, 0x9C, 0xCB, 0x11, 0x10, 0x64, 0xB2, 0xB3,
    ];

    #[test]
    fn zstd_frames_are_read_as_one_and_skippable_ones_ignored() {
        let skippable = [&0x184D_2A50_u32.to_le_bytes()[..], &3_u32.to_le_bytes(), b"xyz"].concat();
        let all = [ZSTD, &skippable, ZSTD].concat();
        let mut text = String::new();
        ZstdFrames::new(&all[..]).read_to_string(&mut text).unwrap();
        assert_eq!(text, "cobscope cobscope cobscopecobscope cobscope cobscope");
        let mut bytes = Vec::new();
        let cut = ZstdFrames::new(&ZSTD[..ZSTD.len() - 6]).read_to_end(&mut bytes).unwrap_err();
        assert_eq!(cut.kind(), ErrorKind::UnexpectedEof);
        assert!(ZstdFrames::new(&b"no zstd at all"[..]).read_to_end(&mut bytes).is_err());
    }

    /// `printf 'cobscope cobscope cobscope' | lz4 -c`, lz4 1.9.4.
    const LZ4: &[u8] = &[
        0x04, 0x22, 0x4D, 0x18, 0x64, 0x40, 0xA7, 0x12, 0x00, 0x00, 0x00, 0x98, 0x63, 0x6F, 0x62, 0x73, 0x63,
        0x6F, 0x70, 0x65, 0x20, 0x09, 0x00, 0x50, 0x73, 0x63, 0x6F, 0x70, 0x65, 0x00, 0x00, 0x00, 0x00, 0xA5,
        0x31, 0xAD, 0xCD,
    ];

    #[test]
    fn lz4_frames_are_read_and_their_early_end_is_an_error() {
        let mut text = String::new();
        Lz4Frames::new(LZ4).read_to_string(&mut text).unwrap();
        assert_eq!(text, "cobscope cobscope cobscope");
        let mut bytes = Vec::new();
        let cut = Lz4Frames::new(&LZ4[..LZ4.len() - 12]).read_to_end(&mut bytes).unwrap_err();
        assert_eq!(cut.kind(), ErrorKind::UnexpectedEof);
    }
}
