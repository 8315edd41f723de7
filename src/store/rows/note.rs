//! Rows of notes.

use uuid::Uuid;

use super::{from_row::from_row, name, time};
use crate::{
    contract::Note,
    store::{StoreError, StoreResult, notes::Subject},
};

/// A row of `notes`.
pub(in crate::store) struct NoteRow {
    id: Uuid,
    text: String,
    author: Option<String>,
    created_at: i64,
}

from_row!(NoteRow { id, text, author, created_at });

impl TryFrom<NoteRow> for Note {
    type Error = StoreError;

    fn try_from(row: NoteRow) -> StoreResult<Self> {
        let author = row.author.map(name).transpose()?;
        Ok(Self { id: row.id, text: row.text, author, created_at: time(row.created_at)? })
    }
}

impl Subject {
    /// The columns `stack`, `scan`, `rig` and `lens`.
    pub(in crate::store) fn columns(&self) -> (Option<Uuid>, Option<&str>, Option<&str>, Option<&str>) {
        match self {
            Self::Stack(id) => (Some(*id), None, None, None),
            Self::Scan(scan) => (None, Some(scan.as_str()), None, None),
            Self::Profile(rig, lens) => (None, None, Some(rig.as_str()), Some(lens.as_str())),
        }
    }
}
