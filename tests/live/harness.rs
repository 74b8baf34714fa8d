//! Programs in the guest, their output, and the buses that they use.

use std::env;
use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support;

/// Time limit for an expected condition on a busy machine.
pub const LIMIT: Duration = Duration::from_mins(1);

/// Time to wait for a greeting frame before the next one is sent.
const PATIENCE: Duration = Duration::from_millis(500);

/// Interval between two checks of a polled condition.
const GLANCE: Duration = Duration::from_millis(10);

/// Identifier of greeting frames; nothing else uses it.
pub const HELLO: &str = "1FFFFFFF";

/// Whether this runs in the guest. If not, the test was reported as skipped and must return.
pub fn in_guest() -> bool {
    let is = env::var_os("COBSCOPE_GUEST").is_some();
    if !is {
        support::skip("guest", "not in the guest of tests/guest/run, see tests/guest/README.md");
    }
    is
}

/// Whether this guest has devices: can0 and can1, two controllers on one wire, and simulated USB devices.
pub fn has_devices() -> bool {
    if !in_guest() {
        return false;
    }
    let is = env::var("COBSCOPE_GUEST").is_ok_and(|backend| backend == "qemu");
    if !is {
        support::skip("devices", "only the guest of tests/guest/run --backend qemu has them");
    }
    is
}

/// Output of a program so far.
#[derive(Default)]
struct ProgramOutput {
    out: Vec<String>,
    err: Vec<String>,
}

type Shared = Arc<(Mutex<ProgramOutput>, Condvar)>;

/// A running program; killed when dropped.
pub struct Program {
    name: String,
    child: Child,
    printed: Shared,
    readers: Vec<thread::JoinHandle<()>>,
}

/// Result of a finished program.
#[derive(Debug)]
pub struct Ended {
    pub status: ExitStatus,
    pub out: Vec<String>,
    pub err: Vec<String>,
}

impl Program {
    /// Starts a program with an empty standard input.
    pub fn start(command: &mut Command) -> Self {
        Self::start_on(Stdio::null(), command)
    }

    fn start_on(input: impl Into<Stdio>, command: &mut Command) -> Self {
        let piped = command.stdin(input).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = piped.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let printed = Shared::default();
        let out = listen(child.stdout.take().unwrap(), &printed, |printed| &mut printed.out);
        let err = listen(child.stderr.take().unwrap(), &printed, |printed| &mut printed.err);
        Self { name: format!("{command:?}"), child, printed, readers: vec![out, err] }
    }

    /// `cobscope live` with events and all undecoded frames as JSON Lines.
    pub fn live<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Self {
        Self::live_on(Stdio::null(), arguments)
    }

    /// Like [`Program::live`], with this standard input.
    pub fn live_on<S: AsRef<OsStr>>(input: impl Into<Stdio>, arguments: impl IntoIterator<Item = S>) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        Self::start_on(input, command.args(["live", "--print", "-f", "jsonl", "--frames"]).args(arguments))
    }

    /// candump in its log form, with a receive buffer large enough for all frames.
    pub fn candump(source: &str) -> Self {
        Self::start(Command::new("candump").args(["-L", "-r", "8388608", source]))
    }

    /// The first result of `find` on the output, or `None` after `limit`.
    fn find<T>(&self, limit: Duration, find: impl Fn(&ProgramOutput) -> Option<T>) -> Option<T> {
        let (printed, changed) = &*self.printed;
        let printed = printed.lock().unwrap();
        let (printed, _) =
            changed.wait_timeout_while(printed, limit, |printed| find(printed).is_none()).unwrap();
        find(&printed)
    }

    fn wait<T>(&self, what: &str, find: impl Fn(&ProgramOutput) -> Option<T>) -> T {
        self.find(LIMIT, find).unwrap_or_else(|| panic!("no {what} from {}\n{}", self.name, self.printed()))
    }

    /// The last lines of the output, for an error message.
    fn printed(&self) -> String {
        let printed = self.printed.0.lock().unwrap();
        let last =
            |lines: &[String]| lines.iter().rev().take(40).rev().cloned().collect::<Vec<_>>().join("\n");
        format!("stdout ends:\n{}\nstderr ends:\n{}", last(&printed.out), last(&printed.err))
    }

    /// Waits for a line on standard error.
    pub fn wait_message(&self, what: &str, is: impl Fn(&str) -> bool) -> String {
        self.wait(what, |printed| printed.err.iter().find(|line| is(line)).cloned())
    }

    /// All events of this kind so far.
    pub fn events(&self, kind: &str) -> Vec<Value> {
        events(&self.printed.0.lock().unwrap().out, kind)
    }

    /// Waits until the events of this kind meet a condition.
    pub fn wait_events(&self, kind: &str, are: impl Fn(&[Value]) -> bool) -> Vec<Value> {
        let wanted = |printed: &ProgramOutput| Some(events(&printed.out, kind)).filter(|events| are(events));
        self.wait(&format!("{kind} events as wanted"), wanted)
    }

    /// Whether a frame with [`HELLO`] and this data was printed within `limit`.
    fn greeted(&self, data: &str, limit: Duration) -> bool {
        let is = |line: &String| line.contains(HELLO) && line.contains(data);
        self.find(limit, |printed| printed.out.iter().rev().any(is).then_some(())).is_some()
    }

    /// Lines on standard output.
    pub fn lines(&self) -> Vec<String> {
        self.printed.0.lock().unwrap().out.clone()
    }

    /// Lines on standard output after the first `after`; waits for [`PATIENCE`] at most.
    pub fn more(&self, after: usize) -> Vec<String> {
        self.find(PATIENCE, |printed| {
            printed.out.get(after..).filter(|lines| !lines.is_empty()).map(<[_]>::to_vec)
        })
        .unwrap_or_default()
    }

    /// Waits for a line on standard output.
    pub fn wait_line(&self, what: &str, is: impl Fn(&str) -> bool) -> String {
        self.wait(what, |printed| printed.out.iter().find(|line| is(line)).cloned())
    }

    /// Sends a signal: `INT`, `STOP`, `CONT`, `KILL`.
    pub fn signal(&self, signal: &str) {
        run("sh", &["-c", &format!("kill -{signal} {}", self.child.id())]);
    }

    /// CPU time of the program.
    pub fn processor_time(&self) -> Duration {
        let text = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap();
        // After the name in brackets, state is field 1; user and system time are fields 12 and 13, in 1/100
        // s.
        let fields: Vec<_> = text.rsplit(')').next().unwrap().split_whitespace().collect();
        let ticks: u64 = fields[11..13].iter().map(|field| field.parse::<u64>().unwrap()).sum();
        Duration::from_millis(10 * ticks)
    }

    /// Waits until the program ends.
    pub fn end(mut self) -> Ended {
        let begin = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(begin.elapsed() < LIMIT, "{} does not end\n{}", self.name, self.printed());
            thread::sleep(GLANCE);
        };
        self.readers.drain(..).for_each(|reader| reader.join().unwrap());
        let ProgramOutput { out, err } = std::mem::take(&mut *self.printed.0.lock().unwrap());
        Ended { status, out, err }
    }

    /// Ends the program like Ctrl-C; its exit is not a failure.
    pub fn interrupt(self) -> Ended {
        self.signal("INT");
        let name = self.name.clone();
        let ended = self.end();
        assert!(ended.status.success(), "{name}: {}\n{}", ended.status, ended.err.join("\n"));
        ended
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // This also ends a stopped program.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Stores the lines of a stream in the output of the program.
fn listen(
    stream: impl Read + Send + 'static,
    printed: &Shared,
    place: fn(&mut ProgramOutput) -> &mut Vec<String>,
) -> thread::JoinHandle<()> {
    let printed = Arc::clone(printed);
    thread::spawn(move || {
        for line in BufReader::new(stream).split(b'\n') {
            let Ok(line) = line else { break };
            place(&mut printed.0.lock().unwrap()).push(String::from_utf8_lossy(&line).into_owned());
            printed.1.notify_all();
        }
    })
}

/// The events of this kind in lines of JSON; panics at invalid JSON.
pub fn events(lines: &[String], kind: &str) -> Vec<Value> {
    let parse = |line: &String| -> Value {
        serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))
    };
    let is = |event: &Value| event["kind"] == kind;
    lines.iter().filter(|line| line.contains(kind)).map(parse).filter(is).collect()
}

/// Runs a command, which must succeed; returns its standard output.
pub fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).stdin(Stdio::null()).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {arguments:?}: {}\n{error}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Waits until a condition is true.
pub fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let begin = Instant::now();
    while !is_so() {
        assert!(begin.elapsed() < LIMIT, "{what}: still not so");
        thread::sleep(GLANCE);
    }
}

/// Runs `ip` with blank-separated arguments.
pub fn ip(arguments: &str) {
    run("ip", &arguments.split_whitespace().collect::<Vec<_>>());
}

/// Sends frames in cansend's form with one program, because starting a program is slow in a guest.
pub fn send<S: AsRef<str>>(bus: &str, frames: &[S]) {
    let mut player = Command::new("canplayer");
    player.args(["-t", &format!("{bus}=sent")]).stdin(Stdio::piped());
    let mut player = player.spawn().unwrap();
    let mut input = player.stdin.take().unwrap();
    for frame in frames {
        writeln!(input, "(0.000000) sent {}", frame.as_ref()).unwrap();
    }
    drop(input);
    assert!(player.wait().unwrap().success());
}

/// Sends unique frames until all of these programs have printed one: now each program receives this bus, and
/// earlier frames have arrived or are lost. Returns the printed frame in candump's form.
pub fn greet(bus: &str, programs: &[&Program]) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let begin = Instant::now();
    while begin.elapsed() < LIMIT {
        let data = format!("{:08X}", COUNT.fetch_add(1, Ordering::Relaxed));
        let frame = format!("{HELLO}#{data}");
        run("cansend", &[bus, &frame]);
        if programs.iter().all(|program| program.greeted(&data, PATIENCE)) {
            return frame;
        }
    }
    let printed: Vec<_> =
        programs.iter().map(|program| format!("{}\n{}", program.name, program.printed())).collect();
    panic!("frames sent on {bus} are not printed by all of\n{}", printed.join("\n"));
}

/// A virtual bus for one test, deleted when dropped.
pub struct Bus(pub &'static str);

impl Bus {
    /// Creates the bus with CAN FD and sets it up.
    pub fn new(name: &'static str) -> Self {
        let bus = Self(name);
        bus.create();
        bus
    }

    pub fn create(&self) {
        ip(&format!("link add dev {} type vcan", self.0));
        ip(&format!("link set {} mtu 72 up", self.0));
    }

    pub fn delete(&self) {
        ip(&format!("link del {}", self.0));
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        if Path::new("/sys/class/net").join(self.0).exists() {
            self.delete();
        }
    }
}
