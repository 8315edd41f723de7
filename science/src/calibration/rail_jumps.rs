//! Motions of the image that are not along the rail: lasting jumps, and single slices beside the line of the others.
//!
//! On a straight rail the shift and the turn of the image are linear in the rail position. A line is fitted with at
//! most one step, and single slices far from it are left out; the step and the slices left out are found together,
//! because either hides the other.

use super::line_fit::{Line, Point};
use super::rail_anomalies::{Jump, RailAnomaly};

/// Fewest measured slices in which a lasting jump can be told from a slope.
const MIN_SLICES: usize = 7;
/// Fewest slices of a line.
const MIN_LINE: usize = 5;
/// Least lasting jump that is reported, px at the image corner.
const LEAST_JUMP: f64 = 0.5;
/// Standard deviations of the scatter that a lasting jump must exceed.
const CLEAR: f64 = 6.0;
/// Largest share of the squared residuals that a lasting jump leaves, where [`AMPLE`] residuals are free; less where
/// fewer are, because a step then explains much by chance.
const LEFT: f64 = 0.15;
const AMPLE: f64 = 10.0;
/// Least distance of a single slice from the line of the others, px at the image corner.
const LEAST_AWAY: f64 = 1.0;
/// Standard deviations of the others that a single slice must be away from their line.
const AWAY: f64 = 8.0;

/// The jumps of the image. `motions` per slice, relative to the reference slice: shift x and y, and turn, the turn in
/// px at the image corner; `None` where nothing was measured. `half`: distance of the corner from the middle, px.
pub(super) fn find(motions: &[Option<[f64; 3]>], positions: &[f64], half: f64) -> Vec<RailAnomaly> {
    // apart, because turns scatter more than shifts
    let shifts = of_part(&part(motions, positions, |[x, y, _]| [x, y]));
    let turns = of_part(&part(motions, positions, |[_, _, turn]| [turn]));
    let degrees = |px: f64| (px / half).to_degrees();
    let mut out = Vec::new();
    let mut bumped = |from: usize, shift: [f64; 2], turn: f64| {
        let after = (0..from).rev().find(|&i| motions[i].is_some()).unwrap_or(from);
        out.push(RailAnomaly::Bumped { after, from, by: Jump { shift, turn: degrees(turn) } });
    };
    match (shifts.lasting, turns.lasting) {
        (Some((from, shift)), Some((turned_from, [turn]))) if from == turned_from => bumped(from, shift, turn),
        (shift, turn) => {
            shift.into_iter().for_each(|(from, shift)| bumped(from, shift, 0.0));
            turn.into_iter().for_each(|(from, [turn])| bumped(from, [0.0; 2], turn));
        }
    }
    for slice in 0..motions.len() {
        let shift = shifts.single.iter().find(|(at, _)| *at == slice).map(|(_, shift)| *shift);
        let turn = turns.single.iter().find(|(at, _)| *at == slice).map(|(_, [turn])| degrees(*turn));
        if shift.is_some() || turn.is_some() {
            let by = Jump { shift: shift.unwrap_or_default(), turn: turn.unwrap_or_default() };
            out.push(RailAnomaly::Displaced { slice, by });
        }
    }
    out
}

fn part<const D: usize>(
    motions: &[Option<[f64; 3]>],
    positions: &[f64],
    of: impl Fn([f64; 3]) -> [f64; D],
) -> Vec<Point<D>> {
    let point = |(slice, (m, z)): (usize, (&Option<[f64; 3]>, &f64))| m.map(|m| Point { slice, z: *z, at: of(m) });
    motions.iter().zip(positions).enumerate().filter_map(point).collect()
}

/// Jumps of some coordinates.
struct Jumps<const D: usize> {
    /// The first slice after a lasting jump, and its size.
    lasting: Option<(usize, [f64; D])>,
    /// Slices beside the line, and how far.
    single: Vec<(usize, [f64; D])>,
}

/// A line with a step at `cut`, and the slices that are left out of it.
struct Candidate<const D: usize> {
    line: Line<D>,
    kept: Vec<Point<D>>,
    single: Vec<(usize, [f64; D])>,
}

fn of_part<const D: usize>(points: &[Point<D>]) -> Jumps<D> {
    let Some(plain) = Candidate::new(points, None) else { return Jumps { lasting: None, single: Vec::new() } };
    let cuts = if points.len() < MIN_SLICES { 0..0 } else { 2..points.len() - 1 };
    let best = cuts
        .filter_map(|k| Candidate::new(points, Some(points[k].slice)))
        .filter(Candidate::is_justified)
        .min_by(|a, b| a.single.len().cmp(&b.single.len()).then(a.line.scatter.total_cmp(&b.line.scatter)));
    let is_simpler =
        |best: &Candidate<D>| plain.single.len() <= best.single.len() && plain.line.scatter < 1.5 * best.line.scatter;
    match best.filter(|best| !is_simpler(best)) {
        Some(best) => Jumps { lasting: best.line.step, single: best.single },
        None => Jumps { lasting: None, single: plain.single },
    }
}

impl<const D: usize> Candidate<D> {
    /// Leaves out the slice that is farthest from the line of all others, as often as there is one, up to a quarter of
    /// the slices.
    fn new(points: &[Point<D>], cut: Option<usize>) -> Option<Self> {
        let (mut kept, mut single) = (points.to_vec(), Vec::new());
        while single.len() < points.len() / 4 && kept.len() > MIN_LINE {
            let away = |k: usize| {
                let others: Vec<Point<D>> = kept.iter().enumerate().filter(|(n, _)| *n != k).map(|(_, p)| *p).collect();
                let line = Line::fit(&others, cut)?;
                let (at, sigma) = line.predict(kept[k].slice, kept[k].z);
                // few slices determine their scatter poorly
                let sigma = sigma * (1.0 + 2.5 / line.freedom);
                let by: [f64; D] = std::array::from_fn(|a| kept[k].at[a] - at[a]);
                let size = norm(&by);
                (size > LEAST_AWAY.max(AWAY * sigma)).then_some((size / sigma.max(1e-6), k, by))
            };
            let farthest = (0..kept.len()).filter_map(away).max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, k, by)) = farthest else { break };
            single.push((kept.remove(k).slice, by));
        }
        Some(Self { line: Line::fit(&kept, cut)?, kept, single })
    }

    /// True when the step is clear, and explains most of what a line without it leaves.
    fn is_justified(&self) -> bool {
        let Some((_, step)) = &self.line.step else { return false };
        let Some(plain) = Line::fit(&self.kept, None) else { return false };
        self.line.left < LEFT * (self.line.freedom / AMPLE).min(1.0) * plain.left
            && norm(step) > LEAST_JUMP.max(CLEAR * self.line.scatter)
    }
}

fn norm(by: &[f64]) -> f64 {
    by.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;

    const HALF: f64 = 360.0;

    /// Motions along a rail that is not quite parallel to the optical axis, with `scatter` px.
    fn motions(count: usize, scatter: f64, seed: u64) -> (Vec<Option<[f64; 3]>>, Vec<f64>) {
        let mut noise = Noise(seed);
        let positions: Vec<f64> = (0..count).map(|i| i as f64).collect();
        let mut scattered = |v: f64| v + scatter * noise.normal();
        let motion = |z: &f64| Some([scattered(0.7 * z), scattered(-0.3 * z), scattered(0.1 * z)]);
        let motions = positions.iter().map(motion).collect();
        (motions, positions)
    }

    fn add(motions: &mut [Option<[f64; 3]>], slices: impl Iterator<Item = usize>, by: [f64; 3]) {
        for slice in slices {
            motions[slice] = motions[slice].map(|m| [0, 1, 2].map(|a| m[a] + by[a]));
        }
    }

    #[test]
    fn scatter_and_drift_are_no_jumps() {
        for seed in 0..20 {
            for (count, scatter) in [(7, 0.3), (9, 0.05), (13, 1.0), (30, 0.3)] {
                let (motions, positions) = motions(count, scatter, seed);
                assert_eq!(find(&motions, &positions, HALF), [], "{count} slices, {scatter} px, seed {seed}");
            }
        }
    }

    #[test]
    fn a_lasting_jump_or_turn_is_found() {
        let (mut shifted, positions) = motions(13, 0.05, 3);
        add(&mut shifted, 8..13, [3.0, -1.0, 0.0]);
        shifted[3] = None;
        let [RailAnomaly::Bumped { from: 8, by, .. }] = find(&shifted, &positions, HALF)[..] else {
            panic!("not found")
        };
        assert!((by.shift[0] - 3.0).abs() < 0.3 && (by.shift[1] + 1.0).abs() < 0.3 && by.turn == 0.0, "{by:?}");
        let (mut turned, positions) = motions(9, 0.05, 4);
        add(&mut turned, 5..9, [0.0, 0.0, HALF * 0.5_f64.to_radians()]);
        let [RailAnomaly::Bumped { from: 5, by, .. }] = find(&turned, &positions, HALF)[..] else {
            panic!("not found")
        };
        assert!(by.shift == [0.0; 2] && (by.turn - 0.5).abs() < 0.05, "{by:?}");
    }

    #[test]
    fn a_slice_beside_the_line_is_found_alone() {
        for displaced in [8, 3] {
            let (mut motions, positions) = motions(9, 0.3, 5);
            add(&mut motions, displaced..displaced + 1, [9.0, -3.0, 0.0]);
            let found = find(&motions, &positions, HALF);
            let [RailAnomaly::Displaced { slice, by }] = found[..] else { panic!("{found:?}") };
            assert!(slice == displaced && (by.shift[0] - 9.0).abs() < 2.5, "{found:?}");
        }
    }

    #[test]
    fn a_shift_and_a_turn_at_different_slices_are_both_found() {
        let (mut motions, positions) = motions(15, 0.05, 7);
        add(&mut motions, 5..15, [4.0, 0.0, 0.0]);
        add(&mut motions, 10..15, [0.0, 0.0, HALF * 0.5_f64.to_radians()]);
        let found = find(&motions, &positions, HALF);
        let [RailAnomaly::Bumped { from: 5, by: first, .. }, RailAnomaly::Bumped { from: 10, by: second, .. }] =
            found[..]
        else {
            panic!("{found:?}")
        };
        assert!(first.turn == 0.0 && second.shift == [0.0; 2] && (second.turn - 0.5).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn a_jump_is_named_between_slices_that_were_measured() {
        let (mut motions, positions) = motions(13, 0.05, 3);
        add(&mut motions, 8..13, [3.0, -1.0, 0.0]);
        motions[7] = None;
        let found = find(&motions, &positions, HALF);
        assert!(matches!(found[..], [RailAnomaly::Bumped { after: 6, from: 8, .. }]), "{found:?}");
    }

    #[test]
    fn a_jump_does_not_hide_a_displaced_slice() {
        let (mut motions, positions) = motions(9, 0.1, 6);
        add(&mut motions, 5..9, [15.0, 4.0, 0.0]);
        add(&mut motions, 2..3, [6.0, 1.0, 0.0]);
        let found = find(&motions, &positions, HALF);
        assert!(
            matches!(found[..], [RailAnomaly::Bumped { from: 5, .. }, RailAnomaly::Displaced { slice: 2, .. }]),
            "{found:?}"
        );
    }
}
