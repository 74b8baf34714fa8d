//! Number of rows per block of frames: finds a row without an index of every row.
//!
//! ```text
//! frames  0 ── 1,024 ── 2,048 ── 3,072        row 2,500 ▸ block 2, after 2,310 rows
//! rows    │ 1,100 │ 1,210 │  980 │
//! ```

/// Frames per block.
pub const BLOCK_FRAMES: u64 = 1024;

/// Number of rows per block of frames.
#[derive(Debug, Clone, Default)]
pub struct BlockRowCounts {
    blocks: Vec<u32>,
    total: u64,
}

impl BlockRowCounts {
    /// Counts a row at a frame; frames are in order.
    pub fn count_row(&mut self, frame: u64) {
        let Ok(block) = usize::try_from(frame / BLOCK_FRAMES) else { return };
        if self.blocks.len() <= block {
            self.blocks.resize(block.saturating_add(1), 0);
        }
        if let Some(count) = self.blocks.get_mut(block) {
            *count = count.saturating_add(1);
            self.total = self.total.saturating_add(1);
        }
    }

    /// Number of rows.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// First frame of the block that contains a row, and the number of rows before that block.
    pub fn block_of_row(&self, row: u64) -> (u64, u64) {
        let mut before = 0_u64;
        for (block, count) in (0_u64..).zip(&self.blocks) {
            let next = before.saturating_add(u64::from(*count));
            if row < next {
                return (block.saturating_mul(BLOCK_FRAMES), before);
            }
            before = next;
        }
        ((self.blocks.len() as u64).saturating_mul(BLOCK_FRAMES), before)
    }

    /// First frame of the block that contains a frame, and the number of rows before that block.
    pub fn block_of_frame(&self, frame: u64) -> (u64, u64) {
        let block = frame / BLOCK_FRAMES;
        let count = usize::try_from(block).unwrap_or(usize::MAX);
        let rows = self.blocks.iter().take(count).map(|count| u64::from(*count)).sum();
        (block.saturating_mul(BLOCK_FRAMES), rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_in_the_block_after_all_rows_before_it() {
        let mut counts = BlockRowCounts::default();
        for frame in [1, 1, 1023, 5000, 5001] {
            counts.count_row(frame);
        }
        assert_eq!(counts.total(), 5);
        assert_eq!(counts.block_of_row(0), (0, 0));
        assert_eq!(counts.block_of_row(2), (0, 0));
        assert_eq!(counts.block_of_row(3), (4096, 3));
        assert_eq!(counts.block_of_row(5), (5120, 5), "after the last row");
        assert_eq!(counts.block_of_frame(5001), (4096, 3));
        assert_eq!(counts.block_of_frame(3000), (2048, 3));
    }
}
