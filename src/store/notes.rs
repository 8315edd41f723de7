//! Notes about stacks, scans and profiles. They are deleted with what they are about.

use async_trait::async_trait;
use uuid::Uuid;

use super::StoreResult;
use crate::contract::{Name, Note};

/// What a note is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Subject {
    /// A stack.
    Stack(Uuid),
    /// A scan.
    Scan(Name),
    /// The profile of a rig and lens, with all its revisions.
    Profile(Name, Name),
}

/// A note that is to be stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewNote {
    /// Its id. A note with this id is stored once.
    pub id: Uuid,
    /// The text.
    pub text: String,
    /// Name of the token that wrote it.
    pub author: Option<Name>,
}

/// Result of storing a note.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AddNote {
    /// It is stored.
    Added(Note),
    /// There was one with this id, perhaps with another text.
    Repeated(Note),
    /// Its subject has as many notes as it may have.
    Full,
    /// Its subject does not exist.
    NoSubject,
}

/// Stores notes.
#[async_trait]
pub trait NoteStore: Send + Sync + 'static {
    /// Stores a note about `subject`, which then has at most `most` notes.
    async fn add_note(&self, subject: &Subject, note: &NewNote, most: usize) -> StoreResult<AddNote>;
    /// The notes about `subject`, the oldest first.
    async fn notes(&self, subject: &Subject) -> StoreResult<Vec<Note>>;
    /// Deletes a note about `subject`. False when there is none with this id.
    async fn delete_note(&self, subject: &Subject, id: Uuid) -> StoreResult<bool>;
}
