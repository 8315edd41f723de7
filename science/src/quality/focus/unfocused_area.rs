//! The largest connected area of the object that has no texture in any slice: smooth, or never in focus.

use crate::{quality::sampling::Points, types::metrics::UnfocusedArea};

/// The largest 4-connected area of points that are not textured, with its bounding box; none if all are textured. `at`
/// are the positions of the points that count, `textured` has one entry for each of them. The box consists of the whole
/// cells of the points, as far as they are on the canvas of `width` x `height` px.
pub(super) fn largest(
    points: &Points,
    at: &[(usize, usize)],
    textured: &[bool],
    (width, height): (usize, usize),
) -> Option<UnfocusedArea> {
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
    let span = |first: usize, last: usize, canvas: usize| {
        let (start, end) = (first * step, ((last + 1) * step).min(canvas));
        (start as u32, end.saturating_sub(start) as u32)
    };
    let ((x, width), (y, height)) = (span(left, right, width), span(top, bottom, height));
    Some(UnfocusedArea { fraction: count as f64 / at.len() as f64, x, y, width, height })
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
        let found = largest(&points, &at, &textured, (100, 80)).unwrap();
        assert_eq!((found.x, found.y, found.width, found.height), (10, 30, 10, 20));
        assert!((found.fraction - 200.0 / 8000.0).abs() < 1e-9);
        assert_eq!(largest(&points, &at, &vec![true; at.len()], (100, 80)), None);
    }

    #[test]
    fn the_box_ends_at_the_border_of_the_canvas() {
        let (width, height) = (1003, 701);
        let points = Points::of(width, height, None);
        assert!(!width.is_multiple_of(points.step()) && !height.is_multiple_of(points.step()), "{}", points.step());
        let at: Vec<_> = points.positions().collect();
        let found = largest(&points, &at, &vec![false; at.len()], (width, height)).unwrap();
        // the last row is not sampled
        assert_eq!((found.x, found.y, found.width, found.height), (0, 0, 1003, 700));
    }
}
