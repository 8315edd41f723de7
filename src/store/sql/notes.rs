//! Notes.

use async_trait::async_trait;
use sqlx::Executor;
use uuid::Uuid;

use super::engine::{Connection, Db, Metadata, dialect};
use crate::{
    contract::{Name, Note},
    store::{
        StoreResult,
        notes::{AddNote, NewNote, NoteStore, Subject},
        rows::{note::NoteRow, transaction::Notice},
    },
};

#[async_trait]
impl NoteStore for Metadata {
    async fn add_note(&self, subject: &Subject, note: &NewNote, most: usize) -> StoreResult<AddNote> {
        let mut tx = self.write().await?;
        // its row is locked: the number of its notes stays as it is
        if !lock(&mut tx, subject).await? {
            return Ok(AddNote::NoSubject);
        }
        let notes = of_subject(&mut *tx, subject).await?;
        if let Some(earlier) = notes.iter().find(|earlier| earlier.id == note.id) {
            return Ok(AddNote::Repeated(earlier.clone()));
        }
        if notes.len() >= most {
            return Ok(AddNote::Full);
        }
        let now = self.now(&mut *tx).await?;
        let (stack, scan, rig, lens) = subject.columns();
        let row: NoteRow = sqlx::query_as(
            "INSERT INTO notes (stack, scan, rig, lens, id, text, author, created_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8) RETURNING id, text, author, created_at",
        )
        .bind(stack)
        .bind(scan)
        .bind(rig)
        .bind(lens)
        .bind(note.id)
        .bind(&note.text)
        .bind(note.author.as_ref().map(Name::as_str))
        .bind(now)
        .fetch_one(&mut *tx)
        .await?;
        self.commit(tx, "rows.add_note", Notice::None).await?;
        Ok(AddNote::Added(row.try_into()?))
    }

    async fn notes(&self, subject: &Subject) -> StoreResult<Vec<Note>> {
        of_subject(self.reading(), subject).await
    }

    async fn delete_note(&self, subject: &Subject, id: Uuid) -> StoreResult<bool> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let (stack, scan, rig, lens) = subject.columns();
            let deleted = sqlx::query(
                "DELETE FROM notes WHERE id = $5 AND (stack = $1 OR scan = $2 OR (rig = $3 AND lens = $4))",
            )
            .bind(stack)
            .bind(scan)
            .bind(rig)
            .bind(lens)
            .bind(id)
            .execute(&mut *tx)
            .await?;
            self.commit(tx, "rows.delete_note", Notice::None).await?;
            Ok(deleted.rows_affected() == 1)
        })
        .await
    }
}

/// The notes about a subject, the oldest first.
async fn of_subject(executor: impl Executor<'_, Database = Db>, subject: &Subject) -> StoreResult<Vec<Note>> {
    let notes = sqlx::query_as(
        "SELECT id, text, author, created_at FROM notes
         WHERE stack = $1 OR scan = $2 OR (rig = $3 AND lens = $4) ORDER BY seq",
    );
    let (stack, scan, rig, lens) = subject.columns();
    let rows: Vec<NoteRow> = notes.bind(stack).bind(scan).bind(rig).bind(lens).fetch_all(executor).await?;
    rows.into_iter().map(Note::try_from).collect()
}

/// Locks the row of a subject. False when it does not exist.
async fn lock(connection: &mut Connection, subject: &Subject) -> StoreResult<bool> {
    let found: Option<i64> = match subject {
        Subject::Stack(id) => {
            let found = sqlx::query_scalar(concat!(
                "SELECT seq FROM jobs WHERE id = $1 AND kind = 'stack' AND NOT delete_requested",
                dialect!(FOR UPDATE)
            ));
            found.bind(id).fetch_optional(connection).await?
        }
        Subject::Scan(scan) => {
            let found = sqlx::query_scalar(concat!("SELECT seq FROM scans WHERE name = $1", dialect!(FOR UPDATE)));
            found.bind(scan.as_str()).fetch_optional(connection).await?
        }
        Subject::Profile(rig, lens) => {
            let found = sqlx::query_scalar(concat!(
                "SELECT current_revision FROM profiles WHERE rig = $1 AND lens = $2 AND current_revision IS NOT NULL",
                dialect!(FOR UPDATE)
            ));
            found.bind(rig.as_str()).bind(lens.as_str()).fetch_optional(connection).await?
        }
    };
    Ok(found.is_some())
}
