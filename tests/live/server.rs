//! A socketcand server, as no Debian package has one. It answers and writes as socketcand 0.6 does
//! (`src/state_nobus.c`, `src/state_raw.c` of github.com/linux-can/socketcand): no line ends, data in one piece,
//! remote frames left out. Its frames are those that candump hears.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;

use crate::harness::{Program, greet};

/// The server of one bus; dropped it closes its connections.
pub struct Server {
    pub port: u16,
    bus: &'static str,
    state: Arc<Mutex<State>>,
}

#[derive(Default)]
struct State {
    /// What clients asked for.
    commands: Vec<String>,
    /// Connections; none are taken any more where there is no list.
    clients: Option<Vec<TcpStream>>,
}

impl Server {
    /// Serves a bus at this port, 0 for any.
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
                // A client that goes away is no error.
                thread::spawn(move || serve(stream, bus, &shared));
            }
        });
        Self { port, bus, state }
    }

    /// How the program names it.
    pub fn source(&self) -> String {
        format!("socketcand://127.0.0.1:{}/{}", self.port, self.bus)
    }

    /// All that clients asked for.
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
            // Frames come only after the answer, and none is missed from then on.
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

/// Writes frames that candump hears from now on, until the client is gone.
fn forward(candump: &Program, mut output: TcpStream) -> std::io::Result<()> {
    let mut told = candump.lines().len();
    loop {
        let lines = candump.more(told);
        told += lines.len();
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
