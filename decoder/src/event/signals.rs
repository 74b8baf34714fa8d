//! Values in the payload of an event.

use std::sync::Arc;

use super::{Event, EventKind};
use crate::profile::{DecodedSignal, PayloadLayout};

impl Event {
    /// Values of a PDO, of a J1939 message, or of a frame that a database describes. Empty for all other
    /// events, and if the layout of the payload is unknown.
    ///
    /// ```
    /// use cobscope_decoder::{Bus, Event, NodeId, Reading};
    ///
    /// // The status of a pump: TPDO1 of node 2.
    /// let capture = &b"(1700000000.0) can0 702#05\n(1700000000.1) can0 182#00000A00\n"[..];
    /// let mut lines = Vec::new();
    /// let add = |event: &Event, _: &Bus| {
    ///     lines.extend(event.decode_signals().map(|signal| format!("{:?} = {}", signal.name(), signal.text())));
    /// };
    /// let mut reading = Reading::builder().device(NodeId::Canopen(2), "rexroth-sydfec").build(add)?;
    /// reading.run(capture)?;
    /// # drop(reading);
    /// # let _ = lines;
    /// # Ok::<(), cobscope_decoder::ReadingError>(())
    /// ```
    pub fn decode_signals(&self) -> impl Iterator<Item = DecodedSignal<'_>> {
        self.laid_out().into_iter().flat_map(|(layout, payload)| layout.decode_signals(payload))
    }

    /// Layout and payload of the values in the event.
    pub(crate) fn laid_out(&self) -> Option<(&Arc<PayloadLayout>, &[u8])> {
        match &self.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => Some((pdo.layout.as_ref()?, pdo.payload())),
            EventKind::J1939Message(message) => Some((message.layout.as_ref()?, message.payload())),
            EventKind::J1939Transfer(transfer) => Some((transfer.layout.as_ref()?, transfer.data.as_ref())),
            EventKind::Frame(frame) => Some((&frame.message.as_ref()?.layout, frame.frame.data())),
            _ => None,
        }
    }
}
