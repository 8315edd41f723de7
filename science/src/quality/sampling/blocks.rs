//! The blocks in which the fused image is scored.

use super::{Extent, object_pixels};
use crate::imaging::{Plane, Rect};

/// Width and height of a block of a sampled canvas, px. Wider than high, because memory and files are read in rows.
const BLOCK: (usize, usize) = (128, 48);
/// Largest side of a block of a canvas that is scored completely, px.
const PIECE: usize = 512;
/// One of this many pixels of the canvas is scored, ...
const ONE_OF: usize = 16;
/// ... but at least `LEAST` pixels (or all) and at most `MOST`.
const LEAST: usize = 128 << 10;
const MOST: usize = 1 << 20;
/// An area up to this multiple of the sample is scored completely.
const WHOLE: f64 = 1.5;
/// Least share of object pixels in a block of a sampled area. An area that is scored completely keeps every piece that
/// shows the object: a thin diagonal part covers less than this of each.
const LEAST_SHARE: f64 = 0.02;

/// Blocks spread evenly over the canvas or, with a mask, over the object, by a jittered grid: one block per cell, at a
/// pseudo-random position that is a hash of the canvas and the cell.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Blocks {
    /// In reading order of their cells, without overlap.
    pub rects: Vec<Rect>,
}

impl Blocks {
    /// The blocks of a `width` x `height` canvas; with `object` (non-zero inside, of the size of the canvas) those that
    /// show some of it.
    pub fn of(width: usize, height: usize, object: Option<&Plane<u8>>) -> Self {
        let canvas = Rect::whole(width, height);
        let (area, share) = match object.map(Extent::of) {
            None => (canvas, 1.0),
            Some(None) => return Self::default(),
            Some(Some(Extent { bounds, pixels })) => (bounds, pixels as f64 / (bounds.width * bounds.height) as f64),
        };
        let wanted = (width * height / ONE_OF).clamp(LEAST, MOST) as f64;
        let touching = |rects: Vec<Rect>, least_share: f64| match object {
            None => rects,
            Some(object) => {
                let least = |rect: &Rect| (least_share * (rect.width * rect.height) as f64).max(1.0);
                rects.into_iter().filter(|rect| object_pixels(object, *rect) as f64 >= least(rect)).collect()
            }
        };
        if (area.width * area.height) as f64 <= WHOLE * wanted {
            return Self { rects: touching(everything(area), 0.0) };
        }
        let mut cells = wanted / (BLOCK.0 * BLOCK.1) as f64 / share.max(1e-6);
        let mut rects = Vec::new();
        // blocks at the outline show only part of the object, so their number is adjusted by trial
        for _ in 0..6 {
            let (columns, rows) = grid(area, cells);
            rects = touching(jittered(area, columns, rows), LEAST_SHARE);
            let laid = (rects.len() * BLOCK.0 * BLOCK.1) as f64;
            if laid <= 1.1 * wanted {
                break;
            }
            cells = (columns * rows) as f64 * wanted / laid;
        }
        Self { rects }
    }
}

/// All of `area`, in pieces of nearly equal size.
fn everything(area: Rect) -> Vec<Rect> {
    let pieces = |start: usize, length: usize| {
        let count = length.div_ceil(PIECE).max(1);
        (0..count).map(move |i| (start + i * length / count, start + (i + 1) * length / count))
    };
    pieces(area.y, area.height)
        .flat_map(|(y, bottom)| {
            pieces(area.x, area.width).map(move |(x, right)| Rect { x, y, width: right - x, height: bottom - y })
        })
        .collect()
}

/// Columns and rows of about `cells` nearly square cells over `area`, each at least as large as a block.
fn grid(area: Rect, cells: f64) -> (usize, usize) {
    let most = |length: usize, side: usize| (length / side).max(1);
    let (most_columns, most_rows) = (most(area.width, BLOCK.0), most(area.height, BLOCK.1));
    let columns = (cells * area.width as f64 / area.height.max(1) as f64).sqrt().round() as usize;
    let rows = (cells / columns.clamp(1, most_columns) as f64).round() as usize;
    let rows = rows.clamp(1, most_rows);
    // if one direction has no space for more cells, the other one gets them
    let columns = (cells / rows as f64).round() as usize;
    (columns.clamp(1, most_columns), rows)
}

/// One block in each cell.
fn jittered(area: Rect, columns: usize, rows: usize) -> Vec<Rect> {
    let (width, height) = (BLOCK.0.min(area.width), BLOCK.1.min(area.height));
    let cell = |start: usize, length: usize, count: usize, i: usize| {
        (start + i * length / count, start + (i + 1) * length / count)
    };
    let mut rects = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        let (top, bottom) = cell(area.y, area.height, rows, row);
        for column in 0..columns {
            let (left, right) = cell(area.x, area.width, columns, column);
            let hash = hash([area.width, area.height, column, row]);
            let (x_room, y_room) = (right - left - width, bottom - top - height);
            let x = left + (hash >> 32) as usize % (x_room + 1);
            let y = top + (hash & 0xffff_ffff) as usize % (y_room + 1);
            rects.push(Rect { x, y, width, height });
        }
    }
    rects
}

fn hash(words: [usize; 4]) -> u64 {
    words.into_iter().fold(0x9e37_79b9_7f4a_7c15, |hash, word| {
        let mixed = (hash ^ word as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed ^ (mixed >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb) ^ (mixed >> 32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(blocks: &Blocks) -> usize {
        blocks.rects.iter().map(|rect| rect.width * rect.height).sum()
    }

    fn assert_apart_and_inside(blocks: &Blocks, width: usize, height: usize) {
        for (i, a) in blocks.rects.iter().enumerate() {
            assert!(a.x + a.width <= width && a.y + a.height <= height, "{a:?}");
            for b in &blocks.rects[i + 1..] {
                let apart =
                    a.x + a.width <= b.x || b.x + b.width <= a.x || a.y + a.height <= b.y || b.y + b.height <= a.y;
                assert!(apart, "{a:?} and {b:?}");
            }
        }
    }

    #[test]
    fn a_small_canvas_is_scored_completely() {
        for (width, height) in [(480, 360), (33, 17), (1, 1), (900, 3)] {
            let blocks = Blocks::of(width, height, None);
            assert_eq!(pixels(&blocks), width * height);
            assert_apart_and_inside(&blocks, width, height);
        }
        assert_eq!(Blocks::of(0, 0, None).rects.iter().map(|r| r.width * r.height).sum::<usize>(), 0);
    }

    #[test]
    fn a_large_canvas_is_scored_in_blocks_that_are_spread_evenly_and_do_not_overlap() {
        for (width, height) in [(6000, 4000), (1600, 1250), (4001, 1003), (20_000, 300), (300, 20_000)] {
            let blocks = Blocks::of(width, height, None);
            let share = pixels(&blocks) as f64 / ((width * height / ONE_OF).clamp(LEAST, MOST)) as f64;
            assert!((0.8..1.2).contains(&share), "{width} x {height}: {share}");
            assert_apart_and_inside(&blocks, width, height);
            let of_quarter = |right: bool, low: bool| {
                let here = |r: &&Rect| (r.x * 2 + r.width > width) == right && (r.y * 2 + r.height > height) == low;
                blocks.rects.iter().filter(here).count()
            };
            let counts = [(false, false), (true, false), (false, true), (true, true)].map(|(r, l)| of_quarter(r, l));
            assert!(counts.iter().all(|&count| count * 8 >= blocks.rects.len()), "{width} x {height}: {counts:?}");
        }
    }

    #[test]
    fn all_blocks_lie_on_a_small_object() {
        let object = Plane::from_fn(6000, 4000, |x, y| u8::from((x as f64 - 3000.0).hypot(y as f64 - 2500.0) < 800.0));
        let blocks = Blocks::of(6000, 4000, Some(&object));
        assert_apart_and_inside(&blocks, 6000, 4000);
        assert!((MOST * 7 / 10..=MOST * 11 / 10).contains(&pixels(&blocks)), "{}", pixels(&blocks));
        assert!(blocks.rects.iter().all(|rect| object_pixels(&object, *rect) > 0));
        let tiny = Plane::from_fn(6000, 4000, |x, y| u8::from(x / 50 == 7 && y / 50 == 9));
        assert_eq!(Blocks::of(6000, 4000, Some(&tiny)).rects, [Rect { x: 350, y: 450, width: 50, height: 50 }]);
        assert_eq!(Blocks::of(6000, 4000, Some(&tiny.map(|_| 0))), Blocks::default());
    }

    #[test]
    fn a_diagonal_hair_is_scored_completely() {
        let hair = |x: usize, y: usize| (1000..1700).contains(&x) && (x - 1000).abs_diff(y) <= 1;
        let object = Plane::from_fn(6000, 4000, |x, y| u8::from(hair(x, y)));
        let scored: usize =
            Blocks::of(6000, 4000, Some(&object)).rects.iter().map(|r| object_pixels(&object, *r)).sum();
        assert_eq!(scored, object.data.iter().filter(|&&v| v != 0).count());
    }
}
