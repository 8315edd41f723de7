//! Connected parts of a picture: runs and union-find, linear in the pixels, with memory for the runs alone.

use std::ops::Range;

use crate::imaging::Plane;

/// Which pixels are neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Connectivity {
    /// Those that share an edge.
    Four,
    /// Those that share an edge or a corner.
    Eight,
}

/// The connected parts of what is inside.
#[derive(Debug, Clone)]
pub(super) struct Parts {
    /// Columns of each run, row by row.
    runs: Vec<Range<usize>>,
    /// Per row: its runs.
    rows: Vec<Range<usize>>,
    parents: Vec<u32>,
}

impl Parts {
    /// Of the pixels of a `width` x `height` picture that are `inside`, asked by their place in it.
    pub(super) fn of(width: usize, height: usize, connectivity: Connectivity, inside: impl Fn(usize) -> bool) -> Self {
        let mut parts = Self { runs: Vec::new(), rows: Vec::with_capacity(height), parents: Vec::new() };
        let reach = if connectivity == Connectivity::Eight { 1 } else { 0 };
        for y in 0..height {
            let first = parts.runs.len();
            let mut x = 0;
            while let Some(start) = (x..width).find(|&x| inside(y * width + x)) {
                let end = (start..width).find(|&x| !inside(y * width + x)).unwrap_or(width);
                parts.runs.push(start..end);
                x = end;
            }
            parts.parents.extend(first as u32..parts.runs.len() as u32);
            if let Some(above) = parts.rows.last().cloned() {
                parts.join_rows(above, first..parts.runs.len(), reach);
            }
            parts.rows.push(first..parts.runs.len());
        }
        parts
    }

    /// What `look` notes of each part, run by run (row, columns). The answer is for [`Parts::visit`] and holds as many
    /// entries that no part has.
    pub(super) fn survey<T: Default + Clone>(&mut self, mut look: impl FnMut(&mut T, usize, &Range<usize>)) -> Vec<T> {
        let mut notes = vec![T::default(); self.runs.len()];
        for y in 0..self.rows.len() {
            for run in self.rows[y].clone() {
                let part = self.root(run as u32) as usize;
                look(&mut notes[part], y, &self.runs[run]);
            }
        }
        notes
    }

    /// Goes over the runs (row, columns) with what was noted of their part.
    pub(super) fn visit<T>(&mut self, notes: &[T], mut act: impl FnMut(&T, usize, &Range<usize>)) {
        for y in 0..self.rows.len() {
            for run in self.rows[y].clone() {
                let part = self.root(run as u32) as usize;
                act(&notes[part], y, &self.runs[run]);
            }
        }
    }

    /// Joins the runs of a row with those of the row above that they touch. Runs are in ascending order.
    fn join_rows(&mut self, above: Range<usize>, here: Range<usize>, reach: usize) {
        let mut upper = above.start;
        for lower in here {
            let run = self.runs[lower].clone();
            while upper < above.end && self.runs[upper].end + reach <= run.start {
                upper += 1;
            }
            let mut touching = upper;
            while touching < above.end && self.runs[touching].start < run.end + reach {
                self.join(touching as u32, lower as u32);
                touching += 1;
            }
        }
    }

    fn root(&mut self, mut node: u32) -> u32 {
        while self.parents[node as usize] != node {
            let grandparent = self.parents[self.parents[node as usize] as usize];
            self.parents[node as usize] = grandparent;
            node = grandparent;
        }
        node
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }
}

/// The pixels outside `mask` (0) that `may` be reached from it over edges and corners.
pub(super) fn reached(mask: &Plane<u8>, may: impl Fn(usize) -> bool) -> Vec<bool> {
    let (width, height) = (mask.width, mask.height);
    let mut reached = vec![false; mask.data.len()];
    let mut waiting: Vec<usize> = Vec::new();
    let around = |at: usize| {
        let (x, y) = (at % width, at / width);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        (y.saturating_sub(1)..(y + 2).min(height)).flat_map(move |v| columns.clone().map(move |u| v * width + u))
    };
    // what may be reached is little beside what it may be reached from
    for start in 0..mask.data.len() {
        let begins = mask.data[start] == 0 && !reached[start] && may(start);
        if begins && around(start).any(|beside| mask.data[beside] != 0) {
            reached[start] = true;
            waiting.push(start);
        }
        while let Some(at) = waiting.pop() {
            for next in around(at) {
                if mask.data[next] == 0 && !reached[next] && may(next) {
                    reached[next] = true;
                    waiting.push(next);
                }
            }
        }
    }
    reached
}
