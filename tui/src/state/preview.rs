//! Frame and time of a position before the cursor moves there.

use cobscope_decoder::replay::EventPosition;

use super::place::Preview;
use super::{Core, JumpPlace};
use crate::timeline::{Matcher, Order, Target, Window};

impl Core {
    /// Requests the frame and time of a position, or shows the reason why there is none; `None` ends the
    /// preview.
    pub fn look_at(&mut self, place: Option<Result<JumpPlace, String>>) {
        self.preview = None;
        let target = match place {
            Some(Err(reason)) => {
                self.preview = Some(Preview { serial: 0, text: Some(reason) });
                return;
            }
            Some(Ok(JumpPlace::Time(time))) => Target::Time(time),
            Some(Ok(JumpPlace::Frame(frame))) => Target::Event(EventPosition::after(frame)),
            _ => return,
        };
        // The request for the window of the cursor is more important.
        if self.is_waiting() {
            return;
        }
        self.serial += 1;
        self.preview = Some(Preview { serial: self.serial, text: None });
        let (serial, matcher) = (self.serial, Matcher::default());
        self.timeline.order(Order { serial, target, before: 1, after: 0, matcher, search: None });
    }

    /// Frame and time of the position: `frame 1842, 371.204 s`.
    pub fn preview(&self) -> Option<String> {
        self.preview.as_ref()?.text.clone()
    }

    /// Whether a position is being looked up.
    pub fn is_previewing(&self) -> bool {
        self.preview.as_ref().is_some_and(|preview| preview.text.is_none())
    }

    /// Takes the window of a preview; `false` for other windows.
    pub(super) fn take_preview(&mut self, window: &Window) -> bool {
        let time = self.seconds(window.world.time());
        let Some(preview) = self.preview.as_mut().filter(|preview| preview.serial == window.serial) else {
            return false;
        };
        let time = time.map_or(String::new(), |time| format!(", {time:.3} s"));
        let state = if window.is_pending { ", not read yet" } else { "" };
        preview.text = Some(format!("frame {}{time}{state}", window.spot.frame));
        true
    }
}
