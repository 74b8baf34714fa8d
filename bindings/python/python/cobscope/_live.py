"""Decoding of live frames, also as a listener of python-can."""

from ._cobscope import Decoder as _Decoder
from ._options import words


class Decoder(_Decoder):
    """Decodes frames of live buses in the order of time.

        decoder = cobscope.Decoder(node={2: "rexroth-sydfec"}, on_event=print)
        notifier = can.Notifier(bus, [decoder])

    Options are those of `open` that do not concern files of captures. Events and values wait until `events()` and
    `signals()` fetch them, a million rows of each at most. `on_event` is called with each event, as a dictionary, on the thread
    that calls `push`, `advance` or `finish`; `events()` then has none of them.
    """

    def __new__(cls, *, on_event=None, **options):
        self = super().__new__(cls, words(None, options))
        self.on_event = on_event
        return self

    def on_message_received(self, message):
        """Decodes a message of python-can."""
        channel = message.channel
        self.push(
            message.timestamp,
            message.arbitration_id,
            bytes(message.data or b""),
            bus="can0" if channel is None else str(channel),
            extended=message.is_extended_id,
            remote=message.is_remote_frame,
            error=message.is_error_frame,
            fd=message.is_fd,
            brs=message.bitrate_switch,
            esi=message.error_state_indicator,
            transmitted=not message.is_rx,
            length=message.dlc if message.is_remote_frame else None,
        )

    __call__ = on_message_received

    def push(self, *frame, **options):
        super().push(*frame, **options)
        self._deliver()

    def advance(self, timestamp):
        super().advance(timestamp)
        self._deliver()

    def finish(self):
        findings = super().finish()
        self._deliver()
        return findings

    push.__doc__, advance.__doc__, finish.__doc__ = _Decoder.push.__doc__, _Decoder.advance.__doc__, _Decoder.finish.__doc__

    def _deliver(self):
        if self.on_event is not None:
            for event in self.events():
                self.on_event(event)

    def on_error(self, error):
        """Errors of the bus are left to python-can."""
        raise error

    def stop(self):
        """Called by python-can's Notifier at its end. The decoder can be used further; `finish()` returns the findings."""
