//! The panes: one file per pane and one line in the registry below. A pane stores only its own view state;
//! its data is in `Core`.

mod bus;
mod common;
mod detail;
mod effect;
mod events;
mod findings;
mod frames;
mod layout;
mod legend;
mod meaning;
mod nodes;
mod objects;
mod pane;
mod signals;
mod transfers;
mod why;

pub(crate) use common::last_world;
pub use effect::PaneRequest;
pub use findings::filtered_places;
pub use layout::{PaneArrangement, PaneLayout, PlacedPane, SPLIT};
pub use legend::{COMMON, LegendEntry, PaneLegend};
pub use pane::{OPTIONAL, Pane, Sorting};

macro_rules! panes {
    ($($id:ident $name:literal $title:literal $make:expr;)*) => {
        /// A pane of the user interface.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
        pub enum PaneId {
            $(#[doc = $title] #[value(name = $name)] $id,)*
        }

        impl PaneId {
            /// All panes in the order of their keys, from 0.
            pub const ALL: &[Self] = &[$(Self::$id),*];

            /// Name on the command line.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$id => $name,)* }
            }

            /// Title in the row of panes.
            pub const fn title(self) -> &'static str {
                match self { $(Self::$id => $title,)* }
            }
        }

        fn all() -> Vec<Box<dyn Pane>> {
            vec![$(Box::new($make)),*]
        }
    };
}

panes! {
    Why "why" "Why" why::WhyPane::default();
    Nodes "nodes" "Nodes" nodes::NodesPane::default();
    Events "events" "Events" events::EventsPane::default();
    Frames "frames" "Frames" frames::FramesPane::default();
    Detail "detail" "Detail" detail::DetailPane::default();
    Signals "signals" "Signals" signals::SignalsPane::default();
    Transfers "transfers" "Transfers" transfers::TransfersPane::default();
    Objects "objects" "Objects" objects::ObjectsPane::default();
    Findings "findings" "Findings" findings::FindingsPane::default();
    Bus "bus" "Bus" bus::BusPane::default();
}

/// The panes with their view state.
pub struct Panes(Vec<Box<dyn Pane>>);

impl Default for Panes {
    fn default() -> Self {
        Self(all())
    }
}

impl Panes {
    /// The pane `id`.
    pub fn get(&self, id: PaneId) -> Option<&dyn Pane> {
        self.0.get(id as usize).map(AsRef::as_ref)
    }

    /// The pane `id`, to change its view state.
    pub fn get_mut(&mut self, id: PaneId) -> Option<&mut Box<dyn Pane>> {
        self.0.get_mut(id as usize)
    }

    /// All panes, to change their view state.
    pub fn all_mut(&mut self) -> impl Iterator<Item = &mut Box<dyn Pane>> {
        self.0.iter_mut()
    }
}
