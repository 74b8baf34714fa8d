//! The source with a listener that returns prepared readings.

use std::collections::VecDeque;

use cobscope_adapters::Disconnected;

use super::*;

/// Returns one list of readings per call, then nothing; then it is unplugged.
struct Prepared {
    readings: VecDeque<Vec<ReceivedItem>>,
    status: ControllerStatus,
}

impl ChannelListener for Prepared {
    fn read(&mut self, readings: &mut Vec<ReceivedItem>, _wait: Duration) -> Result<(), Disconnected> {
        readings.extend(self.readings.pop_front().ok_or_else(|| Disconnected("unplugged".into()))?);
        Ok(())
    }

    fn status(&mut self) -> Result<ControllerStatus, Disconnected> {
        Ok(self.status)
    }
}

fn adapter(readings: &[&[ReceivedItem]], status: ControllerStatus) -> Adapter {
    let readings = readings.iter().map(|readings| readings.to_vec()).collect();
    Adapter::new(Box::new(Prepared { readings, status }), 250_000)
}

const ACTIVE: ControllerStatus = ControllerStatus { confinement: FaultConfinement::Active, counters: None };

const RECEIVED: ReceivedFrame = ReceivedFrame {
    id: 0x181,
    is_extended: false,
    is_remote: false,
    length: 2,
    data: [1, 2, 3, 4, 5, 6, 7, 8],
    stamp: 1_000,
};

fn frames(items: &[Arrival]) -> Vec<Frame> {
    let frame = |item: &Arrival| match item {
        Arrival::Frame(frame) => *frame,
        Arrival::Notice(notice) => panic!("{notice:?}"),
    };
    items.iter().map(frame).collect()
}

#[test]
fn frames_keep_their_kind_and_their_distance() {
    let readings = [
        ReceivedItem::Frame(RECEIVED),
        ReceivedItem::Frame(ReceivedFrame {
            id: 0x18FE_F100,
            is_extended: true,
            length: 8,
            stamp: 1_250,
            ..RECEIVED
        }),
        ReceivedItem::Frame(ReceivedFrame { is_remote: true, length: 4, stamp: 1_375, ..RECEIVED }),
    ];
    let mut adapter = adapter(&[&readings], ACTIVE);
    let mut items = Vec::new();
    adapter.read(&mut items, Duration::ZERO).unwrap();
    let frames = frames(&items);
    assert_eq!((frames[0].id, frames[0].data()), (CanId::Standard(0x181), &[1, 2][..]));
    assert_eq!((frames[1].id, frames[1].data()), (CanId::Extended(0x18FE_F100), &RECEIVED.data[..]));
    assert_eq!((frames[2].flags, frames[2].length, frames[2].data()), (FrameFlags::REMOTE, 4, &[][..]));
    // All arrive together, so the last one cannot be later than the first, whose time is its arrival.
    assert!(frames.is_sorted_by_key(|frame| frame.time));
    assert_eq!(adapter.read(&mut items, Duration::ZERO), Err("unplugged".to_owned()));
}

#[test]
fn stamps_continue_after_their_restart() {
    let at = |stamp| ReceivedItem::Frame(ReceivedFrame { stamp, ..RECEIVED });
    let mut adapter = adapter(&[], ACTIVE);
    let mut time = |stamp, milliseconds: i64| {
        let arrival = Timestamp(1_700_000_000_000_000_000 + milliseconds * 1_000_000);
        match adapter.take(&at(stamp), arrival) {
            Some(Arrival::Frame(frame)) => frame.time.unwrap().0 - 1_700_000_000_000_000_000,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(time(u32::MAX - 999, 0), 0);
    assert_eq!(time(u32::MAX, 5), 999_000);
    assert_eq!(time(0, 6), 1_000_000);
    assert_eq!(time(4_000, 9), 5_000_000);
}

#[test]
fn states_errors_and_losses_are_reported() {
    let counters = Some(ErrorCounters { receive: 130, transmit: 0 });
    let status = ControllerStatus { confinement: FaultConfinement::Passive, counters };
    let error = BusError {
        violation: Some(ViolationKind::Checksum),
        is_transmitting: false,
        place: 0,
        counters: None,
        stamp: 1_000,
    };
    let readings = [ReceivedItem::Lost, ReceivedItem::Error(error), ReceivedItem::Invalid("length 9".into())];
    let mut adapter = adapter(&[&readings], status);
    let mut items = Vec::new();
    adapter.read(&mut items, Duration::ZERO).unwrap();
    let [lost, bus_error, invalid, state] = &items[..] else { panic!("{items:?}") };
    // linux/can/error.h: controller 004, protocol 008, bus error 080, counters 200; CRC sequence 08.
    let state = frames(std::slice::from_ref(state))[0];
    assert_eq!((state.id.number(), state.data()), (0x204, &[0, 0x10, 0, 0, 0, 0, 0, 130][..]));
    assert!(matches!(lost, Arrival::Notice(Notice::LostFrames { count: None, .. })));
    let bus_error = frames(std::slice::from_ref(bus_error))[0];
    assert_eq!((bus_error.id.number(), bus_error.data()), (0x088, &[0, 0, 0, 8, 0, 0, 0, 0][..]));
    assert!(matches!(invalid, Arrival::Notice(Notice::Unreadable { .. })));
    assert_eq!(adapter.controller_state().unwrap(), "error passive, rx 130 tx 0");
    assert_eq!(
        (adapter.lost_frames(), adapter.bit_rate(), adapter.timestamp_clock()),
        (1, Some(250_000), SourceClock::Adapter)
    );
}

/// The adapter reports the state itself; the state that is read afterwards adds no second frame.
#[test]
fn an_error_frame_of_the_adapter_is_passed_on_once() {
    let data = [0, 0x10, 0, 0, 0, 0, 0, 130];
    let error =
        AdapterErrorFrame { class: 0x204, data, confinement: Some(FaultConfinement::Passive), stamp: 1_000 };
    let status = ControllerStatus { confinement: FaultConfinement::Passive, counters: None };
    let mut adapter = adapter(&[&[ReceivedItem::ErrorFrame(error)]], status);
    let mut items = Vec::new();
    adapter.read(&mut items, Duration::ZERO).unwrap();
    let [frame] = frames(&items)[..] else { panic!("{items:?}") };
    assert_eq!(
        (frame.id, frame.flags, frame.data()),
        (CanId::from_extended(0x204), FrameFlags::ERROR, &data[..])
    );
    assert_eq!(adapter.controller_state().unwrap(), "error passive");
}
