//! Grid indexing: assigns grid labels to spots, leaves out spots that do not fit, and measures the pitch.

use std::collections::{HashMap, VecDeque};

use super::blobs::Blob;
use super::lattice::{Label, Lattice, MIN_DOTS, Places, STEPS, pitch_of};
use super::statistics::{median, median_point, range};

/// Largest distance of a spot from its predicted position, grid steps.
const REACH: f64 = 0.25;

/// The grid that most of the spots form, or `None`. Spots that do not fit (dust, lettering) are left out; gaps are
/// allowed.
pub(super) fn index(blobs: &[Blob]) -> Option<Lattice> {
    if blobs.len() < MIN_DOTS {
        return None;
    }
    let near = Nearby::new(blobs)?;
    let (u, v) = basis(blobs, &near)?;
    let mut best: Option<Places> = None;
    for seed in seeds(blobs, &near, u, v) {
        let places = grow(blobs, &near, seed, u, v);
        if best.as_ref().is_none_or(|b| places.len() > b.len()) {
            best = Some(places);
        }
    }
    let places = best.filter(|p| p.len() >= MIN_DOTS && is_regular(p))?;
    let pitch = pitch_of(&places);
    Some(Lattice { places, pitch })
}

/// Spatial index of the spots.
struct Nearby {
    cell: f64,
    cells: HashMap<(i64, i64), Vec<usize>>,
}

impl Nearby {
    fn new(blobs: &[Blob]) -> Option<Self> {
        let bound = |axis: usize| {
            let (low, high) = range(blobs.iter().map(|b| b.at[axis]));
            (high - low).max(1.0)
        };
        let cell = (bound(0) * bound(1) / blobs.len() as f64).sqrt().max(1.0);
        let mut cells: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
        for (k, blob) in blobs.iter().enumerate() {
            let key = ((blob.at[0] / cell).floor() as i64, (blob.at[1] / cell).floor() as i64);
            cells.entry(key).or_default().push(k);
        }
        cell.is_finite().then_some(Self { cell, cells })
    }

    /// The `count` spots nearest to spot `of` within three cells, nearest first.
    fn nearest(&self, blobs: &[Blob], of: usize, count: usize) -> Vec<usize> {
        let mut found: Vec<(f64, usize)> = self
            .within(blobs, blobs[of].at, 3.0 * self.cell)
            .filter(|&k| k != of)
            .map(|k| (distance(blobs[k].at, blobs[of].at), k))
            .collect();
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.into_iter().take(count).map(|(_, k)| k).collect()
    }

    fn within<'a>(&'a self, blobs: &'a [Blob], at: [f64; 2], reach: f64) -> impl Iterator<Item = usize> + 'a {
        let range = move |v: f64| ((v - reach) / self.cell).floor() as i64..=((v + reach) / self.cell).floor() as i64;
        range(at[1])
            .flat_map(move |cy| range(at[0]).map(move |cx| (cx, cy)))
            .filter_map(|key| self.cells.get(&key))
            .flatten()
            .copied()
            .filter(move |&k| distance(blobs[k].at, at) <= reach)
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The two grid steps: the displacements between near neighbours that most spots share.
fn basis(blobs: &[Blob], near: &Nearby) -> Option<([f64; 2], [f64; 2])> {
    let mut steps = Vec::new();
    for k in 0..blobs.len() {
        for n in near.nearest(blobs, k, 4) {
            let d = [blobs[n].at[0] - blobs[k].at[0], blobs[n].at[1] - blobs[k].at[1]];
            // a step and its opposite are equivalent
            let turned = d[0] + 1e-9 * d[1] < 0.0;
            steps.push(if turned { [-d[0], -d[1]] } else { d });
        }
    }
    let agreeing = |c: [f64; 2]| {
        let tolerance = 0.15 * c[0].hypot(c[1]);
        let close = |d: &&[f64; 2]| distance(**d, c) < tolerance || distance([-d[0], -d[1]], c) < tolerance;
        steps.iter().filter(close).count()
    };
    let stride = (steps.len() / 300).max(1);
    let mut ranked: Vec<(usize, [f64; 2])> = steps.iter().step_by(stride).map(|&c| (agreeing(c), c)).collect();
    ranked.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let refined = |c: [f64; 2]| {
        let tolerance = 0.15 * c[0].hypot(c[1]);
        let signed = steps.iter().map(|d| if d[0] * c[0] + d[1] * c[1] < 0.0 { [-d[0], -d[1]] } else { *d });
        let close: Vec<[f64; 2]> = signed.filter(|d| distance(*d, c) < tolerance).collect();
        median_point(&close)
    };
    let u = refined(ranked.first()?.1);
    let across = |c: &[f64; 2]| {
        let (lu, lc) = (u[0].hypot(u[1]), c[0].hypot(c[1]));
        let sine = (u[0] * c[1] - u[1] * c[0]).abs() / (lu * lc).max(1e-9);
        sine > 0.75 && (0.6..1.7).contains(&(lc / lu.max(1e-9)))
    };
    let second = ranked.iter().find(|(_, c)| across(c))?;
    let least = (blobs.len() / 4).max(MIN_DOTS / 3);
    (second.0 >= least).then(|| (u, refined(second.1)))
}

/// Start spots: those near the centre that have all four neighbours.
fn seeds(blobs: &[Blob], near: &Nearby, u: [f64; 2], v: [f64; 2]) -> Vec<usize> {
    let centre = median_point(&blobs.iter().map(|b| b.at).collect::<Vec<_>>());
    let reach = REACH * u[0].hypot(u[1]).min(v[0].hypot(v[1]));
    let neighbours = |k: usize| {
        let at = blobs[k].at;
        let places = [[u[0], u[1]], [-u[0], -u[1]], [v[0], v[1]], [-v[0], -v[1]]];
        places.iter().filter(|d| near.within(blobs, [at[0] + d[0], at[1] + d[1]], reach).next().is_some()).count()
    };
    let mut order: Vec<usize> = (0..blobs.len()).collect();
    order.sort_by(|&a, &b| distance(blobs[a].at, centre).total_cmp(&distance(blobs[b].at, centre)));
    let mut full: Vec<usize> = order.iter().copied().filter(|&k| neighbours(k) == 4).take(8).collect();
    full.extend(order.into_iter().take(2));
    full
}

/// Labels spots outward from `seed`. Each is predicted from its neighbour with the locally measured step.
fn grow(blobs: &[Blob], near: &Nearby, seed: usize, u: [f64; 2], v: [f64; 2]) -> Places {
    let mut labels: HashMap<Label, usize> = HashMap::from([([0, 0], seed)]);
    let mut taken = vec![false; blobs.len()];
    taken[seed] = true;
    let mut queue = VecDeque::from([([0, 0], u, v)]);
    while let Some((label, u, v)) = queue.pop_front() {
        let at = blobs[labels[&label]].at;
        for step in STEPS {
            let next = [label[0] + step[0], label[1] + step[1]];
            if labels.contains_key(&next) {
                continue;
            }
            let sign = f64::from(step[0] + step[1]);
            let along = if step[0] != 0 { u } else { v };
            let predicted = [at[0] + sign * along[0], at[1] + sign * along[1]];
            let reach = REACH * along[0].hypot(along[1]);
            let nearest = near
                .within(blobs, predicted, reach)
                .filter(|&k| !taken[k])
                .min_by(|&a, &b| distance(blobs[a].at, predicted).total_cmp(&distance(blobs[b].at, predicted)));
            let Some(found) = nearest else { continue };
            taken[found] = true;
            labels.insert(next, found);
            let measured = [sign * (blobs[found].at[0] - at[0]), sign * (blobs[found].at[1] - at[1])];
            let blend = [0.5 * (along[0] + measured[0]), 0.5 * (along[1] + measured[1])];
            queue.push_back(if step[0] != 0 { (next, blend, v) } else { (next, u, blend) });
        }
    }
    labels.into_iter().map(|(label, k)| (label, blobs[k].at)).collect()
}

/// True when the labelled spots form a grid and not a random chain of specks: at least 3 x 3, 2.2 neighbours per spot
/// on average, and each spot midway between its neighbours.
fn is_regular(places: &Places) -> bool {
    let span = |axis: usize| {
        let (low, high) = places.keys().fold((i32::MAX, i32::MIN), |b, l| (b.0.min(l[axis]), b.1.max(l[axis])));
        high - low + 1
    };
    if span(0) < 3 || span(1) < 3 {
        return false;
    }
    let pitch = pitch_of(places);
    let (mut links, mut bends) = (0, Vec::new());
    for (label, p) in places {
        links += STEPS.iter().filter(|s| places.contains_key(&[label[0] + s[0], label[1] + s[1]])).count();
        for step in [[1, 0], [0, 1]] {
            let (a, b) = ([label[0] + step[0], label[1] + step[1]], [label[0] - step[0], label[1] - step[1]]);
            if let (Some(a), Some(b)) = (places.get(&a), places.get(&b)) {
                bends.push(distance([(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0], *p) / pitch.max(1e-9));
            }
        }
    }
    links as f64 / places.len() as f64 >= 2.2 && !bends.is_empty() && median(&mut bends) < 0.05
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize) -> f64 {
        let x = (k as f64 * 12.9898).sin() * 43_758.547;
        x - x.floor() - 0.5
    }

    /// 9 x 7 dots, rotated and with a slight perspective, three missing, ten specks between them.
    fn spots() -> Vec<Blob> {
        let mut spots = Vec::new();
        for j in 0..7 {
            for i in 0..9 {
                if (i, j) == (4, 3) || (i, j) == (0, 0) || (i, j) == (7, 2) {
                    continue;
                }
                let (x, y) = (f64::from(i) * 30.0, f64::from(j) * 30.0);
                let w = 1.0 + 2e-4 * x - 1e-4 * y;
                spots.push(Blob { at: [(100.0 + x - 0.1 * y) / w, (80.0 + 0.1 * x + y) / w], area: 80.0 });
            }
        }
        for k in 0..10 {
            let at = [250.0 + 380.0 * noise(2 * k + 1), 180.0 + 300.0 * noise(2 * k + 2)];
            spots.push(Blob { at, area: 20.0 });
        }
        spots
    }

    #[test]
    fn a_rotated_grid_with_gaps_and_dust_is_indexed() {
        let lattice = index(&spots()).expect("a grid");
        assert!(lattice.places.len() >= 60 && lattice.places.len() <= 64, "{}", lattice.places.len());
        assert!((lattice.pitch - 29.5).abs() < 1.5, "{}", lattice.pitch);
    }

    #[test]
    fn scattered_specks_are_no_grid() {
        let specks: Vec<Blob> =
            (0..300).map(|k| Blob { at: [900.0 * noise(2 * k), 700.0 * noise(2 * k + 1)], area: 9.0 }).collect();
        assert!(index(&specks).is_none());
        assert!(index(&specks[..5]).is_none());
        let line: Vec<Blob> = (0..30).map(|k| Blob { at: [10.0 * f64::from(k), 50.0], area: 9.0 }).collect();
        assert!(index(&line).is_none());
        let heap = vec![Blob { at: [5.0, 5.0], area: 9.0 }; 40];
        assert!(index(&heap).is_none());
    }
}
