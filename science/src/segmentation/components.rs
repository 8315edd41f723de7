//! Connected components of a binary picture, by runs and union-find: time linear in the pixels, memory for the runs
//! alone.

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

/// The connected components of a set of pixels.
#[derive(Debug, Clone)]
pub(super) struct Components {
    /// Columns of each run, row by row.
    runs: Vec<Range<usize>>,
    /// Per row: its runs.
    rows: Vec<Range<usize>>,
    parents: Vec<u32>,
}

impl Components {
    /// Those of the pixels of a `width` x `height` picture for whose index `inside` is true.
    pub(super) fn of(width: usize, height: usize, connectivity: Connectivity, inside: impl Fn(usize) -> bool) -> Self {
        let mut components = Self { runs: Vec::new(), rows: Vec::with_capacity(height), parents: Vec::new() };
        let reach = if connectivity == Connectivity::Eight { 1 } else { 0 };
        for y in 0..height {
            let first = components.runs.len();
            let mut x = 0;
            while let Some(start) = (x..width).find(|&x| inside(y * width + x)) {
                let end = (start..width).find(|&x| !inside(y * width + x)).unwrap_or(width);
                components.runs.push(start..end);
                x = end;
            }
            components.parents.extend(first as u32..components.runs.len() as u32);
            if let Some(above) = components.rows.last().cloned() {
                components.join_rows(above, first..components.runs.len(), reach);
            }
            components.rows.push(first..components.runs.len());
        }
        components
    }

    /// Accumulates a value per component: `add` is called with each run (row, columns). The result, for
    /// [`Components::for_each_run`], has one entry per run; entries that belong to no component keep the default.
    pub(super) fn accumulate<T: Default + Clone>(
        &mut self,
        mut add: impl FnMut(&mut T, usize, &Range<usize>),
    ) -> Vec<T> {
        let mut values = vec![T::default(); self.runs.len()];
        for y in 0..self.rows.len() {
            for run in self.rows[y].clone() {
                let component = self.root(run as u32) as usize;
                add(&mut values[component], y, &self.runs[run]);
            }
        }
        values
    }

    /// Calls `act` with each run (row, columns) and the value of its component.
    pub(super) fn for_each_run<T>(&mut self, values: &[T], mut act: impl FnMut(&T, usize, &Range<usize>)) {
        for y in 0..self.rows.len() {
            for run in self.rows[y].clone() {
                let component = self.root(run as u32) as usize;
                act(&values[component], y, &self.runs[run]);
            }
        }
    }

    /// Joins the runs of a row to the runs above that they touch. Runs are in ascending order.
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

/// The pixels outside `mask` that are 8-connected to it by a path of pixels for which `passable` is true.
pub(super) fn reachable(mask: &Plane<u8>, passable: impl Fn(usize) -> bool) -> Vec<bool> {
    let (width, height) = (mask.width, mask.height);
    let mut reached = vec![false; mask.data.len()];
    let mut waiting: Vec<usize> = Vec::new();
    let around = |at: usize| {
        let (x, y) = (at % width, at / width);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        (y.saturating_sub(1)..(y + 2).min(height)).flat_map(move |v| columns.clone().map(move |u| v * width + u))
    };
    // starts from passable pixels, which are few, and not from those of the mask, which are many
    for start in 0..mask.data.len() {
        let begins = mask.data[start] == 0 && !reached[start] && passable(start);
        if begins && around(start).any(|beside| mask.data[beside] != 0) {
            reached[start] = true;
            waiting.push(start);
        }
        while let Some(at) = waiting.pop() {
            for next in around(at) {
                if mask.data[next] == 0 && !reached[next] && passable(next) {
                    reached[next] = true;
                    waiting.push(next);
                }
            }
        }
    }
    reached
}
