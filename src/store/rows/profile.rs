//! Rows of profiles, and the revision that a draft becomes.

use std::fmt::Display;

use anyhow::Context;
use futures::Stream;
use serde::de::DeserializeOwned;

use super::{from_row::from_row, page::Window, time};
use crate::{
    contract::{Name, ProfileSummary, profile::Profile},
    store::{Page, ProfileDraft, Skipped, StoreResult, json},
};

/// The revision that a draft becomes.
pub(in crate::store) fn new_revision(
    rig: &Name,
    lens: &Name,
    revision: u32,
    draft: &ProfileDraft,
    now_ms: i64,
) -> StoreResult<Profile> {
    Ok(draft.clone().revision(rig.clone(), lens.clone(), revision, time(now_ms)?))
}

/// The body and the summary of a revision, as JSON.
pub(in crate::store) fn stored(profile: &Profile) -> StoreResult<(String, String)> {
    let summary = ProfileSummary::from(profile);
    Ok((
        json::stored::<Profile>("a profile", profile)?,
        json::stored::<ProfileSummary>("the summary of a profile", &summary)?,
    ))
}

/// The columns of `revisions` that lists read.
pub(in crate::store) struct RevisionRow {
    pub(in crate::store) seq: i64,
    pub(in crate::store) rig: String,
    pub(in crate::store) lens: String,
    pub(in crate::store) revision: i64,
    pub(in crate::store) json: String,
}

from_row!(RevisionRow { seq, rig, lens, revision, json });

impl RevisionRow {
    pub(in crate::store) fn label(&self) -> String {
        label(&self.rig, &self.lens, self.revision)
    }
}

/// How messages refer to a revision.
pub(in crate::store) fn label(rig: impl Display, lens: impl Display, revision: impl Display) -> String {
    format!("{rig}/{lens}?revision={revision}")
}

/// Parses a page of rows. Rows that cannot be read are listed as skipped.
pub(in crate::store) async fn parsed<T: DeserializeOwned + Send + 'static>(
    window: &Window,
    rows: impl Stream<Item = Result<RevisionRow, sqlx::Error>> + Unpin,
) -> StoreResult<Page<T>> {
    let (rows, next_cursor) = window.fill(rows, |row: &RevisionRow| (row.seq, row.json.len())).await?;
    let parsed = tokio::task::spawn_blocking(move || {
        Page::of_rows(rows, next_cursor, |row| {
            json::read(row.label(), &row.json).map_err(|error| Skipped::unreadable(row.label(), &error))
        })
    });
    Ok(parsed.await.context("the task that parses rows panicked")?)
}
