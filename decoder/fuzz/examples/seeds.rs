//! Creates the corpora from the fixtures and prints the names of the formats: `seeds FIXTURES CORPUS`.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{Batch, CaptureReader, FORMATS, ReadOptions};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};
use cobscope_decoder::wire::isotp::{IsoTpAddresses, IsoTpFrame, parse};
use cobscope_fuzz::harness::session::encode;

/// Number of frames used of a capture, and number of frames per seed of the session: long seeds slow the
/// fuzzer down, and it joins seeds itself.
const FRAMES: usize = 320;
const FRAMES_A_SEED: usize = 80;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(fixtures), Some(corpus)) = (arguments.next(), arguments.next()) else {
        return Err("usage: seeds FIXTURES CORPUS".into());
    };
    let mut files = Vec::new();
    list(&fixtures.join("../decoder/profiles/vendor"), &mut files)?;
    for path in files.drain(..) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        put(&corpus, "profile", &name, &fs::read(&path)?)?;
    }
    list(&fixtures, &mut files)?;
    for path in files {
        let bytes = fs::read(&path)?;
        let name = path.strip_prefix(&fixtures)?.to_string_lossy().into_owned();
        // Stored inputs belong to the target that found them.
        if let Some((target, name)) = name.strip_prefix("fuzz/").and_then(|name| name.split_once('/')) {
            put(&corpus, target, name, &bytes)?;
            continue;
        }
        if let Some(name) = name.strip_prefix("device_files/") {
            put(&corpus, "device_file", name, &bytes)?;
            continue;
        }
        if let Some(name) = name.strip_prefix("dbc/") {
            put(&corpus, "dbc", name, &bytes)?;
            continue;
        }
        let name = name.replace('/', "_");
        let bus_file: Vec<_> = String::from_utf8_lossy(&bytes)
            .lines()
            .filter_map(|line| line.strip_prefix("#| ").map(str::to_owned))
            .collect();
        if !bus_file.is_empty() {
            put(&corpus, "expectations", &name, bus_file.join("\n").as_bytes())?;
        }
        put(&corpus, "any", &name, &bytes)?;
        let Ok(mut reader) = CaptureReader::open(&bytes[..], &ReadOptions::default()) else { continue };
        put(&corpus, reader.format().name, &name, &bytes)?;
        let mut batch = Batch::new();
        let mut frames = Vec::new();
        while frames.len() < FRAMES && reader.read(&mut batch).unwrap_or(false) {
            frames.extend_from_slice(batch.frames());
        }
        frames.truncate(FRAMES);
        for (part, frames) in frames.chunks(FRAMES_A_SEED).enumerate() {
            for target in ["session", "devices"] {
                put(&corpus, target, &format!("{name}.{part}"), &encode(frames))?;
            }
        }
        for frame in &frames {
            payload(&corpus, frame)?;
        }
    }
    for format in FORMATS {
        println!("{} {}", format.name, if format.is_text { "text" } else { "binary" });
    }
    Ok(())
}

/// Writes the payload of a frame as a seed of the wire parser for its identifier.
fn payload(corpus: &Path, frame: &Frame) -> std::io::Result<()> {
    let data = frame.data();
    let name = data.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let target = match frame.id {
        CanId::Extended(id) if frame.flags.contains(FrameFlags::ERROR) => {
            let bytes = [&id.to_le_bytes()[..], data].concat();
            return put(corpus, "error_frame", &format!("{id:x}_{name}"), &bytes);
        }
        CanId::Extended(id) if IsoTpAddresses::from_identifier(id).is_some() => {
            if let Ok(IsoTpFrame::Single { data } | IsoTpFrame::First { data, .. }) = parse(data, data.len())
            {
                let name = data.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
                put(corpus, "uds", &format!("p{name}"), data)?;
            }
            "isotp"
        }
        CanId::Extended(id) => {
            let bytes = [&id.to_le_bytes()[..], data].concat();
            return put(corpus, "j1939", &format!("{id:x}_{name}"), &bytes);
        }
        CanId::Standard(0) => "nmt",
        CanId::Standard(0x80) => "sync",
        CanId::Standard(0x81..=0xFF) => "emcy",
        CanId::Standard(0x100) => "time",
        CanId::Standard(0x581..=0x67F) => "sdo",
        CanId::Standard(0x701..=0x77F) => "error_control",
        CanId::Standard(0x7E4 | 0x7E5) => "lss",
        CanId::Standard(_) => return Ok(()),
    };
    put(corpus, target, &format!("p{name}"), data)
}

fn put(corpus: &Path, target: &str, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    let folder = corpus.join(target);
    fs::create_dir_all(&folder)?;
    fs::write(folder.join(name), bytes)
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            list(&path, files)?;
        } else if path.extension().is_none_or(|extension| extension != "py" && extension != "md") {
            files.push(path);
        }
    }
    Ok(())
}
