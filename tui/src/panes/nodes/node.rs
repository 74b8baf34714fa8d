//! Rows of one node.

use cobscope_decoder::event::{BootCause, EffectiveState, StateCertainty};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::{ObjectRole as FieldRole, as_word, bit_words};
use cobscope_decoder::replay::{BootOccurrence, ErrorCode, LatestOfNode, ReplayState};
use cobscope_decoder::session::{Bus, GateState, GateStatus, LifeWatch, Node, OriginKind};
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::NmtState;

use super::line::{NodeGrade, NodeRow, NodeRowKey, StyledCell, format_age, format_limit, format_seconds};
use super::values::{SetActualValues, role_signals};
use crate::theme::TextRole;

/// A node with the data for its rows.
pub struct ShownNode<'a> {
    /// Bus of the node.
    pub bus: &'a Bus,
    /// State of the node at the cursor.
    pub node: &'a Node,
    /// Time at the cursor.
    pub now: Option<Timestamp>,
    /// Time of its last boot, errors and state changes.
    pub latest: Option<&'a LatestOfNode>,
    /// Identifiers of the node since its last boot.
    pub rows: Vec<&'a IdentifierRow>,
    gates: Vec<GateState>,
}

impl<'a> ShownNode<'a> {
    /// Collects the data of a node.
    pub fn new(world: &'a ReplayState, bus: &'a Bus, node: &'a Node, now: Option<Timestamp>) -> Self {
        let started = node.last_boot().map_or(0, |(frame, _)| frame);
        let rows = world.identifiers().rows().iter();
        let rows = rows.filter(|row| row.bus == bus.index() && row.last_frame > started && !row.is_remote);
        let is_own = |row: &&IdentifierRow| {
            row.node == Some(node.id())
                || bus.identifiers().awaited_message(row.id).is_some_and(|(id, _)| id == node.id())
        };
        Self {
            bus,
            node,
            now,
            latest: world.latest().latest_of(bus.index(), node.id()),
            rows: rows.filter(is_own).collect(),
            gates: bus.gates(node.id()),
        }
    }

    /// One row, or one row per output in use.
    pub fn node_rows(&self) -> Vec<NodeRow> {
        let channels = self.used_channels();
        if channels.is_empty() {
            return vec![self.node_row(None, true)];
        }
        let lines = channels.iter().enumerate();
        lines.map(|(nth, channel)| self.node_row(Some(*channel), nth == 0)).collect()
    }

    /// Outputs with a set point, or with an active or fault state.
    fn used_channels(&self) -> Vec<u8> {
        let mut all: Vec<u8> = self.node.set_points().filter_map(|point| point.meaning.channel).collect();
        let states = self.node.device_states().filter(|(_, state)| state.active || state.fault);
        all.extend(states.filter_map(|(channel, _)| channel));
        all.sort_unstable();
        all.dedup();
        all
    }

    fn node_row(&self, channel: Option<u8>, is_first: bool) -> NodeRow {
        let mut line = NodeRow::new(NodeRowKey::Node(self.bus.index(), self.node.id(), channel));
        if is_first {
            line.id = padded_number(self.node.id());
            line.name = self.node.name().map_or_else(String::new, |name| escape(name).into_owned());
            line.device = self.node.device_title().map_or_else(String::new, |it| escape(it).into_owned());
            line.nmt = self.nmt_cell();
            line.alive = self.life_cell();
            line.errors = self.errors_cell();
        } else {
            line.nmt = StyledCell::new("", TextRole::Quiet);
            line.alive = StyledCell::new("", TextRole::Quiet);
            line.errors = StyledCell::new("", TextRole::Quiet);
        }
        line.state = self.state_cell(channel);
        line.values = self.set_actual_values(channel);
        line.effective = self.effective_state(channel);
        if self.is_reset_held(channel) {
            // The Alive cell of the rows of further outputs is free.
            if is_first {
                line.values.remark = "R stuck".into();
            } else {
                line.alive = StyledCell::new("R stuck", TextRole::Bad);
            }
        } else if line.effective == Some(EffectiveState::No) && line.values.remark.is_empty() {
            line.values.remark =
                self.closed_gate(channel).map_or_else(String::new, |gate| format!("needs {gate}"));
        }
        line.grade = match () {
            () if line.errors.role == TextRole::Bad || line.state.role == TextRole::Bad => NodeGrade::Error,
            () if line.effective == Some(EffectiveState::No) => NodeGrade::NoEffect,
            () if line.alive.role == TextRole::Bad => NodeGrade::Silent,
            () => NodeGrade::Others,
        };
        line
    }

    fn nmt_cell(&self) -> StyledCell {
        let Some(nmt) = self.node.nmt() else {
            return match self.node.id() {
                NodeId::J1939(_) => StyledCell::new("J1939", TextRole::Quiet),
                NodeId::Canopen(_) => StyledCell::new("?", TextRole::Caution),
            };
        };
        let (word, role) = match nmt.state {
            NmtState::Operational => ("OPER", TextRole::Good),
            NmtState::PreOperational => ("PREOP", TextRole::Caution),
            NmtState::Stopped => ("STOP", TextRole::Caution),
            NmtState::Initialising => ("INIT", TextRole::Caution),
        };
        let doubt = if nmt.certainty == StateCertainty::Presumed { "?" } else { "" };
        StyledCell::new(format!("{word}{doubt}"), role)
    }

    /// Indices of the state machines of an output.
    fn machines_of(&self, channel: Option<u8>) -> impl Iterator<Item = usize> {
        let machines = self.node.device().machines.iter().enumerate();
        machines.filter(move |(_, it)| channel.is_none() || it.channel == channel).map(|(place, _)| place)
    }

    fn state_cell(&self, channel: Option<u8>) -> StyledCell {
        let procedures: Vec<_> =
            self.node.procedures().map(|it| it.word.clone().unwrap_or_else(|| it.name.clone())).collect();
        let reported =
            self.machines_of(channel).find_map(|place| Some((place, self.node.reported_state(place)?)));
        let Some((place, state)) = reported else {
            let text =
                procedures.first().cloned().or_else(|| self.status_text()).or_else(|| self.reboot_text());
            return text
                .map_or_else(StyledCell::default, |text| StyledCell::new(escape(&text), TextRole::Text));
        };
        let mut text = channel.map_or(String::new(), |channel| format!("c{channel} "));
        text.push_str(&state.name);
        if let Some(wanted) = self.node.commanded_state(place).filter(|wanted| wanted.name != state.name) {
            text = format!("{text}→{}", wanted.name);
        } else if let Some(mode) = self.mode_word() {
            text = format!("{text} {mode}");
        }
        for procedure in procedures {
            text = format!("{text}, {procedure}");
        }
        let role = match state {
            state if state.fault => TextRole::Bad,
            state if state.active => TextRole::Good,
            _ => TextRole::Text,
        };
        StyledCell::new(escape(&text), role)
    }

    /// First word of the mode that selects the PDO layout.
    fn mode_word(&self) -> Option<String> {
        let modes = self.node.store().sorted();
        let deciding = &self.node.device().deciding;
        let of_one = |object| {
            let meaning = self.node.meaning(object)?;
            let is_mode = meaning.role == Some(FieldRole::Mode) && deciding.contains(&object);
            let entry =
                self.node.store().seen_value(object).filter(|_| is_mode && meaning.channel.is_none())?;
            let label = meaning.value_label(&meaning.decode(&entry.value))?.to_owned();
            let (first, _) = label.split_once(',')?;
            Some(first.to_owned())
        };
        modes.into_iter().find_map(|(object, _)| of_one(object))
    }

    /// Text of the status word of a device without a state machine.
    fn status_text(&self) -> Option<String> {
        let mut words = Vec::new();
        for (signal, meaning) in role_signals(&self.rows, FieldRole::Status) {
            let named = meaning.bits.as_deref().zip(as_word(&signal.value));
            words.extend(named.map_or_else(Vec::new, |(bits, word)| bit_words(bits, word)));
        }
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// Whether the node rebooted without a command after it had been seen.
    fn reboot_text(&self) -> Option<String> {
        let start = self.latest?.last_boot()?;
        let is_again = (1..start.frame).contains(&self.node.first_seen());
        let is_own = matches!(start.cause, BootCause::PresumedPowerOn { .. });
        (is_again && is_own).then(|| "rebooted".to_owned())
    }

    /// Settings lost at the last boot, and how many were written again.
    pub fn lost_settings(&self) -> Option<(u32, usize)> {
        let BootOccurrence { frame, lost, .. } = self.latest?.last_boot()?;
        let all = self.node.store().sorted();
        let again = all
            .iter()
            .filter(|(_, entry)| entry.origin.kind == OriginKind::Download && entry.origin.frame > frame);
        let again = again.count();
        (usize::try_from(lost).unwrap_or(usize::MAX) > again).then_some((lost, again))
    }

    fn set_actual_values(&self, channel: Option<u8>) -> SetActualValues {
        let mut values = SetActualValues::values_of(self.node, channel, &self.rows);
        if let Some((lost, again)) = self.lost_settings() {
            let again = if again == 0 { String::new() } else { format!(", {again} written again") };
            values.remark = format!("{lost} SDO settings lost (RAM){again}");
            values.brief = format!("{lost} settings lost");
        }
        values
    }

    /// Gates of the set points of an output.
    pub fn gates_of(&self, channel: Option<u8>) -> impl Iterator<Item = &GateState> {
        let points = self.node.set_points().filter(move |point| {
            channel.is_none() || point.meaning.channel.is_none() || point.meaning.channel == channel
        });
        let objects: Vec<_> = points.map(|point| point.meaning.object).collect();
        self.gates.iter().filter(move |gate| objects.contains(&gate.set_point))
    }

    fn effective_state(&self, channel: Option<u8>) -> Option<EffectiveState> {
        let Some(any) = self.node.set_points().next() else {
            return self.lost_settings().map(|_| EffectiveState::No);
        };
        let has = |status| self.gates_of(channel).any(|gate| gate.status == status);
        Some(match () {
            () if has(GateStatus::Closed) => EffectiveState::No,
            () if self.gates_of(channel).next().is_none() => any.effective,
            () if has(GateStatus::Unknown) => EffectiveState::Unknown,
            () => EffectiveState::Yes,
        })
    }

    fn closed_gate(&self, channel: Option<u8>) -> Option<String> {
        let gate = self.gates_of(channel).find(|gate| gate.status == GateStatus::Closed)?;
        Some(escape(&gate.gate).into_owned())
    }

    fn is_reset_held(&self, channel: Option<u8>) -> bool {
        self.machines_of(channel).any(|place| self.node.is_reset_held(place, self.bus.now()))
    }

    fn life_cell(&self) -> StyledCell {
        let Some(sign) = self.bus.sign_of_life(self.node.id()) else {
            return StyledCell::new("never", TextRole::Caution);
        };
        let Some(past) = self.time_ago(self.bus.stamp_of(sign.last)) else { return StyledCell::default() };
        let expected = sign.expected.map_or(String::new(), |expected| format!("/{}", format_limit(expected)));
        let text = match &sign.by {
            LifeWatch::Heartbeat => format!("HB {}{expected}", format_seconds(past)),
            LifeWatch::Guarding => format!("GD {}{expected}", format_seconds(past)),
            LifeWatch::Message(name) => {
                let short = |text: &str| text.strip_prefix('0').unwrap_or(text).to_owned();
                let expected =
                    sign.expected.map_or(String::new(), |it| format!("/{}", short(&format_limit(it))));
                format!("{} {}{expected}", escape(name), short(&format_seconds(past)))
            }
            LifeWatch::Boot => format!("boot {}", format_seconds(past)),
            LifeWatch::Any => format!("rx {}", format_seconds(past)),
        };
        let is_past = |limit: Option<i64>| limit.is_some_and(|limit| past > limit);
        let role = match () {
            () if self.node.is_lost() || is_past(sign.limit) => TextRole::Bad,
            // Late, but below the limit for node-lost.
            () if is_past(sign.expected.map(|expected| expected.saturating_mul(3) / 2)) => TextRole::Caution,
            () => TextRole::Text,
        };
        StyledCell::new(text, role)
    }

    /// Nanoseconds from a time to the cursor.
    pub fn time_ago(&self, time: Option<Timestamp>) -> Option<i64> {
        Some(self.now?.since(time?))
    }

    fn errors_cell(&self) -> StyledCell {
        let codes =
            self.node.active_errors().iter().map(|code| (ErrorCode::Emcy(*code), format!("{code:04X}")));
        let dtcs = self.node.active_dtcs();
        let dtcs = dtcs.map(|(spn, fmi)| (ErrorCode::Dtc(spn, fmi), format!("{spn}/{fmi}")));
        // Latest first: there may be room for only one.
        let mut all: Vec<_> = codes.chain(dtcs).collect();
        all.reverse();
        let mut words = Vec::new();
        for (code, name) in &all {
            let past = self.time_ago(self.latest.and_then(|latest| latest.raised_at(*code)));
            words.push(past.map_or(name.clone(), |past| format!("{name} {}", format_age(past))));
        }
        if let Some((lost, _)) = self.lost_settings() {
            words.push(format!("{lost} lost"));
        }
        if words.is_empty() {
            StyledCell::default()
        } else {
            StyledCell::new(words.join(", "), TextRole::Bad)
        }
    }
}

/// `  1 01`, `SA 80`.
pub fn padded_number(id: NodeId) -> String {
    match id {
        NodeId::Canopen(id) => format!("{id} {id:02X}"),
        NodeId::J1939(address) => format!("SA {address:02X}"),
    }
}
