//! How fast the terminal UI is on a large capture.
//!
//! ```text
//! cargo bench -p cobscope --bench screen -- target/bench/10M.log
//! ```
//!
//! The capture is made by `benches/run`. Everything is the application itself, with keys, on
//! a screen of 200 × 60 that only the drawing to a real terminal is missing of.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a bench that cannot go on has failed")]

use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use cobscope::app::App;
use cobscope::timeline::TimelineNews;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

const SIZE: (u16, u16) = (200, 60);

struct Screen {
    app: App,
    news: Receiver<TimelineNews>,
    terminal: Terminal<TestBackend>,
}

impl Screen {
    fn draw(&mut self) -> Duration {
        let start = Instant::now();
        self.terminal.draw(|frame| self.app.draw(frame.area(), frame.buffer_mut())).unwrap();
        start.elapsed()
    }

    /// Takes news until something is so.
    fn until(&mut self, is_so: impl Fn(&App) -> bool) {
        while !is_so(&self.app) {
            let news = self.news.recv_timeout(Duration::from_millis(1));
            if let Ok(news) = news {
                self.app.on_news(news);
            }
        }
    }

    /// Presses keys and waits for the place they go to; time until its screen is drawn.
    fn go(&mut self, keys: &str) -> Duration {
        let start = Instant::now();
        for key in cobscope::keymap::parse_sequence(keys).unwrap() {
            self.app.on_key(key);
        }
        while self.app.is_seeking() {
            let news = self.news.recv().unwrap();
            self.app.on_news(news);
        }
        self.draw();
        start.elapsed()
    }
}

fn figures(name: &str, mut times: Vec<Duration>) {
    times.sort();
    let at = |share: usize| {
        times.get((times.len() * share / 100).min(times.len() - 1)).unwrap().as_secs_f64() * 1e3
    };
    println!("{name:<44} median {:>8.2} ms  p99 {:>8.2} ms  worst {:>8.2} ms", at(50), at(99), at(100));
}

/// Peak of the memory of this process in MiB, as the system accounts it.
fn peak() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|word| word != "--bench");
    let path = arguments.next().unwrap_or_else(|| "target/bench/10M.log".to_owned());
    let words: Vec<String> = ["view", &path].map(str::to_owned).to_vec();
    let start = Instant::now();
    let (app, news) = cobscope::open_view(&words).unwrap();
    let terminal = Terminal::new(TestBackend::new(SIZE.0, SIZE.1)).unwrap();
    let mut screen = Screen { app, news, terminal };
    screen.app.on_resize(SIZE.0, SIZE.1);
    screen.until(|app| !app.is_seeking());
    screen.draw();
    println!("{:<44} {:>15.2} ms", "first screen", start.elapsed().as_secs_f64() * 1e3);
    screen.until(App::is_indexed);
    println!("{:<44} {:>15.2} ms", "index complete", start.elapsed().as_secs_f64() * 1e3);
    screen.until(|app| !app.is_busy());
    println!("{:<44} {:>15.2} ms", "judged, and searched for news", start.elapsed().as_secs_f64() * 1e3);
    println!("{:<44} {:>15.1} MiB", "peak memory", peak());

    screen.go("v");
    screen.until(|app| !app.is_busy());
    let frames = screen.app.frames();
    let mut seeks = Vec::new();
    let mut place: u64 = 1;
    for _ in 0..200 {
        // A fixed sequence of places all over the capture.
        place = place.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        seeks.push(screen.go(&format!(":#{}<enter>", (place >> 16) % frames.max(1) + 1)));
    }
    figures("jump to any frame, drawn", seeks);
    let scroll = (0..500).map(|_| screen.go("j")).collect();
    figures("one line on, drawn", scroll);
    let page = (0..200).map(|_| screen.go("<pgdn>")).collect();
    figures("one page on, drawn", page);
    for pane in 1..=9 {
        screen.go(&pane.to_string());
        let draws = (0..300).map(|_| screen.draw()).collect();
        figures(&format!("draw pane {pane}"), draws);
    }
    screen.go("2");
    for filter in ["kind == \"emcy\"", "node == 5 && pdo"] {
        let start = Instant::now();
        screen.go(&format!("f{}{filter}<enter>", "<backspace>".repeat(20)));
        let first = start.elapsed();
        screen.until(|app| !app.is_busy());
        let all = start.elapsed().as_secs_f64() * 1e3;
        let name = format!("filter {filter}");
        println!("{name:<44} first {:>9.2} ms  all {all:>10.2} ms", first.as_secs_f64() * 1e3);
    }
    println!("{:<44} {:>15.1} MiB", "peak memory", peak());
}
