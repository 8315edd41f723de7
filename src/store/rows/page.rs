//! Pages of lists: newest first, by sequence number. A cursor is the sequence number of the last row of the page
//! before, with a digest of it and of the list. So a list takes only what it returned, and that also when the row was
//! deleted.

use futures::{Stream, TryStreamExt};
use sha2::{Digest, Sha256};

use crate::store::{PageRequest, StoreError, StoreResult, digest::hex};

/// Largest number of items of a page.
pub(in crate::store) const MOST: u32 = 500;
/// A page ends before its rows exceed this size, so that a response stays below 4 MiB.
const MOST_BYTES: usize = 3 << 20;
/// Bytes that a response adds to each row: links, times, progress.
const BYTES_PER_ROW: usize = 2 << 10;

/// The rows of one page.
pub(in crate::store) struct Window {
    /// Name of the list.
    list: String,
    /// Rows with a smaller sequence number belong to the page.
    pub(in crate::store) before: i64,
    /// Number of rows to read: one more than the page has, to find out whether there is a next page.
    pub(in crate::store) rows: i64,
}

impl Window {
    /// The window of a page of the list with this name. Pages of the same list may have different filters.
    pub(in crate::store) fn of(list: impl Into<String>, page: &PageRequest) -> StoreResult<Self> {
        let list = list.into();
        let key = page.cursor.as_ref().map(|cursor| key(&list, cursor)).transpose()?;
        let before = key.map_or(Ok(i64::MAX), |key| key.try_into().map_err(|_| StoreError::InvalidCursor))?;
        Ok(Self { list, before, rows: i64::from(page.limit.clamp(1, MOST)) + 1 })
    }

    /// Reads the rows of the page (at least one, if there is any) and returns the cursor of the next page. `measure`
    /// returns the sequence number and the size of a row. Rows after the page are not read.
    pub(in crate::store) async fn fill<R>(
        &self,
        mut rows: impl Stream<Item = Result<R, sqlx::Error>> + Unpin,
        measure: impl Fn(&R) -> (i64, usize),
    ) -> StoreResult<(Vec<R>, Option<String>)> {
        let full = usize::try_from(self.rows - 1).unwrap_or(usize::MAX);
        let (mut taken, mut bytes, mut last) = (Vec::new(), 0, 0_i64);
        while let Some(row) = rows.try_next().await? {
            let (seq, size) = measure(&row);
            bytes += size + BYTES_PER_ROW;
            if taken.len() == full || (bytes > MOST_BYTES && !taken.is_empty()) {
                return Ok((taken, Some(cursor(&self.list, u128::from(last.unsigned_abs())))));
            }
            last = seq;
            taken.push(row);
        }
        Ok((taken, None))
    }
}

/// The cursor after the row of a list with this key.
pub(in crate::store) fn cursor(list: &str, key: u128) -> String {
    let digest = Sha256::digest(format!("{key} of {list}"));
    format!("{key:x}-{}", hex(&digest[..8]))
}

/// The key in a cursor of a list.
pub(in crate::store) fn key(list: &str, text: &str) -> StoreResult<u128> {
    let key = text.split_once('-').and_then(|(key, _)| u128::from_str_radix(key, 16).ok());
    key.filter(|&key| cursor(list, key) == text).ok_or(StoreError::InvalidCursor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_takes_only_its_own_cursors_as_it_wrote_them() {
        for number in [1, 0xabc, i64::MAX as u128, u128::MAX] {
            let own = cursor("stacks", number);
            assert_eq!(key("stacks", &own).expect("its own"), number);
            let digest = own.split_once('-').expect("two parts").1;
            let others = [
                format!("{number:x}"),
                format!("0{own}"),
                format!("+{own}"),
                format!("{own} "),
                own.to_uppercase(),
                format!("{:x}-{digest}", number - 1),
                cursor("calibrations", number),
            ];
            for other in others.iter().filter(|other| **other != own).map(String::as_str).chain(["", "-", "abc"]) {
                assert!(matches!(key("stacks", other), Err(StoreError::InvalidCursor)), "{other}");
            }
        }
    }
}
