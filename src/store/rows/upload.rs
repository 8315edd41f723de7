//! Rows of resumable uploads.

use anyhow::Context;
use uuid::Uuid;

use super::{from_row::from_row, page, time, unsigned};
use crate::{
    contract::UploadPurpose,
    store::{
        Page, PageRequest, Skipped, StoreError, StoreResult, json,
        uploads::{OpenUpload, PartialUpload, UploadState},
    },
};

/// A row of `uploads`.
pub(in crate::store) struct UploadRow {
    id: Uuid,
    length: i64,
    received: i64,
    digest: Vec<u8>,
    metadata: String,
    job_kind: Option<String>,
    fault: Option<String>,
    wanted: i64,
    created_at: i64,
    expires_at: i64,
}

from_row!(UploadRow { id, length, received, digest, metadata, job_kind, fault, wanted, created_at, expires_at });

impl TryFrom<UploadRow> for PartialUpload {
    type Error = StoreError;

    fn try_from(row: UploadRow) -> StoreResult<Self> {
        let state = match (row.job_kind, row.fault) {
            (Some(name), _) => {
                let purpose = UploadPurpose::of_name(&name);
                UploadState::Complete(purpose.with_context(|| format!("a row contains the unknown purpose '{name}'"))?)
            }
            (None, Some(fault)) => {
                UploadState::Refused(json::read(format_args!("the row of upload {}", row.id), &fault)?)
            }
            (None, None) => UploadState::Receiving,
        };
        Ok(Self {
            id: row.id,
            length: unsigned(row.length),
            offset: unsigned(row.received),
            digest: row.digest,
            metadata: row.metadata,
            state,
            generation: row.wanted,
            created_at: time(row.created_at)?,
            expires_at: time(row.expires_at)?,
        })
    }
}

/// A row of `uploads` with the name of its token.
pub(in crate::store) struct OpenUploadRow {
    upload: UploadRow,
    last_byte_at: Option<i64>,
    token: Option<String>,
}

from_row!(OpenUploadRow, upload { last_byte_at, token });

impl TryFrom<OpenUploadRow> for OpenUpload {
    type Error = StoreError;

    fn try_from(row: OpenUploadRow) -> StoreResult<Self> {
        let last_byte_at = row.last_byte_at.map(time).transpose()?;
        Ok(Self { upload: row.upload.try_into()?, token: row.token, last_byte_at })
    }
}

/// Name of the list of open uploads.
const LIST: &str = "uploads";

/// The id before which a page of open uploads begins, and the number of rows to read: one more than the page has.
pub(in crate::store) fn open_uploads_window(page: &PageRequest) -> StoreResult<(Uuid, i64)> {
    // ids are UUIDv7: their order is that of their creation
    let before = match &page.cursor {
        None => Uuid::max(),
        Some(cursor) => Uuid::from_u128(page::key(LIST, cursor)?),
    };
    Ok((before, i64::from(page.limit.clamp(1, page::MOST)) + 1))
}

/// A page of open uploads, of at most `limit` rows. Rows that cannot be read are listed as skipped.
pub(in crate::store) fn listed(mut rows: Vec<OpenUploadRow>, limit: i64) -> Page<OpenUpload> {
    let full = usize::try_from(limit - 1).unwrap_or(usize::MAX);
    let more = rows.len() > full;
    rows.truncate(full);
    let next_cursor = rows.last().filter(|_| more).map(|row| page::cursor(LIST, row.upload.id.as_u128()));
    Page::of_rows(rows, next_cursor, |row| {
        let id = row.upload.id;
        OpenUpload::try_from(row).map_err(|error| Skipped::unreadable(id.to_string(), &error))
    })
}
