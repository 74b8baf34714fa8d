//! SDO channels of a bus: pairs of identifiers with their server and client.

use crate::frame::CanId;
use crate::session::limits::CHANNEL_LIMIT;

/// A pair of identifiers between one client and one server.
#[derive(Debug, Clone)]
struct SdoChannel {
    request: CanId,
    response: CanId,
    server: u8,
    client: Option<u8>,
    /// Server parameter 0x1200..=0x127F that defines the channel.
    parameter: u16,
}

/// All channels of a bus; the number of a channel is its index in the list.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SdoChannels {
    list: Vec<SdoChannel>,
    has_refused: bool,
}

impl SdoChannels {
    /// Default channel of a node (0x600 and 0x580 + node-ID).
    pub(in crate::session) fn default_channel(&mut self, node: u8) -> Option<u16> {
        let id = |base: u16| CanId::from_standard(base + u16::from(node));
        self.add_channel(node, 0x1200, id(0x600), id(0x580), None)
    }

    /// Adds the channel of a server parameter, or replaces the identifiers of an existing one.
    pub(in crate::session) fn add_channel(
        &mut self,
        server: u8,
        parameter: u16,
        request: CanId,
        response: CanId,
        client: Option<u8>,
    ) -> Option<u16> {
        let known = self.list.iter().position(|it| (it.server, it.parameter) == (server, parameter));
        let index = match known {
            Some(index) => index,
            None if self.list.len() < CHANNEL_LIMIT => {
                self.list.push(SdoChannel { request, response, server, client, parameter });
                self.list.len() - 1
            }
            None => {
                self.has_refused = true;
                return None;
            }
        };
        let channel = self.list.get_mut(index)?;
        (channel.request, channel.response, channel.client) = (request, response, client);
        u16::try_from(index).ok()
    }

    /// Channel of a client parameter; an existing channel with the same identifiers is used.
    pub(in crate::session) fn of_client(
        &mut self,
        server: u8,
        parameter: u16,
        request: CanId,
        response: CanId,
        client: u8,
    ) -> Option<u16> {
        let same = |channel: &SdoChannel| (channel.request, channel.response) == (request, response);
        if let Some(index) = self.list.iter().position(same) {
            self.list.get_mut(index)?.client = Some(client);
            return u16::try_from(index).ok();
        }
        self.add_channel(server, parameter, request, response, Some(client))
    }

    fn get(&self, channel: u16) -> Option<&SdoChannel> {
        self.list.get(usize::from(channel))
    }

    /// Node-ID of the server.
    pub(in crate::session) fn server_node(&self, channel: u16) -> Option<u8> {
        self.get(channel).map(|channel| channel.server)
    }

    /// Node-ID of the client; `None` if not configured.
    pub(in crate::session) fn client_node(&self, channel: u16) -> Option<u8> {
        self.get(channel)?.client
    }

    /// Identifiers of request and response.
    pub(in crate::session) fn channel_ids(&self, channel: u16) -> Option<(CanId, CanId)> {
        self.get(channel).map(|channel| (channel.request, channel.response))
    }

    /// Whether a channel was rejected, because the table is full, since the last call.
    pub(in crate::session) fn take_refused(&mut self) -> bool {
        std::mem::take(&mut self.has_refused)
    }

    /// Bytes held by the table.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.list.capacity() * size_of::<SdoChannel>()
    }
}
