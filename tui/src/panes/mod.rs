//! The panes: each a file, and a line in the registry below. A pane keeps only what its user did in it; what it
//! shows comes from `Core`.

mod bus;
mod common;
mod detail;
mod effect;
mod events;
mod findings;
mod frames;
mod meaning;
mod nodes;
mod objects;
mod pane;
mod signals;
mod transfers;

pub use effect::Effect;
pub use pane::Pane;

macro_rules! panes {
    ($($id:ident $name:literal $title:literal $make:expr;)*) => {
        /// A pane by name.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
        pub enum PaneId {
            $(#[doc = $title] #[value(name = $name)] $id,)*
        }

        impl PaneId {
            /// All, in their order.
            pub const ALL: &[Self] = &[$(Self::$id),*];

            /// As the command line has it.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$id => $name,)* }
            }

            /// As it stands above it.
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

/// All panes.
pub struct Panes(Vec<Box<dyn Pane>>);

impl Default for Panes {
    fn default() -> Self {
        Self(all())
    }
}

impl Panes {
    /// A pane.
    pub fn get(&self, id: PaneId) -> Option<&dyn Pane> {
        self.0.get(id as usize).map(AsRef::as_ref)
    }

    /// A pane, to act on it.
    pub fn get_mut(&mut self, id: PaneId) -> Option<&mut Box<dyn Pane>> {
        self.0.get_mut(id as usize)
    }

    /// All of them.
    pub fn all_mut(&mut self) -> impl Iterator<Item = &mut Box<dyn Pane>> {
        self.0.iter_mut()
    }
}
