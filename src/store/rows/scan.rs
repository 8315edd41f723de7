//! Rows of scans.

use super::{from_row::from_row, name, time};
use crate::{
    contract::Scan,
    store::{Page, Skipped, StoreError, StoreResult, json},
};

/// A row of `scans`.
pub(in crate::store) struct ScanRow {
    pub(in crate::store) seq: i64,
    pub(in crate::store) name: String,
    pub(in crate::store) body: String,
    version: i64,
    created_at: i64,
    updated_at: i64,
}

from_row!(ScanRow { seq, name, body, version, created_at, updated_at });

impl TryFrom<ScanRow> for Scan {
    type Error = StoreError;

    fn try_from(row: ScanRow) -> StoreResult<Self> {
        let label = format!("the row of scan {}", row.name);
        Ok(Self {
            name: name(row.name)?,
            input: json::read(label, &row.body)?,
            version: u32::try_from(row.version).unwrap_or(u32::MAX),
            created_at: time(row.created_at)?,
            updated_at: time(row.updated_at)?,
        })
    }
}

/// A page of scans. Rows that cannot be read are listed as skipped.
pub(in crate::store) fn listed(rows: Vec<ScanRow>, next_cursor: Option<String>) -> Page<Scan> {
    Page::of_rows(rows, next_cursor, |row| {
        let name = row.name.clone();
        Scan::try_from(row).map_err(|error| Skipped::unreadable(name, &error))
    })
}
