//! The largest connected area of the object that has no texture in any slice: smooth, or never in focus.

use crate::{quality::sampling::Points, types::metrics::UnfocusedArea};

/// The largest 4-connected area of points that are not textured, with its bounding box; none if all are textured. `at`
/// are the positions of the points that count, `textured` has one entry for each of them.
pub(super) fn largest(points: &Points, at: &[(usize, usize)], textured: &[bool]) -> Option<UnfocusedArea> {
    let step = points.step();
    let cell = |(x, y): (usize, usize)| (x / step, y / step);
    let (columns, rows) = at.iter().map(|&p| cell(p)).fold((0, 0), |(c, r), (x, y)| (c.max(x + 1), r.max(y + 1)));
    let mut open = vec![false; columns * rows];
    for (&p, _) in at.iter().zip(textured).filter(|(_, textured)| !**textured) {
        let (x, y) = cell(p);
        open[y * columns + x] = true;
    }
    let mut best: Option<(usize, [usize; 4])> = None;
    let mut stack = Vec::new();
    for start in 0..open.len() {
        if !std::mem::take(&mut open[start]) {
            continue;
        }
        let (mut count, mut bounds) = (0, [usize::MAX, usize::MAX, 0, 0]);
        stack.push(start);
        while let Some(here) = stack.pop() {
            let (x, y) = (here % columns, here / columns);
            count += 1;
            bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
            let sides = [
                (x > 0).then(|| here - 1),
                (x + 1 < columns).then_some(here + 1),
                (y > 0).then(|| here - columns),
                (y + 1 < rows).then_some(here + columns),
            ];
            stack.extend(sides.into_iter().flatten().filter(|&next| std::mem::take(&mut open[next])));
        }
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, bounds));
        }
    }
    let (count, [left, top, right, bottom]) = best?;
    let px = |cells: usize| (cells * step) as u32;
    Some(UnfocusedArea {
        fraction: count as f64 / at.len() as f64,
        x: px(left),
        y: px(top),
        width: px(right + 1 - left),
        height: px(bottom + 1 - top),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_larger_of_two_areas_is_returned_with_its_bounding_box() {
        let points = Points::of(100, 80, None);
        let at: Vec<_> = points.positions().collect();
        let hole =
            |&(x, y): &(usize, usize)| (10..20).contains(&x) && (30..50).contains(&y) || (60..65).contains(&x) && y < 5;
        let textured: Vec<bool> = at.iter().map(|p| !hole(p)).collect();
        let found = largest(&points, &at, &textured).unwrap();
        assert_eq!((found.x, found.y, found.width, found.height), (10, 30, 10, 20));
        assert!((found.fraction - 200.0 / 8000.0).abs() < 1e-9);
        assert_eq!(largest(&points, &at, &vec![true; at.len()]), None);
    }
}
