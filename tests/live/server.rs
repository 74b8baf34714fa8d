//! A socketcand server, for which there is no Debian package. It responds and writes like socketcand 0.6
//! (`src/state_nobus.c`, `src/state_raw.c` of github.com/linux-can/socketcand): no line ends, data without
//! separators, no remote frames. Its frames are those that candump receives.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;

use crate::harness::{Program, greet};

/// The server of one bus; closes its connections when dropped.
pub struct Server {
    pub port: u16,
    bus: &'static str,
    state: Arc<Mutex<State>>,
}

#[derive(Default)]
struct State {
    /// Commands of the clients.
    commands: Vec<String>,
    /// Connections; `None` if no more are accepted.
    clients: Option<Vec<TcpStream>>,
}

impl Server {
    /// Serves a bus at this port; 0 selects a free one.
    pub fn start(port: u16, bus: &'static str) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let state = Arc::new(Mutex::new(State { clients: Some(Vec::new()), ..State::default() }));
        let shared = Arc::clone(&state);
        thread::spawn(move || {
            for stream in listener.incoming() {
                let stream = stream.unwrap();
                let mut state = shared.lock().unwrap();
                let Some(clients) = &mut state.clients else { return };
                clients.push(stream.try_clone().unwrap());
                drop(state);
                let shared = Arc::clone(&shared);
                // A client may disconnect at any time.
                thread::spawn(move || serve(stream, bus, &shared));
            }
        });
        Self { port, bus, state }
    }

    /// Source argument of the program for this server.
    pub fn source(&self) -> String {
        format!("socketcand://127.0.0.1:{}/{}", self.port, self.bus)
    }

    /// All commands of the clients.
    pub fn commands(&self) -> Vec<String> {
        self.state.lock().unwrap().commands.clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let clients = self.state.lock().unwrap().clients.take();
        for client in clients.into_iter().flatten() {
            let _ = client.shutdown(Shutdown::Both);
        }
        // Wakes the listener, which then ends.
        let _ = TcpStream::connect((Ipv4Addr::LOCALHOST, self.port));
    }
}

fn serve(mut stream: TcpStream, bus: &'static str, state: &Mutex<State>) -> std::io::Result<()> {
    stream.write_all(b"< hi >")?;
    let mut candump = None;
    let mut command = Vec::new();
    let mut byte = [0];
    while stream.read(&mut byte)? == 1 {
        command.extend_from_slice(&byte);
        if byte != *b">" {
            continue;
        }
        let text = String::from_utf8_lossy(&command).trim().to_owned();
        command.clear();
        state.lock().unwrap().commands.push(text.clone());
        let is_open = text == format!("< open {bus} >");
        let answer = match text.as_str() {
            _ if is_open => "< ok >",
            "< echo >" => "< echo >",
            "< rawmode >" => "< ok >",
            _ => "< error unknown command >",
        };
        if text == "< rawmode >" {
            // Frames follow the response only, and from then on none is missed.
            let program = Program::candump(bus);
            greet(bus, &[&program]);
            candump = Some(program);
        }
        stream.write_all(answer.as_bytes())?;
        if let Some(program) = candump.take() {
            let output = stream.try_clone()?;
            thread::spawn(move || forward(&program, output));
        }
    }
    Ok(())
}

/// Writes frames that candump receives from now on, until the client disconnects.
fn forward(candump: &Program, mut output: TcpStream) -> std::io::Result<()> {
    let mut reported = candump.lines().len();
    loop {
        let lines = candump.more(reported);
        reported += lines.len();
        for line in lines {
            let (stamp, frame) = line.split_once(") ").unwrap();
            let (id, data) = frame.split_once(' ').unwrap().1.split_once('#').unwrap();
            let time = stamp.trim_start_matches('(');
            let text = match data.strip_prefix('#') {
                Some(data) => format!("< fdframe {id} 0{} {time} {} >", &data[..1], &data[1..]),
                None if data.starts_with('R') => continue,
                None => format!("< frame {id} {time} {data} >"),
            };
            output.write_all(text.as_bytes())?;
        }
    }
}
