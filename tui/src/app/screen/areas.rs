//! Division of the screen.

use ratatui::layout::Rect;

/// Heights from which the line of the diagnosis, one line and two lines of the strip of time are shown.
const LOW: u16 = 10;
const STRIP_FROM: u16 = 12;
const LOAD_FROM: u16 = 20;

/// Areas of the screen.
pub(in crate::app) struct ScreenAreas {
    pub(in crate::app) header: Rect,
    pub(in crate::app) tabs: Rect,
    /// One line of the diagnosis; empty on low screens.
    pub(in crate::app) diagnosis: Rect,
    /// Strip of time; empty on low screens.
    pub(in crate::app) strip: Rect,
    pub(in crate::app) body: Rect,
    pub(in crate::app) status: Rect,
    pub(in crate::app) footer: Rect,
}

/// Divides the screen.
pub(in crate::app) fn divide_screen(area: Rect, has_strip: bool) -> ScreenAreas {
    let line = |y: u16| Rect { y: area.y + y.min(area.height), height: u16::from(y < area.height), ..area };
    let below = |from_end: u16| line(area.height.saturating_sub(from_end));
    let diagnosis = u16::from(area.height >= LOW);
    let strip = match area.height {
        _ if !has_strip => 0,
        ..STRIP_FROM => 0,
        STRIP_FROM..LOAD_FROM => 1,
        _ => 2,
    };
    let above = 2 + diagnosis + strip;
    ScreenAreas {
        header: line(0),
        tabs: line(1),
        diagnosis: if diagnosis > 0 { line(2) } else { Rect::ZERO },
        strip: Rect { y: area.y + 2 + diagnosis, height: strip, ..area },
        body: Rect {
            y: area.y + above.min(area.height),
            height: area.height.saturating_sub(above + 2),
            ..area
        },
        status: if area.height > 3 { below(2) } else { Rect::ZERO },
        footer: if area.height > 2 { below(1) } else { Rect::ZERO },
    }
}
