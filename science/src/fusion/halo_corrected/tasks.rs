//! What is to be done to the pixels of a tile to take the veil off, in squares that are corrected in one go.

use std::collections::BTreeMap;

/// Side of the squares that are corrected in one go, px.
const BLOCK: usize = 128;

/// What is done to a pixel.
#[derive(Clone, Copy)]
pub(super) struct Task {
    /// Index within the tile.
    pub at: usize,
    pub kind: Kind,
}

/// What is known of a pixel.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    /// It is the far part's, and so much of the near part's veil is to be taken off it, 0 to 1.
    Veiled(f32),
    /// It may be either part's, and what is surely the far part's is so many px away.
    Either(f32),
}

/// Near part, far part, and the square of [`BLOCK`] px of a tile (down, across).
pub(super) type Key = (u16, u16, usize, usize);

/// Tasks of a tile, by what is done: a few pixels at opposite ends of a tile are no reason to blur all of it.
pub(super) struct Tasks {
    width: usize,
    all: BTreeMap<Key, Vec<Task>>,
    /// Those of the last key, which most often is the next one's too.
    last: (Key, Vec<Task>),
}

impl Tasks {
    /// Of a tile of `width` columns.
    pub(super) fn of(width: usize) -> Self {
        Self { width, all: BTreeMap::new(), last: ((0, 0, 0, 0), Vec::new()) }
    }

    pub(super) fn add(&mut self, near: u16, far: u16, task: Task) {
        let key = (near, far, task.at / self.width / BLOCK, task.at % self.width / BLOCK);
        if key != self.last.0 {
            self.put_away();
            self.last.0 = key;
        }
        self.last.1.push(task);
    }

    fn put_away(&mut self) {
        if !self.last.1.is_empty() {
            self.all.entry(self.last.0).or_default().append(&mut self.last.1);
        }
    }

    pub(super) fn finish(mut self) -> BTreeMap<Key, Vec<Task>> {
        self.put_away();
        self.all
    }
}
