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
pub use effect::Effect;
pub use findings::filtered_places;
pub use layout::{Arrangement, Cell, Layout, SPLIT};
pub use legend::{COMMON, Legend, LegendEntry};
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
    Why "why" "Why" why::Why::default();
    Nodes "nodes" "Nodes" nodes::Nodes::default();
    Events "events" "Events" events::Events::default();
    Frames "frames" "Frames" frames::Frames::default();
    Detail "detail" "Detail" detail::Detail::default();
    Signals "signals" "Signals" signals::Signals::default();
    Transfers "transfers" "Transfers" transfers::Transfers::default();
    Objects "objects" "Objects" objects::Objects::default();
    Findings "findings" "Findings" findings::Findings::default();
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
