//! Pages of lists: newest first, by the sequence number of the row.

use super::{Page, PageRequest, StoreError, StoreResult};

/// Most items of a page.
const MOST: u32 = 500;

/// Where a page begins and how many rows to read.
pub(super) struct Window {
    /// Rows with a smaller sequence number belong to the page.
    pub(super) before: i64,
    /// One more than the page holds: its presence says that there is another page.
    pub(super) rows: i64,
}

impl Window {
    pub(super) fn of(page: &PageRequest) -> StoreResult<Self> {
        let before = match &page.cursor {
            None => i64::MAX,
            Some(cursor) => i64::from_str_radix(cursor, 16).ok().filter(|seq| *seq > 0).ok_or(StoreError::BadCursor)?,
        };
        Ok(Self { before, rows: i64::from(page.limit.clamp(1, MOST)) + 1 })
    }

    /// The page made of the rows read, each with its sequence number.
    pub(super) fn page<T>(&self, mut rows: Vec<(i64, T)>) -> Page<T> {
        let full = usize::try_from(self.rows - 1).unwrap_or(usize::MAX);
        let more = rows.len() > full;
        rows.truncate(full);
        let last = rows.last().map(|(seq, _)| *seq);
        let next_cursor = last.filter(|_| more).map(|seq| format!("{seq:016x}"));
        Page { items: rows.into_iter().map(|(_, item)| item).collect(), next_cursor }
    }
}
