//! Options of a reading: devices, names, databases, rules.

use std::sync::Arc;

use super::error::ReadingError;
use super::part::ReadingPart;
use super::pass::Reading;
use crate::bus_file::BusFile;
use crate::capture::ReadOptions;
use crate::profile::dbc::{self, Database};
use crate::profile::{Catalogue, ProfileError};
use crate::rules::RuleSetup;
use crate::session::{AssignedBy, Assignment, ProtocolChoice, SessionOptions};
use crate::wire::NodeId;

impl Reading<()> {
    /// Options of a reading, to be completed by [`ReadingBuilder::build`].
    pub fn builder() -> ReadingBuilder {
        ReadingBuilder::default()
    }
}

/// Information about the buses that their frames do not contain; all options are optional, in any order.
///
/// ```
/// use cobscope_decoder::{NodeId, Reading};
///
/// let options = Reading::builder()
///     .bus_file("[bus.can0]\nbitrate = 250000\n[node.5]\nname = \"boom\"\n")
///     .device(NodeId::Canopen(2), "rexroth-sydfec");
/// let reading = options.build(())?;
/// # let _ = reading;
/// # Ok::<(), cobscope_decoder::ReadingError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct ReadingBuilder {
    read: ReadOptions,
    protocol: ProtocolChoice,
    bus_file: String,
    today: Option<String>,
    profiles: Vec<String>,
    devices: Vec<(Option<String>, NodeId, String)>,
    databases: Vec<Vec<u8>>,
    is_without_rules: bool,
}

impl ReadingBuilder {
    /// Text of a bus file (TOML): names, devices, identifiers, bit rates, expectations. Files that it refers
    /// to are not read: add them with [`Self::profile`] and [`Self::database`].
    #[must_use]
    pub fn bus_file(mut self, text: impl Into<String>) -> Self {
        self.bus_file = text.into();
        self
    }

    /// Current date such as `2026-01-31`, at which suppressions of the bus file expire; without it none
    /// expires.
    #[must_use]
    pub fn today(mut self, day: impl Into<String>) -> Self {
        self.today = Some(day.into());
        self
    }

    /// Text of a device profile (TOML), in addition to those of this crate; repeatable.
    #[must_use]
    pub fn profile(mut self, text: impl Into<String>) -> Self {
        self.profiles.push(text.into());
        self
    }

    /// Profile of a node on every bus, such as `wandfluh-md2` or `wandfluh-md2:controller`; overrides the bus
    /// file.
    #[must_use]
    pub fn device(mut self, node: NodeId, profile: impl Into<String>) -> Self {
        self.devices.push((None, node, profile.into()));
        self
    }

    /// Profile of a node on one bus.
    #[must_use]
    pub fn device_on(mut self, bus: impl Into<String>, node: NodeId, profile: impl Into<String>) -> Self {
        self.devices.push((Some(bus.into()), node, profile.into()));
        self
    }

    /// Content of a DBC file, or of pretty_j1939's JSON; repeatable. If several define a message, the first
    /// takes precedence.
    #[must_use]
    pub fn database(mut self, bytes: impl Into<Vec<u8>>) -> Self {
        self.databases.push(bytes.into());
        self
    }

    /// Protocol of the traffic; by default it is detected.
    #[must_use]
    pub fn protocol(mut self, protocol: ProtocolChoice) -> Self {
        self.protocol = protocol;
        self
    }

    /// Interpretation of ambiguous captures.
    #[must_use]
    pub fn read_options(mut self, options: ReadOptions) -> Self {
        self.read = options;
        self
    }

    /// Only decodes: emits no findings.
    #[must_use]
    pub fn without_rules(mut self) -> Self {
        self.is_without_rules = true;
        self
    }

    /// A reading of one capture with these options, whose events `part` receives.
    ///
    /// # Errors
    /// If a bus file, profile or database is invalid, or if a profile or rule is unknown.
    pub fn build<P: ReadingPart>(&self, part: P) -> Result<Reading<P>, ReadingError> {
        let bus_file = BusFile::parse(&self.bus_file).map_err(ReadingError::BusFile)?;
        let mut catalogue = Catalogue::default();
        for (place, text) in (1..).zip(&self.profiles) {
            catalogue.add_text(&format!("profile {place}"), text)?;
        }
        for (profile, rule, key, value) in bus_file.device_tolerances() {
            catalogue.set_tolerance(profile, rule, key, value);
        }
        let assignments = self.assignments(&bus_file, &mut catalogue)?;
        let setup = (!self.is_without_rules).then(|| self.setup(&bus_file, &catalogue)).transpose()?;
        let session = SessionOptions {
            protocol: self.protocol,
            assignments,
            database: Arc::new(self.joined_databases()?),
            catalogue: Arc::new(catalogue),
            bus_file,
            ..SessionOptions::default()
        };
        Ok(Reading::of_options(session, setup.map(Arc::new), part).with_read_options(self.read.clone()))
    }

    /// Devices of the bus file, then of the options: if a node is listed twice, the last entry wins.
    fn assignments(
        &self,
        bus_file: &BusFile,
        catalogue: &mut Catalogue,
    ) -> Result<Vec<Assignment>, ProfileError> {
        let of_file = bus_file.devices().map(|(bus, node, profile)| {
            (bus.map(str::to_owned), node, profile.text.as_str(), AssignedBy::BusFile)
        });
        let of_options = self
            .devices
            .iter()
            .map(|(bus, node, profile)| (bus.clone(), *node, profile.as_str(), AssignedBy::Option));
        let all = of_file.chain(of_options);
        all.map(|(bus, node, profile, by)| {
            Ok(Assignment { bus, node, device: catalogue.device(profile)?, by })
        })
        .collect()
    }

    fn setup(&self, bus_file: &BusFile, catalogue: &Catalogue) -> Result<RuleSetup, ReadingError> {
        let setup = RuleSetup::new(bus_file, &self.bus_file, self.today.clone());
        let setup = setup.map_err(ReadingError::BusFile)?;
        setup.check_devices(bus_file, &self.bus_file, catalogue).map_err(ReadingError::BusFile)?;
        Ok(setup)
    }

    fn joined_databases(&self) -> Result<Database, ReadingError> {
        let mut joined = Database::default();
        for bytes in &self.databases {
            joined.add_file(dbc::parse_database(bytes).map_err(ReadingError::Database)?);
        }
        Ok(joined)
    }
}
