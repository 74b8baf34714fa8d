//! Tests with full, lost and slow disks.

use super::*;

#[test]
fn a_full_disk_leaves_complete_records_and_recording_continues() {
    for format in WRITABLE {
        let name = format!("run.{}", format.suffix);
        let full = length_of(format, 20);
        let header = length_of(format, 0);
        // Frames that are written together or not at all.
        let grain = length_of(format, if gathers(format) { 10 } else { 1 });
        // Free space of every size.
        for room in header..full {
            full_at(format, &name, room, grain);
        }
    }
}

/// Size of an unfinished capture with `frames` frames.
fn length_of(format: &'static WritableFormat, frames: u32) -> usize {
    let memory = Memory::new(usize::MAX);
    let name = format!("run.{}", format.suffix);
    let mut all = parts(&memory, &name, false, UNLIMITED);
    all.take_items(items(0..frames), &can0(), None);
    memory.bytes(&name).len()
}

/// Twenty frames in two batches on a disk with `room` bytes, ten while it is full, ten after it has room
/// again.
fn full_at(format: &WritableFormat, name: &str, room: usize, grain: usize) {
    let memory = Memory::new(room);
    let mut parts = parts(&memory, name, false, UNLIMITED);
    let begin = Instant::now();
    parts.take_items(items(0..10), &can0(), Some(begin));
    parts.take_items(items(10..20), &can0(), Some(begin));
    parts.take_items(items(20..30), &can0(), Some(begin + RETRY_AFTER / 2));
    let first = memory.lock().files.get(Path::new(name)).cloned().unwrap_or_default();
    let recorded = frames(&read(&first));
    let count = u32::try_from(recorded.len()).unwrap();
    assert_eq!(recorded, kept(format, 0..count), "{name} {room}");
    // As many frames as fit.
    assert!(room - first.len() < grain, "{name} {room} {}", first.len());
    let status = parts.status().clone();
    let missing = u64::from(30 - count);
    assert_eq!((status.frames, status.missing, status.bytes), (count.into(), missing, first.len() as u64));
    let failure = status.failure.unwrap();
    assert_eq!((failure.missing, failure.is_over), (missing, false), "{room}");
    // The text is that of the system; Windows has another one for this number.
    assert_eq!(failure.reason, io::Error::from_raw_os_error(28).to_string());
    assert_eq!(failure.path, Path::new(name));

    memory.set(|inner| inner.room = usize::MAX / 2);
    parts.take_items(items(30..40), &can0(), Some(begin + RETRY_AFTER));
    parts.finish_recording();
    let second = if first.is_empty() { name.to_owned() } else { name.replace('.', "-0002.") };
    let texts = read(&memory.bytes(&second));
    assert_eq!(frames(&texts), kept(format, 30..40));
    let tells = format.holds.notices;
    assert_eq!(losses(&texts), missing * u64::from(tells));
    assert_eq!(matches!(texts[0], RecordedItem::Notice(..)), tells, "they precede the first frame");
    let status = parts.status();
    assert_eq!(status.path, Path::new(&second));
    assert_eq!((status.frames, status.missing), (u64::from(count) + 10, missing));
    assert!(status.failure.as_ref().unwrap().is_over);
    assert_eq!(status.parts, if first.is_empty() { 1 } else { 2 });
    let held: u64 = memory.names().iter().map(|name| memory.bytes(name).len() as u64).sum();
    assert_eq!(status.bytes, held);
}

#[test]
fn a_disk_that_is_gone_is_tried_every_few_seconds() {
    let memory = Memory::new(28 + 200);
    let mut parts = parts(&memory, "run.pcapng", false, UNLIMITED);
    let begin = Instant::now();
    parts.take_items(items(0..10), &can0(), Some(begin));
    let count = frames(&read(&memory.bytes("run.pcapng"))).len() as u64;
    assert!((1..5).contains(&count), "{count}");
    memory.set(|inner| inner.is_gone = true);
    // One frame per second for a minute.
    for second in 1..=60_u32 {
        let lost = PendingItem { bus: 0, what: RecordItem::Notice(lost(1)) };
        let now = begin + Duration::from_secs(second.into());
        parts.take_items([items(second..second + 1), vec![lost]].concat(), &can0(), Some(now));
    }
    assert_eq!(memory.lock().made, 1 + 12);
    let failure = parts.status().failure.clone().unwrap();
    assert_eq!((failure.missing, failure.path), (70 - count, "run-0002.pcapng".into()));
    assert!(failure.reason.ends_with("(os error 5)"), "{}", failure.reason);
    // Back but full: no empty files remain.
    memory.set(|inner| inner.is_gone = false);
    memory.set(|inner| inner.room = 30);
    parts.take_items(items(61..62), &can0(), Some(begin + Duration::from_secs(65)));
    assert_eq!(memory.names(), ["run.pcapng"]);
    memory.set(|inner| inner.room = 1_000);
    let down = PendingItem { bus: 0, what: RecordItem::Notice(link(62, LinkState::Down)) };
    let up = PendingItem { bus: 0, what: RecordItem::Notice(link(62, LinkState::Up)) };
    parts.take_items(
        [vec![down, up], items(62..63)].concat(),
        &can0(),
        Some(begin + Duration::from_secs(70)),
    );
    let texts = read(&memory.bytes("run-0002.pcapng"));
    // Frames lost before they arrived are counted too, and the last link state is written.
    let missing = 71 - count;
    let bus = || "can0".to_owned();
    assert_eq!(
        texts,
        [
            RecordedItem::Notice(bus(), lost(missing + 60)),
            RecordedItem::Notice(bus(), link(62, LinkState::Up)),
            RecordedItem::Frame(bus(), frame(62))
        ]
    );
    assert_eq!(parts.status().missing, missing);
    // A later failure has its own count.
    memory.set(|inner| inner.room = 0);
    parts.take_items(items(63..65), &can0(), Some(begin + Duration::from_secs(71)));
    assert_eq!(parts.status().failure.as_ref().unwrap().missing, 2);
    assert_eq!(parts.status().missing, missing + 2);
}

#[test]
fn a_full_disk_takes_one_old_part_at_most() {
    let memory = Memory::new(6 * LINE);
    let limits = RecordLimits { bytes: 2 * LINE as u64, files: 3, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    let begin = Instant::now();
    log.take_items(items(0..6), &can0(), Some(begin));
    assert_eq!(memory.names(), ["run-0001.log", "run-0002.log", "run-0003.log"]);
    // The oldest part is removed for the next one.
    log.take_items(items(6..8), &can0(), Some(begin));
    assert_eq!(memory.names(), ["run-0002.log", "run-0003.log", "run-0004.log"]);
    assert_eq!((log.status().frames, log.status().missing), (8, 0));
    memory.set(|inner| inner.is_crowded = true);
    for second in (10..100).step_by(10) {
        log.take_items(items(8..9), &can0(), Some(begin + Duration::from_secs(second)));
        assert_eq!(memory.names(), ["run-0003.log", "run-0004.log"]);
    }
    assert_eq!((log.status().removed, log.status().missing), (2, 9));
}

#[test]
fn a_failed_sync_is_reported() {
    let memory = Memory::new(usize::MAX);
    let mut log = parts(&memory, "run.log", false, UNLIMITED);
    let begin = Instant::now();
    log.take_items(items(0..2), &can0(), Some(begin));
    memory.set(|inner| inner.fails_to_sync = true);
    log.sync_to_disk();
    log.take_items(items(2..5), &can0(), Some(begin));
    let failure = log.status().failure.clone().unwrap();
    assert!(failure.reason.contains("(os error 5)"), "{}", failure.reason);
    assert_eq!((failure.missing, log.status().frames), (3, 2));
    memory.set(|inner| inner.fails_to_sync = false);
    log.take_items(items(5..6), &can0(), Some(begin + RETRY_AFTER));
    log.sync_to_disk();
    assert_eq!(frames(&read(&memory.bytes("run-0002.log"))), expected(5..6));
}

#[test]
fn a_slow_disk_delays_no_thread() {
    let memory = Memory::new(usize::MAX);
    let room = 3_000;
    let path = options(Path::new("run.pcapng"));
    let mut recorder =
        Recorder::open_on(Box::new(memory.clone()), &path, day(), room * size_of::<PendingItem>()).unwrap();
    memory.set(|inner| inner.is_stuck = true);
    for number in 0..5_000 {
        recorder.frame(&frame(number), "can0");
    }
    recorder.notice(&link(5_000, LinkState::Down), "can1");
    recorder.tick(Instant::now());
    let status = recorder.status();
    assert_eq!((status.too_fast, status.missing), (2_000, 2_000));
    assert_eq!(status.failure, None);
    memory.set(|inner| inner.is_stuck = false);
    wait(&recorder, |status| status.frames == 3_000);
    // The status is available before the disk has room again.
    let begun = Instant::now();
    while recorder.queued.load(Ordering::Acquire) > 0 {
        assert!(begun.elapsed() < LIMIT);
        std::thread::yield_now();
    }
    recorder.frame(&frame(5_000), "can0");
    let status = recorder.finish();
    assert_eq!((status.frames, status.missing, status.parts), (3_001, 2_000, 1));
    let texts = read(&memory.bytes("run.pcapng"));
    assert_eq!(frames(&texts), expected((0..3_000).chain([5_000])));
    assert_eq!(
        texts[3_000..3_002],
        [
            RecordedItem::Notice("can0".to_owned(), lost(2_000)),
            RecordedItem::Notice("can1".to_owned(), link(5_000, LinkState::Down))
        ]
    );
}

/// A file is read faster than a disk writes.
#[test]
fn input_with_patience_waits_for_the_writer() {
    let memory = Memory::new(usize::MAX);
    let path = options(Path::new("run.pcapng"));
    let room = 2_000 * size_of::<PendingItem>();
    let mut recorder = Recorder::open_on(Box::new(memory.clone()), &path, day(), room).unwrap();
    recorder.patience = LIMIT;
    (0..50_000).for_each(|number| recorder.frame(&frame(number), "can0"));
    let status = recorder.finish();
    assert_eq!((status.frames, status.missing), (50_000, 0));
}

#[test]
fn losses_at_the_end_are_reported() {
    let memory = Memory::new(usize::MAX);
    let path = options(Path::new("run.pcapng"));
    let mut recorder =
        Recorder::open_on(Box::new(memory.clone()), &path, day(), 10 * size_of::<PendingItem>()).unwrap();
    memory.set(|inner| inner.is_stuck = true);
    (0..15).for_each(|number| recorder.frame(&frame(number), "can0"));
    memory.set(|inner| inner.is_stuck = false);
    let status = recorder.finish();
    assert_eq!((status.frames, status.missing), (10, 5));
    let texts = read(&memory.bytes("run.pcapng"));
    assert_eq!((frames(&texts).len(), losses(&texts)), (10, 5));
}

/// A disk whose files are all the device that is always full.
#[cfg(target_os = "linux")]
struct Full;

#[cfg(target_os = "linux")]
impl RecordDisk for Full {
    fn create_file(&mut self, _path: &Path) -> io::Result<Box<dyn RecordFile>> {
        Ok(Box::new(std::fs::File::options().write(true).open("/dev/full")?))
    }

    fn read(&mut self, _path: &Path) -> io::Result<Box<dyn io::Read + Send>> {
        Err(ErrorKind::Unsupported.into())
    }

    fn remove_file(&mut self, _path: &Path) -> io::Result<()> {
        Ok(())
    }

    fn rename_file(&mut self, _from: &Path, _to: &Path) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_device_that_is_full_is_full() {
    let path = options(Path::new("run.log"));
    let mut recorder = Recorder::open_on(Box::new(Full), &path, day(), QUEUE).unwrap();
    let begin = Instant::now();
    for number in 0..3_000 {
        recorder.frame(&frame(number), "can0");
    }
    recorder.tick(begin);
    let status = wait(&recorder, |status| status.missing == 3_000);
    assert_eq!(
        status.remark_texts().first().unwrap(),
        "run.log: No space left on device (os error 28): 3000 frames not written so far; retrying"
    );
    assert_eq!(recorder.finish().frames, 0);
    // A format with a header fails at once.
    let path = options(Path::new("run.pcapng"));
    let error = Recorder::open_on(Box::new(Full), &path, day(), QUEUE).err().unwrap();
    assert_eq!(format!("{error:#}"), "run.pcapng: cannot be created: No space left on device (os error 28)");
}

/// Folder of the child process with a limited file size.
#[cfg(target_os = "linux")]
const FOLDER: &str = "COBSCOPE_TEST_RECORD_FOLDER";

#[cfg(target_os = "linux")]
#[test]
fn files_that_may_not_grow_are_followed_by_others() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        return record_with_little_room(Path::new(&folder));
    }
    let folder = tempfile::tempdir().unwrap();
    // 4 or 8 KiB, depending on the shell; the ignored signal becomes an error.
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"";
    let test = "record::tests::fails::files_that_may_not_grow_are_followed_by_others";
    let mut command = std::process::Command::new("sh");
    command.args(["-c", script]).arg(std::env::current_exe().unwrap());
    command.args(["--exact", test]).env(FOLDER, folder.path());
    let output = command.output().unwrap();
    let texts = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && texts.contains("1 passed"), "{texts}");
}

#[cfg(target_os = "linux")]
fn record_with_little_room(folder: &Path) {
    for format in WRITABLE {
        let name = |part: &str| folder.join(format!("run{part}.{}", format.suffix));
        let mut recorder = Recorder::open(&options(&name("")), day()).unwrap();
        let begin = Instant::now();
        for batch in 0..25 {
            (batch * 20..batch * 20 + 20).for_each(|number| recorder.frame(&frame(number), "can0"));
            recorder.tick(begin + WRITE_EVERY * batch);
            let so_far = u64::from(batch * 20 + 20);
            wait(&recorder, |status| status.frames + status.missing == so_far);
        }
        let status = recorder.status();
        assert_eq!(status.failure.as_ref().unwrap().reason, "File too large (os error 27)");
        assert!(!status.failure.unwrap().is_over);
        let before = frames(&read(&std::fs::read(name("")).unwrap()));
        assert!(before.len() >= 20, "{}", before.len());
        assert_eq!(before, kept(format, 0..u32::try_from(before.len()).unwrap()));
        assert_eq!(status.missing, 500 - before.len() as u64);
        (500..510).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin + WRITE_EVERY * 25 + RETRY_AFTER);
        let end = recorder.finish();
        assert_eq!((end.frames, end.missing), (before.len() as u64 + 10, status.missing));
        let texts = read(&std::fs::read(name("-0002")).unwrap());
        assert_eq!(frames(&texts), kept(format, 500..510));
        assert_eq!(losses(&texts), if format.holds.notices { status.missing } else { 0 });
    }
}
