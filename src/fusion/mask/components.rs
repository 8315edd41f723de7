//! Connected parts of a mask, and the small ones removed: runs and union-find, linear in the pixels, with
//! memory for the runs alone.

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

/// What is left of the parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Parts {
    /// Parts that were large enough.
    pub kept: u32,
    /// Of these, the parts that do not reach the border of the picture or an open pixel.
    pub kept_inside: u32,
}

/// A part that may be removed or counted.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    pixels: u64,
    open: bool,
}

/// Turns parts of `value` with fewer than `least` pixels into `other`. Where `value` is 0 (background), only
/// parts that reach neither the border of the picture nor a pixel that is not `closed` are small enough ever.
pub(super) fn remove_small(
    mask: &mut Plane<u8>,
    value: u8,
    other: u8,
    connectivity: Connectivity,
    least: u32,
    closed: impl Fn(usize) -> bool,
) -> Parts {
    let (width, height) = (mask.width, mask.height);
    let mut runs: Vec<Range<usize>> = Vec::new();
    let mut rows: Vec<Range<usize>> = Vec::with_capacity(height);
    let mut parents: Vec<u32> = Vec::new();
    let reach = if connectivity == Connectivity::Eight { 1 } else { 0 };
    for y in 0..height {
        let first = runs.len();
        push_runs(mask.row(y), value, &mut runs);
        parents.extend(first as u32..runs.len() as u32);
        if let Some(above) = rows.last() {
            join_rows(&runs, above.clone(), first..runs.len(), reach, &mut parents);
        }
        rows.push(first..runs.len());
    }

    let background = value == 0;
    let mut parts = vec![Part::default(); runs.len()];
    for (y, row) in rows.iter().enumerate() {
        for run in row.clone() {
            let span = runs[run].clone();
            let at_border = y == 0 || y + 1 == height || span.start == 0 || span.end == width;
            let open = at_border || !span.clone().all(|x| closed(y * width + x));
            let part = &mut parts[root(&mut parents, run as u32) as usize];
            part.pixels += span.len() as u64;
            part.open |= open;
        }
    }
    let is_small = |part: &Part| part.pixels < u64::from(least) && !(background && part.open);
    for (y, row) in rows.iter().enumerate() {
        for run in row.clone() {
            if is_small(&parts[root(&mut parents, run as u32) as usize]) {
                mask.row_mut(y)[runs[run].clone()].fill(other);
            }
        }
    }
    let kept = parts.iter().filter(|part| part.pixels > 0 && !is_small(part));
    let (all, inside) = kept.fold((0, 0), |(all, inside), part| (all + 1, inside + u32::from(!part.open)));
    Parts { kept: all, kept_inside: inside }
}

/// Appends the runs of `value` in a row.
fn push_runs(row: &[u8], value: u8, runs: &mut Vec<Range<usize>>) {
    let mut x = 0;
    while let Some(start) = row[x..].iter().position(|&v| v == value).map(|offset| x + offset) {
        let end = row[start..].iter().position(|&v| v != value).map_or(row.len(), |offset| start + offset);
        runs.push(start..end);
        x = end;
    }
}

/// Joins the runs of a row with those of the row above that they touch. Runs are in ascending order.
fn join_rows(runs: &[Range<usize>], above: Range<usize>, here: Range<usize>, reach: usize, parents: &mut [u32]) {
    let mut upper = above.start;
    for lower in here {
        let run = &runs[lower];
        while upper < above.end && runs[upper].end + reach <= run.start {
            upper += 1;
        }
        let mut touching = upper;
        while touching < above.end && runs[touching].start < run.end + reach {
            join(parents, touching as u32, lower as u32);
            touching += 1;
        }
    }
}

fn root(parents: &mut [u32], mut node: u32) -> u32 {
    while parents[node as usize] != node {
        let grandparent = parents[parents[node as usize] as usize];
        parents[node as usize] = grandparent;
        node = grandparent;
    }
    node
}

fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}
