//! Frames that are not decoded, counted by reason, for one note per reason.

use crate::words::count_noun;

/// Numbers of frames that are not decoded, by reason.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct OmittedFrames {
    /// On CANopen identifiers of a bus not detected as CANopen.
    pub(in crate::session) canopen: u64,
    /// With 29 bits on a bus not detected as J1939.
    pub(in crate::session) j1939: u64,
    /// On the identifier of TIME, which is not a clock.
    pub(in crate::session) time: u64,
    /// CAN FD on identifiers of a confirmed protocol.
    pub(in crate::session) fd: u64,
    /// Frames of NMEA 2000 fast packets, decoded one by one.
    pub(in crate::session) fast_packets: u64,
    /// With 29-bit identifiers over the limit of the table.
    pub(in crate::session) without_slot: u64,
}

impl OmittedFrames {
    /// Number of frames that were emitted undecoded.
    pub(in crate::session) fn undecoded_count(&self) -> u64 {
        let Self { canopen, j1939, time, fd, .. } = self;
        canopen.saturating_add(*j1939).saturating_add(*time).saturating_add(*fd)
    }

    /// One text per reason: number of frames, reason, and the option that changes it.
    pub(in crate::session) fn omission_texts(
        &self,
        canopen: Option<&str>,
        j1939: Option<&str>,
    ) -> Vec<String> {
        let unknown = "the protocol is not detected";
        let mut texts = Vec::new();
        let mut add = |count: u64, text: String| {
            if count > 0 {
                texts.push(format!("{}{text}", count_noun(count, "frame")));
            }
        };
        add(
            self.canopen,
            format!(
                " on CANopen identifiers not decoded: {}; --protocol canopen decodes all, --node N=PROFILE those of one node",
                canopen.unwrap_or(unknown)
            ),
        );
        add(
            self.j1939,
            format!(
                " with 29-bit identifier not decoded: {}; --protocol j1939 decodes all, --node sa:N=PROFILE those of one address",
                j1939.unwrap_or(unknown)
            ),
        );
        add(
            self.time,
            " on the identifier of TIME not decoded: not a clock; [[id]] with service = \"time\" decodes them".into(),
        );
        add(
            self.fd,
            " in CAN FD format not decoded: only classical CANopen and J1939 are; decode --frames prints them"
                .into(),
        );
        add(
            self.fast_packets,
            " of NMEA 2000 fast packets decoded one by one: no reassembly; --dbc describes their bytes"
                .into(),
        );
        add(
            self.without_slot,
            " with 29-bit identifiers over the limit of 4096 per bus: decoded without history; convert --filter splits the capture".into(),
        );
        texts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_text_per_reason_with_its_count() {
        let omissions = OmittedFrames { canopen: 1, fd: 1_200, ..OmittedFrames::default() };
        let texts = omissions.omission_texts(Some("no heartbeat"), None);
        assert_eq!(texts.len(), 2);
        assert!(
            texts[0]
                .starts_with("1 frame on CANopen identifiers not decoded: no heartbeat; --protocol canopen")
        );
        assert!(texts[1].starts_with("1200 frames in CAN FD"), "{texts:?}");
        assert!(OmittedFrames::default().omission_texts(None, None).is_empty());
    }
}
