//! What a full bus costs: received, decoded, judged and recorded.
//!
//! ```text
//! cargo bench -p cobscope --bench live
//! ```
//!
//! Datagrams stand for frames, since few kernels have CAN: they take the same way through `recvmmsg`, only the driver's
//! part differs. Another process sends them as evenly as the scheduler lets it. 1 Mbit/s carries at most 21,276 frames
//! a second (no data, no stuff bits) and 9,009 of eight bytes.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a bench that cannot go on has failed")]

use std::net::UdpSocket;
use std::process::Command;
use std::time::{Duration, Instant};

/// Set for the process that sends: address and frames a second.
const SENDER: &str = "COBSCOPE_BENCH_SENDER";

/// How long each rate is sent.
const SECONDS: u64 = 10;

/// Name, frames a second, and what the command is asked for.
const ROWS: [(&str, u64, &[&str]); 6] = [
    ("1 bus of empty frames: receive only", 21_276, &["--print", "-f", "none", "--no-findings"]),
    ("the same, recorded as candump", 21_276, &["--print", "-f", "none", "--no-findings", "--record", "log"]),
    (
        "the same, recorded as pcapng",
        21_276,
        &["--print", "-f", "none", "--no-findings", "--record", "pcapng"],
    ),
    ("the same, judged too", 21_276, &["--check", "--record", "pcapng"]),
    (
        "2 buses of empty frames, recorded",
        42_552,
        &["--print", "-f", "none", "--no-findings", "--record", "log"],
    ),
    ("1 bus of eight bytes, recorded", 9_009, &["--print", "-f", "none", "--no-findings", "--record", "log"]),
];

fn main() {
    if let Ok(order) = std::env::var(SENDER) {
        return send(&order);
    }
    println!("{:<42} {:>9} {:>9} {:>9} {:>8}", "", "frames/s", "received", "µs/frame", "% core");
    for (name, rate, arguments) in ROWS {
        row(name, rate, arguments);
    }
}

fn row(name: &str, rate: u64, arguments: &[&str]) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let order = format!("{} {rate}", socket.local_addr().unwrap());
    let folder = std::env::temp_dir();
    let record = |word: &str| folder.join(format!("cobscope-bench-{}.{word}", std::process::id()));
    let mut words = vec!["live".to_owned(), "-".to_owned(), "-T".to_owned(), "1000".to_owned()];
    let mut files = Vec::new();
    for word in arguments {
        if matches!(*word, "log" | "pcapng") {
            files.push(record(word));
            words.push(record(word).display().to_string());
        } else {
            words.push((*word).to_owned());
        }
    }
    let mut sender = Command::new(std::env::current_exe().unwrap()).env(SENDER, order).spawn().unwrap();
    let before = cpu();
    cobscope::live_over_datagrams(&words, socket).unwrap();
    let used = cpu().saturating_sub(before);
    let sent = sender.wait().unwrap();
    assert!(sent.success());
    let frames = rate * SECONDS;
    #[expect(clippy::cast_precision_loss, reason = "figures")]
    let (each, share) =
        (used.as_secs_f64() * 1e6 / frames as f64, used.as_secs_f64() * 100.0 / SECONDS as f64);
    println!("{name:<42} {rate:>9} {:>9} {each:>9.2} {share:>8.1}", "");
    for file in files {
        let _ = std::fs::remove_file(file);
    }
}

/// Processor time of this process, in steps of 10 ms.
fn cpu() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    // The time of the process itself and of the kernel for it, fields 14 and 15 of proc(5).
    let fields = stat.rsplit(')').next().unwrap().split_whitespace();
    let ticks: u64 = fields.skip(11).take(2).map(|ticks| ticks.parse::<u64>().unwrap()).sum();
    Duration::from_millis(ticks * 10)
}

/// Sends frames at a rate: what is due, each millisecond.
fn send(order: &str) {
    let (address, rate) = order.split_once(' ').unwrap();
    let rate: u64 = rate.parse().unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(address).unwrap();
    let (start, mut sent) = (Instant::now(), 0u64);
    let length: u8 = if rate < 10_000 { 8 } else { 0 };
    while sent < rate * SECONDS {
        let due = u64::try_from(start.elapsed().as_micros()).unwrap() * rate / 1_000_000;
        while sent < due.min(rate * SECONDS) {
            let mut frame = [0u8; 16];
            let id = 0x181 + u32::try_from(sent % 16).unwrap();
            frame[..4].copy_from_slice(&id.to_ne_bytes());
            frame[4] = length;
            frame[8..].copy_from_slice(&sent.to_le_bytes());
            socket.send(&frame).unwrap();
            sent += 1;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}
