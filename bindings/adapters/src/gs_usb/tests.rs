//! The listener with transfers that are played.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::*;
use crate::{AdapterErrorFrame, ReceivedFrame};

/// An adapter with `channels` channels that plays transfers and records commands.
#[derive(Clone)]
struct Played {
    constants: [u32; 10],
    channels: u8,
    state: [u32; 3],
    transfers: Arc<Mutex<VecDeque<Vec<u8>>>>,
    commands: Arc<Mutex<Vec<AdapterCommand>>>,
}

/// Listen-only mode, timestamps, bus errors and the state; 48 MHz.
const ALL_FEATURES: u32 = 0x3011;

impl Played {
    fn new(features: u32, transfers: &[&[u8]]) -> Self {
        Self {
            constants: [features, 48_000_000, 1, 16, 1, 8, 4, 1, 1_024, 1],
            channels: 1,
            state: [0; 3],
            transfers: Arc::new(Mutex::new(transfers.iter().map(|bytes| bytes.to_vec()).collect())),
            commands: Arc::default(),
        }
    }

    fn start(&self, name: &str, channel: u8, bit_rate: u32) -> Result<GsUsbListener, OpenError> {
        GsUsbListener::start_channel(Box::new(self.clone()), name, channel, bit_rate)
    }

    /// Once it is on the bus: the host notices it only after the transfers that precede.
    fn is_unplugged(&self) -> bool {
        let is_on_bus =
            self.commands().iter().any(|command| matches!(command, AdapterCommand::Listen { .. }));
        is_on_bus && self.transfers.lock().unwrap().iter().any(|bytes| bytes == b"unplugged")
    }

    fn commands(&self) -> Vec<AdapterCommand> {
        self.commands.lock().unwrap().clone()
    }
}

fn bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

impl AdapterTransport for Played {
    fn ask_question(&mut self, question: AdapterQuestion) -> Result<Vec<u8>, Disconnected> {
        if self.is_unplugged() {
            return Err(Disconnected("no answer".into()));
        }
        Ok(match question {
            AdapterQuestion::Device => vec![0, 0, 0, self.channels - 1, 2, 0, 0, 0, 1, 0, 0, 0],
            AdapterQuestion::Constants => bytes(&self.constants),
            AdapterQuestion::State => bytes(&self.state),
        })
    }

    fn send_command(&mut self, command: AdapterCommand) -> Result<(), Disconnected> {
        self.commands.lock().unwrap().push(command);
        Ok(())
    }

    fn read_transfer(&mut self, _wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<bool, Disconnected> {
        match self.transfers.lock().unwrap().pop_front() {
            Some(bytes) if bytes == b"unplugged" => Err(Disconnected("device disconnected".into())),
            Some(bytes) => {
                take(&bytes);
                Ok(true)
            }
            None => Ok(false),
        }
    }
}

/// 181 with data 11 22 at 10,000 µs; the last four bytes are the timestamp.
const FRAME: [u8; 24] =
    [255, 255, 255, 255, 0x81, 1, 0, 0, 2, 0, 0, 0, 0x11, 0x22, 0, 0, 0, 0, 0, 0, 0x10, 0x27, 0, 0];

/// Controller problem: error passive in reception, receive error counter 130.
const PASSIVE: [u8; 24] =
    [255, 255, 255, 255, 4, 2, 0, 0x20, 8, 0, 0, 0, 0, 0x10, 0, 0, 0, 0, 0, 130, 0x20, 0x27, 0, 0];

#[test]
fn listen_only_is_set_with_the_request_that_joins_the_bus() {
    let adapter = Played::new(ALL_FEATURES, &[]);
    drop(adapter.start("", 0, 500_000).unwrap());
    let commands = adapter.commands();
    let [
        AdapterCommand::ByteOrder,
        AdapterCommand::Reset,
        AdapterCommand::Timing(_),
        listen,
        AdapterCommand::Reset,
    ] = commands[..]
    else {
        panic!("{commands:?}")
    };
    assert_eq!(listen, AdapterCommand::Listen { has_stamps: true, has_bus_errors: true });
    // Features that an adapter lacks are not requested.
    let adapter = Played::new(1, &[]);
    let listener = adapter.start("", 0, 500_000).unwrap();
    assert_eq!(adapter.commands()[3], AdapterCommand::Listen { has_stamps: false, has_bus_errors: false });
    assert!(!listener.has_stamps());
}

#[test]
fn an_adapter_without_listen_only_mode_never_joins_the_bus() {
    let adapter = Played::new(ALL_FEATURES & !1, &[]);
    let error = adapter.start("0042", 0, 500_000).err().unwrap();
    assert_eq!(
        error.to_string(),
        "adapter 0042 has no listen-only mode; other modes are not used because they acknowledge frames; update its \
         firmware, or use another adapter"
    );
    assert_eq!(adapter.commands(), [AdapterCommand::ByteOrder]);
}

#[test]
fn other_refusals() {
    let adapter = Played::new(ALL_FEATURES, &[]);
    let error =
        |name: &str, channel, bit_rate| adapter.start(name, channel, bit_rate).err().unwrap().to_string();
    assert_eq!(error("", 0, 470_000), "470000 bit/s not available: the clock of the adapter has 48000000 Hz");
    assert_eq!(error("0042/1", 1, 500_000), "adapter 0042/1 not found; gs_usb adapters: 0042/0");
    assert_eq!(adapter.commands(), [AdapterCommand::ByteOrder; 2]);
}

#[test]
fn frames_states_and_losses_arrive_in_order() {
    let mut overflow = FRAME;
    overflow[10] = 1;
    let adapter = Played::new(ALL_FEATURES & !0x2000, &[&FRAME, &PASSIVE, &overflow, b"unplugged"]);
    let mut listener = adapter.start("", 0, 500_000).unwrap();
    let mut readings = Vec::new();
    let disconnected = listener.read(&mut readings, Duration::ZERO).unwrap_err();
    assert_eq!(disconnected.to_string(), "device disconnected");
    let frame = ReceivedFrame {
        id: 0x181,
        is_extended: false,
        is_remote: false,
        length: 2,
        data: [0x11, 0x22, 0, 0, 0, 0, 0, 0],
        stamp: 10_000,
    };
    let error = AdapterErrorFrame {
        class: 0x204,
        data: [0, 0x10, 0, 0, 0, 0, 0, 130],
        confinement: Some(FaultConfinement::Passive),
        stamp: 10_016,
    };
    assert_eq!(
        readings,
        [
            ReceivedItem::Frame(frame),
            ReceivedItem::ErrorFrame(error),
            ReceivedItem::Frame(frame),
            ReceivedItem::Lost
        ]
    );
    assert_eq!(
        listener.status(),
        Ok(ControllerStatus { confinement: FaultConfinement::Passive, counters: None })
    );
}

/// The adapter states error passive before its error frame has been read.
#[test]
fn the_state_changes_with_its_error_frame() {
    let mut adapter = Played::new(ALL_FEATURES, &[&PASSIVE]);
    adapter.state = [2, 130, 0];
    let mut listener = adapter.start("", 0, 500_000).unwrap();
    let counters = Some(crate::ErrorCounters { receive: 130, transmit: 0 });
    let status = |confinement| Ok(ControllerStatus { confinement, counters });
    assert_eq!(listener.status(), status(FaultConfinement::Active));
    listener.read(&mut Vec::new(), Duration::ZERO).unwrap();
    assert_eq!(listener.status(), status(FaultConfinement::Passive));
}

/// The timestamps restart at 0 in between.
#[test]
fn each_of_100_000_frames_is_read_in_order() {
    const START: u32 = u32::MAX - 5_000_000;
    let transfer = |number: u32| {
        let mut bytes = FRAME;
        bytes[12..16].copy_from_slice(&number.to_le_bytes());
        bytes[8] = 4;
        bytes[20..].copy_from_slice(&START.wrapping_add(100 * number).to_le_bytes());
        bytes.to_vec()
    };
    let adapter = Played::new(ALL_FEATURES, &[]);
    adapter.transfers.lock().unwrap().extend((0..100_000).map(transfer));
    let mut listener = adapter.start("", 0, 500_000).unwrap();
    let mut readings = Vec::new();
    while readings.len() < 100_000 {
        let before = readings.len();
        listener.read(&mut readings, Duration::ZERO).unwrap();
        assert!(readings.len() > before);
    }
    for (number, reading) in (0_u32..).zip(&readings) {
        let ReceivedItem::Frame(frame) = reading else { panic!("{reading:?}") };
        assert_eq!(frame.data[..4], number.to_le_bytes());
        assert_eq!(frame.stamp, START.wrapping_add(100 * number));
    }
}

/// The state is asked for while transfers are waiting.
#[test]
fn frames_that_arrived_before_it_was_unplugged_are_read() {
    let adapter = Played::new(ALL_FEATURES, &[&FRAME, b"unplugged"]);
    let mut listener = adapter.start("", 0, 500_000).unwrap();
    assert_eq!(listener.status().map(|status| status.confinement), Ok(FaultConfinement::Active));
    let mut readings = Vec::new();
    listener.read(&mut readings, Duration::ZERO).unwrap_err();
    assert_eq!(readings.len(), 1);
}

#[test]
fn a_read_ends_after_its_maximum() {
    let frames = vec![&FRAME[..]; MAX_READINGS + 1];
    let adapter = Played::new(ALL_FEATURES, &frames);
    let mut listener = adapter.start("", 0, 500_000).unwrap();
    let mut readings = Vec::new();
    listener.read(&mut readings, Duration::from_mins(1)).unwrap();
    assert_eq!(readings.len(), MAX_READINGS);
    listener.read(&mut readings, Duration::from_mins(1)).unwrap();
    assert_eq!(readings.len(), MAX_READINGS + 1);
}

#[test]
fn each_channel_of_an_adapter_is_listed() {
    let device = UsbAdapter { name: "0042".into(), product: "CANable 2".into() };
    let listed = |channels, features| {
        let mut adapter = Played::new(features, &[]);
        adapter.channels = channels;
        let found = channels_of(&device, adapter);
        found.into_iter().map(|channel| (channel.name, channel.device, channel.state)).collect::<Vec<_>>()
    };
    let expected = |name: &str, device: &str, state| (name.to_owned(), device.to_owned(), state);
    assert_eq!(listed(1, 1), [expected("0042", "CANable 2", ChannelState::Available)]);
    assert_eq!(
        listed(2, 0),
        [
            expected("0042/0", "CANable 2, channel 0", ChannelState::NotListenOnly),
            expected("0042/1", "CANable 2, channel 1", ChannelState::NotListenOnly),
        ]
    );
    assert_eq!(listed(255, 1).len(), 16);
}

#[test]
fn an_adapter_is_chosen_by_its_serial_number() {
    let names = ["0042", "0043"];
    assert_eq!(choose_adapter(&names, "0043"), Ok((1, 0)));
    assert_eq!(choose_adapter(&names, "0042/1"), Ok((0, 1)));
    assert_eq!(choose_adapter(&names[..1], ""), Ok((0, 0)));
    assert_eq!(choose_adapter(&names[..1], "/1"), Ok((0, 1)));
    let error = |names: &[&str], channel: &str| choose_adapter(names, channel).unwrap_err().to_string();
    assert_eq!(error(&names, ""), "several gs_usb adapters found; name one: 0042, 0043");
    assert_eq!(error(&names, "0044"), "adapter 0044 not found; gs_usb adapters: 0042, 0043");
    assert_eq!(error(&names, "0042/256"), "adapter 0042/256 not found; gs_usb adapters: 0042, 0043");
    assert_eq!(error(&names, "0042/+1"), "adapter 0042/+1 not found; gs_usb adapters: 0042, 0043");
    assert_eq!(error(&[], "0042"), "adapter 0042 not found; no gs_usb adapter is connected");
    assert_eq!(error(&[], ""), "no gs_usb adapter found");
}
