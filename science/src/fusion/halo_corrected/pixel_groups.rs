//! Pixels of a tile, each an index counted row by row: grouped by what is done to them, in blocks, and their bounding
//! box.

use std::collections::BTreeMap;

use crate::imaging::Rect;

/// Items grouped by a key, in the order in which they were added.
///
/// Pixels are added row by row, so the key of an item is most often that of the item before it: that group is kept
/// apart, and the map is searched only when the key changes.
pub(super) struct PixelGroups<K, T> {
    groups: BTreeMap<K, Vec<T>>,
    current: (K, Vec<T>),
}

impl<K: Ord + Copy + Default, T> PixelGroups<K, T> {
    pub(super) fn new() -> Self {
        Self { groups: BTreeMap::new(), current: (K::default(), Vec::new()) }
    }

    pub(super) fn add(&mut self, key: K, item: T) {
        if key != self.current.0 {
            self.store_current();
            self.current.0 = key;
        }
        self.current.1.push(item);
    }

    fn store_current(&mut self) {
        if !self.current.1.is_empty() {
            self.groups.entry(self.current.0).or_default().append(&mut self.current.1);
        }
    }

    /// The groups, ordered by key.
    pub(super) fn finish(mut self) -> BTreeMap<K, Vec<T>> {
        self.store_current();
        self.groups
    }
}

/// Sides of the blocks that are processed in one go, px; each divides the next. The margin around a block costs more
/// than the block, but processing all that lies between scattered pixels costs more still: the cheapest side is chosen.
const BLOCK_SIDES: [usize; 4] = [16, 32, 64, 256];

/// Fixed cost of a block, in pixels.
const BLOCK_COST: usize = 1000;

/// `items`, each at the pixel `at` of `tile`, in square blocks, each with the bounding box on the canvas of its pixels.
/// The side of the blocks is the one with the least cost, the margin of `reach` px around each bounding box included.
/// The items of a block keep their order.
pub(super) fn in_blocks<T: Copy>(
    items: &[T],
    at: impl Fn(&T) -> usize,
    tile: Rect,
    reach: usize,
) -> Vec<(Rect, Vec<T>)> {
    let columns = tile.width.div_ceil(BLOCK_SIDES[0]);
    let place = |item: &T| (at(item) % tile.width, at(item) / tile.width);
    let mut small: Vec<Option<Rect>> = vec![None; columns * tile.height.div_ceil(BLOCK_SIDES[0])];
    for (x, y) in items.iter().map(place) {
        let pixel = Rect { x: tile.x + x, y: tile.y + y, width: 1, height: 1 };
        let block = &mut small[y / BLOCK_SIDES[0] * columns + x / BLOCK_SIDES[0]];
        *block = Some(block.map_or(pixel, |block| block.joined(pixel)));
    }
    let area = |bounds: &Rect| (bounds.width + 2 * reach) * (bounds.height + 2 * reach);
    let cost =
        |boxes: &BTreeMap<(usize, usize), Rect>| boxes.values().map(|bounds| area(bounds) + BLOCK_COST).sum::<usize>();
    let found = small.into_iter().enumerate().filter_map(|(i, bounds)| Some(((i / columns, i % columns), bounds?)));
    let mut boxes: BTreeMap<(usize, usize), Rect> = found.collect();
    let mut best = (cost(&boxes), BLOCK_SIDES[0], boxes.clone());
    for pair in BLOCK_SIDES.windows(2) {
        let mut joined: BTreeMap<(usize, usize), Rect> = BTreeMap::new();
        let times = pair[1] / pair[0];
        for ((row, column), bounds) in boxes {
            let block = joined.entry((row / times, column / times)).or_insert(bounds);
            *block = block.joined(bounds);
        }
        boxes = joined;
        let cost = cost(&boxes);
        if cost <= best.0 {
            best = (cost, pair[1], boxes.clone());
        }
    }
    let (_, side, boxes) = best;
    let mut blocks: BTreeMap<_, _> = boxes.into_iter().map(|(key, bounds)| (key, (bounds, Vec::new()))).collect();
    for item in items {
        let (x, y) = place(item);
        if let Some((_, items)) = blocks.get_mut(&(y / side, x / side)) {
            items.push(*item);
        }
    }
    blocks.into_values().collect()
}

/// The bounding box on the canvas of `pixels`, which are indices within `tile`.
pub(super) fn bounding_box(pixels: impl Iterator<Item = usize>, tile: Rect) -> Rect {
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for at in pixels {
        let (x, y) = (at % tile.width, at / tile.width);
        (left, right, top, bottom) = (left.min(x), right.max(x), top.min(y), bottom.max(y));
    }
    let (left, top) = (left.min(right), top.min(bottom));
    Rect { x: tile.x + left, y: tile.y + top, width: right - left + 1, height: bottom - top + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bounding_box_is_the_smallest_around_its_pixels() {
        let tile = Rect { x: 100, y: 50, width: 20, height: 10 };
        let at = |x: usize, y: usize| y * 20 + x;
        let bounds = bounding_box([at(7, 2), at(3, 8), at(5, 5)].into_iter(), tile);
        assert_eq!(bounds, Rect { x: 103, y: 52, width: 5, height: 7 });
    }

    #[test]
    fn each_item_is_in_one_block_and_the_cheapest_side_is_chosen() {
        let tile = Rect { x: 100, y: 50, width: 500, height: 300 };
        let at = |x: usize, y: usize| y * tile.width + x;
        // two clusters far apart, and a dense area
        let clusters: Vec<usize> = (0..8).flat_map(|i| [at(3 + i, 5), at(480 + i, 290)]).collect();
        let dense: Vec<usize> = (0..200 * 200).map(|i| at(20 + i % 200, 30 + i / 200)).collect();
        for (items, reach, count) in [(&clusters, 30, 2), (&dense, 30, 1), (&dense, 0, 1)] {
            let blocks = in_blocks(items, |&at| at, tile, reach);
            assert_eq!(blocks.len(), count, "reach {reach}");
            let mut all: Vec<usize> = blocks.iter().flat_map(|(_, items)| items.clone()).collect();
            all.sort_unstable();
            let mut expected = items.clone();
            expected.sort_unstable();
            assert_eq!(all, expected);
            for (bounds, items) in &blocks {
                assert_eq!(*bounds, bounding_box(items.iter().copied(), tile));
                assert!(items.is_sorted(), "the order is kept");
            }
        }
        assert!(in_blocks(&[], |&at: &usize| at, tile, 5).is_empty());
    }

    #[test]
    fn a_group_keeps_the_order_in_which_items_came() {
        let mut groups = PixelGroups::new();
        for (key, item) in [(2, 'a'), (2, 'b'), (0, 'c'), (2, 'd'), (0, 'e')] {
            groups.add(key, item);
        }
        let groups: Vec<_> = groups.finish().into_iter().collect();
        assert_eq!(groups, [(0, vec!['c', 'e']), (2, vec!['a', 'b', 'd'])]);
    }
}
