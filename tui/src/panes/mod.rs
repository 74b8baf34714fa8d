//! The panes: each a file, and a line in the registry below. A pane keeps only what its user did in it; what it
//! shows comes from [`Core`].

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
mod signals;
mod transfers;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

pub use effect::Effect;

use crate::action::Action;
use crate::state::Core;

/// One view of the captures.
pub trait Pane {
    /// Draws it.
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer);

    /// Does what the user wants in it.
    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect>;

    /// The mouse was pressed at a place of `area`, which is what [`Pane::render`] was given; twice in a row
    /// means [`Action::Open`] too.
    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect>;

    /// The cursor moved, or more is known: time to look after selections.
    fn refresh(&mut self, _core: &Core) {}

    /// Something another pane, or the application, offers to all.
    fn offer(&mut self, _effect: &Effect, _core: &Core) {}

    /// Takes what is typed behind `/`, with each letter; `false`: it is for the events.
    fn search(&mut self, _text: &str, _core: &Core) -> bool {
        false
    }

    /// What of it can be done with keys, for the line at the bottom.
    fn actions(&self) -> &'static [Action];

    /// The filter that shows only what has the value of the selected cell.
    fn filter_of_cell(&self, _core: &Core) -> Option<String> {
        None
    }

    /// The selected line as text.
    fn line(&self, core: &Core) -> Option<String>;
}

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
