//! Pages of lists: newest first, by sequence number. A cursor is the sequence number of the last row of the page
//! before.

use futures::{Stream, TryStreamExt};

use crate::store::{PageRequest, StoreError, StoreResult};

/// Largest number of items of a page.
pub(in crate::store) const MOST: u32 = 500;
/// A page ends before its rows exceed this size, so that a response stays below 4 MiB.
const MOST_BYTES: usize = 3 << 20;
/// Bytes that a response adds to each row: links, times, progress.
const BYTES_PER_ROW: usize = 2 << 10;

/// The rows of one page.
pub(in crate::store) struct Window {
    /// Rows with a smaller sequence number belong to the page.
    pub(in crate::store) before: i64,
    /// Number of rows to read: one more than the page has, to find out whether there is a next page.
    pub(in crate::store) rows: i64,
}

impl Window {
    pub(in crate::store) fn of(page: &PageRequest) -> StoreResult<Self> {
        let before = match &page.cursor {
            None => i64::MAX,
            Some(cursor) => {
                i64::from_str_radix(cursor, 16).ok().filter(|seq| *seq > 0).ok_or(StoreError::InvalidCursor)?
            }
        };
        Ok(Self { before, rows: i64::from(page.limit.clamp(1, MOST)) + 1 })
    }

    /// Reads the rows of the page (at least one, if there is any) and returns the cursor of the next page. `measure`
    /// returns the sequence number and the size of a row. Rows after the page are not read.
    pub(in crate::store) async fn fill<R>(
        &self,
        mut rows: impl Stream<Item = Result<R, sqlx::Error>> + Unpin,
        measure: impl Fn(&R) -> (i64, usize),
    ) -> StoreResult<(Vec<R>, Option<String>)> {
        let full = usize::try_from(self.rows - 1).unwrap_or(usize::MAX);
        let (mut taken, mut bytes, mut last) = (Vec::new(), 0, 0);
        while let Some(row) = rows.try_next().await? {
            let (seq, size) = measure(&row);
            bytes += size + BYTES_PER_ROW;
            if taken.len() == full || (bytes > MOST_BYTES && !taken.is_empty()) {
                return Ok((taken, Some(format!("{last:016x}"))));
            }
            last = seq;
            taken.push(row);
        }
        Ok((taken, None))
    }
}
