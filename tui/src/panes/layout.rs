//! Layouts: the panes that are shown together, and their areas.
//!
//! ```text
//! one         diagnose, wide        diagnose, high     list, wide
//! ┌───────┐   Why     │ Nodes       Why                Events │ Detail
//! │ pane  │   Events  │ Detail      Events
//! └───────┘   Signals │ Findings    Detail
//! ```

use ratatui::layout::Rect;

use super::PaneId;

/// Width from which panes are shown next to each other.
const WIDE: u16 = 140;

/// Height of the terminal from which panes are shown below each other.
const HIGH: u16 = 40;

/// Minimum height of a pane with its title.
const LEAST_ROWS: u16 = 8;

/// Default share of the left column, in per cent.
pub const SPLIT: u16 = 58;

/// Step and limits of the share.
const SPLIT_STEP: u16 = 4;
const SPLIT_LIMITS: (u16, u16) = (30, 78);

/// Panes that are shown together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum PaneLayout {
    /// One pane
    One,
    /// Why, Events, Signals; Nodes, Detail, Findings
    Diagnose,
    /// Events and Detail
    List,
    /// Signals and Events; Nodes and Detail
    Signals,
}

/// Panes of a layout.
struct LayoutPlan {
    layout: PaneLayout,
    name: &'static str,
    /// Panes of the left and the right column.
    wide: [&'static [PaneId]; 2],
    /// Panes below each other in a narrow terminal, the least important last.
    narrow: &'static [PaneId],
    /// The pane whose place another pane takes that the layout does not contain.
    main: PaneId,
}

use PaneId::{Detail, Events, Findings, Nodes, Signals, Why};

/// All layouts in the order of the key.
const PLANS: [LayoutPlan; 4] = [
    LayoutPlan { layout: PaneLayout::One, name: "one", wide: [&[], &[]], narrow: &[], main: Events },
    LayoutPlan {
        layout: PaneLayout::Diagnose,
        name: "diagnose",
        wide: [&[Why, Events, Signals], &[Nodes, Detail, Findings]],
        narrow: &[Why, Events, Detail],
        main: Events,
    },
    LayoutPlan {
        layout: PaneLayout::List,
        name: "list",
        wide: [&[Events], &[Detail]],
        narrow: &[Events, Detail],
        main: Events,
    },
    LayoutPlan {
        layout: PaneLayout::Signals,
        name: "signals",
        wide: [&[Signals, Events], &[Nodes, Detail]],
        narrow: &[Signals, Events],
        main: Signals,
    },
];

/// A pane in its area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlacedPane {
    /// The pane.
    pub pane: PaneId,
    /// Line of the title; empty if the pane is alone.
    pub title: Rect,
    /// Area of the pane below its title.
    pub area: Rect,
}

/// The user's choice of panes.
#[derive(Debug, Clone)]
pub struct PaneArrangement {
    /// None: by the size of the terminal.
    pub chosen: Option<PaneLayout>,
    /// Only the focused pane is shown.
    pub is_zoomed: bool,
    /// Share of the left column, in per cent.
    split: u16,
    /// Pane in the place of the main pane.
    guest: Option<PaneId>,
}

impl PaneLayout {
    /// All layouts in the order of the key.
    pub const ALL: [Self; 4] = [Self::One, Self::Diagnose, Self::List, Self::Signals];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        PLANS.iter().find(|plan| plan.layout == self).map_or("", |plan| plan.name)
    }

    /// Panes of the left and the right column in a wide terminal.
    pub fn layout_columns(self) -> [&'static [PaneId]; 2] {
        self.layout_plan().map_or([&[], &[]], |plan| plan.wide)
    }

    /// Panes below each other in a narrow terminal.
    pub fn stacked_panes(self) -> &'static [PaneId] {
        self.layout_plan().map_or(&[], |plan| plan.narrow)
    }

    /// The pane whose place another one takes.
    pub fn main(self) -> PaneId {
        self.layout_plan().map_or(Events, |plan| plan.main)
    }

    fn layout_plan(self) -> Option<&'static LayoutPlan> {
        PLANS.iter().find(|plan| plan.layout == self)
    }

    /// The layout after this one.
    fn next(self) -> Self {
        let at = PLANS.iter().position(|plan| plan.layout == self).unwrap_or(0);
        PLANS.get((at + 1) % PLANS.len()).map_or(Self::One, |plan| plan.layout)
    }
}

impl PaneArrangement {
    /// A layout and the share of the left column in per cent; `None` chooses by default.
    pub fn new(chosen: Option<PaneLayout>, split: Option<u16>) -> Self {
        let (least, most) = SPLIT_LIMITS;
        Self { chosen, is_zoomed: false, split: split.unwrap_or(SPLIT).clamp(least, most), guest: None }
    }

    /// Share of the left column, in per cent.
    pub fn split_share(&self) -> u16 {
        self.split
    }

    /// The layout for a terminal of this size.
    pub fn layout_for(&self, terminal: Rect) -> PaneLayout {
        let is_large = terminal.width >= WIDE || terminal.height >= HIGH;
        self.chosen.unwrap_or(if is_large { PaneLayout::Diagnose } else { PaneLayout::One })
    }

    /// Chooses the next layout.
    pub fn next(&mut self, terminal: Rect) -> PaneLayout {
        let next = self.layout_for(terminal).next();
        (self.chosen, self.is_zoomed, self.guest) = (Some(next), false, None);
        next
    }

    /// Moves the border between the columns.
    pub fn move_split(&mut self, is_right: bool) {
        let (least, most) = SPLIT_LIMITS;
        let moved = if is_right { self.split + SPLIT_STEP } else { self.split.saturating_sub(SPLIT_STEP) };
        self.split = moved.clamp(least, most);
    }

    /// Panes that are shown. The focused one is among them: in its own cell or in that of the main pane.
    pub fn placed_panes(&self, focus: PaneId, terminal: Rect, body: Rect) -> Vec<PlacedPane> {
        let (main, mut cells) = self.plan_cells(terminal, body);
        if self.is_zoomed || cells.len() < 2 {
            return vec![PlacedPane { pane: focus, title: Rect::ZERO, area: body }];
        }
        let has = |pane: &PaneId| cells.iter().any(|cell| cell.pane == *pane);
        let guest = if has(&focus) { self.guest.filter(|guest| !has(guest)) } else { Some(focus) };
        let place = if focus == main { None } else { cells.iter().position(|cell| cell.pane == main) };
        if let Some((guest, cell)) = guest.zip(place.and_then(|at| cells.get_mut(at))) {
            cell.pane = guest;
        }
        cells
    }

    /// Keeps a pane visible that the layout does not contain, in the place of the main pane.
    pub fn focus_pane(&mut self, pane: PaneId, terminal: Rect, body: Rect) {
        let (main, cells) = self.plan_cells(terminal, body);
        if pane == main {
            self.guest = None;
        } else if !cells.iter().any(|cell| cell.pane == pane) {
            self.guest = Some(pane);
        }
    }

    /// The main pane and the cells of the layout. The main pane has a cell if there is any.
    fn plan_cells(&self, terminal: Rect, body: Rect) -> (PaneId, Vec<PlacedPane>) {
        let Some(plan) = self.layout_for(terminal).layout_plan() else { return (Events, Vec::new()) };
        let [left, right] = plan.wide;
        let cells = if terminal.width >= WIDE {
            let width = u32::from(body.width) * u32::from(self.split) / 100;
            let width = u16::try_from(width).unwrap_or(body.width).min(body.width);
            let beside = Rect { x: body.x + width + 1, width: body.width.saturating_sub(width + 1), ..body };
            let mut cells = stack_panes(left, Rect { width, ..body });
            cells.extend(stack_panes(right, beside));
            cells
        } else {
            stack_panes(plan.narrow, body)
        };
        let has_main = cells.iter().any(|cell| cell.pane == plan.main);
        (if has_main { plan.main } else { cells.first().map_or(plan.main, |cell| cell.pane) }, cells)
    }
}

/// Panes below each other; the last ones are left out if there is no room for all.
fn stack_panes(panes: &[PaneId], area: Rect) -> Vec<PlacedPane> {
    let count = panes.len().min(usize::from(area.height / LEAST_ROWS));
    let panes = panes.get(..count).unwrap_or_default();
    let (mut y, mut weights) = (area.y, panes.iter().map(|pane| pane_weight(*pane)).sum::<u16>());
    let mut cells = Vec::new();
    for (pane, behind) in panes.iter().zip((0..u16::try_from(count).unwrap_or(0)).rev()) {
        let rest = area.bottom().saturating_sub(y);
        // The panes behind keep their minimum.
        let most = rest.saturating_sub(behind * LEAST_ROWS);
        let share = u32::from(rest) * u32::from(pane_weight(*pane)) / u32::from(weights.max(1));
        let height = u16::try_from(share).unwrap_or(most).max(LEAST_ROWS).min(most);
        weights = weights.saturating_sub(pane_weight(*pane));
        let title = Rect { y, height: height.min(1), ..area };
        let inside = Rect { y: y.saturating_add(1), height: height.saturating_sub(1), ..area };
        cells.push(PlacedPane { pane: *pane, title, area: inside });
        y = y.saturating_add(height);
    }
    cells
}

/// Share of the height of a column.
const fn pane_weight(pane: PaneId) -> u16 {
    match pane {
        Why | Events | Detail => 4,
        _ => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(arrangement: &PaneArrangement, focus: PaneId, width: u16, height: u16) -> Vec<PaneId> {
        let terminal = Rect::new(0, 0, width, height);
        let body = Rect { y: 5, height: height.saturating_sub(7), ..terminal };
        let cells = arrangement.placed_panes(focus, terminal, body);
        for cell in &cells {
            assert!(cell.area.height + 1 >= LEAST_ROWS.min(body.height), "{cell:?}");
            assert_eq!(cell.area.intersection(body), cell.area, "{cell:?}");
        }
        cells.iter().map(|cell| cell.pane).collect()
    }

    #[test]
    fn the_size_of_the_terminal_decides_what_is_shown() {
        let any = PaneArrangement::new(None, None);
        assert_eq!(shown(&any, Events, 80, 24), [Events]);
        assert_eq!(shown(&any, Events, 139, 39), [Events]);
        assert_eq!(shown(&any, Events, 100, 40), [Why, Events, Detail]);
        assert_eq!(shown(&any, Events, 140, 24), [Why, Events, Nodes, Detail]);
        assert_eq!(shown(&any, Events, 200, 60), [Why, Events, Signals, Nodes, Detail, Findings]);
        // Without room for two panes a layout shows one.
        let list = PaneArrangement::new(Some(PaneLayout::List), None);
        assert_eq!(shown(&list, Events, 80, 20), [Events]);
        assert_eq!(shown(&list, Events, 80, 24), [Events, Detail]);
        assert_eq!(shown(&PaneArrangement::new(Some(PaneLayout::One), None), Nodes, 200, 60), [Nodes]);
    }

    #[test]
    fn another_pane_takes_the_place_of_the_main_one() {
        let (terminal, body) = (Rect::new(0, 0, 140, 24), Rect::new(0, 5, 140, 17));
        let mut any = PaneArrangement::new(None, None);
        any.focus_pane(PaneId::Bus, terminal, body);
        assert_eq!(shown(&any, PaneId::Bus, 140, 24), [Why, PaneId::Bus, Nodes, Detail]);
        any.focus_pane(Nodes, terminal, body);
        assert_eq!(shown(&any, Nodes, 140, 24), [Why, PaneId::Bus, Nodes, Detail]);
        any.focus_pane(Events, terminal, body);
        assert_eq!(shown(&any, Nodes, 140, 24), [Why, Events, Nodes, Detail]);
        any.is_zoomed = true;
        assert_eq!(shown(&any, Nodes, 140, 24), [Nodes]);
        assert_eq!(any.next(terminal), PaneLayout::List);
        assert_eq!(shown(&any, Nodes, 140, 24), [Nodes, Detail]);
    }

    #[test]
    fn the_split_has_limits() {
        let mut any = PaneArrangement::new(None, Some(99));
        assert_eq!(any.split_share(), 78);
        (0..40).for_each(|_| any.move_split(false));
        assert_eq!(any.split_share(), 30);
        any.move_split(true);
        assert_eq!(any.split_share(), 34);
    }
}
