//! Pixels of a tile, each an index counted row by row: grouped by what is done to them, and their bounding box.

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
    fn a_group_keeps_the_order_in_which_items_came() {
        let mut groups = PixelGroups::new();
        for (key, item) in [(2, 'a'), (2, 'b'), (0, 'c'), (2, 'd'), (0, 'e')] {
            groups.add(key, item);
        }
        let groups: Vec<_> = groups.finish().into_iter().collect();
        assert_eq!(groups, [(0, vec!['c', 'e']), (2, vec!['a', 'b', 'd'])]);
    }
}
