//! Steps of the turntable that differ from the others: it slipped, or the specimen moved on it.
//!
//! In: the poses of one ring, by pan. Between two neighbours the camera makes the same motion at every step, seen from
//! the camera: with the rotations `R` (world to camera) and the centres `C`
//!
//! ```text
//! Q_i = R_{i+1} R_i^T        p_i = R_i (C_{i+1} - C_i)
//! ```
//!
//! do not depend on `i`. COLMAP sees the specimen alone, so a specimen that moved between two views changes the motion
//! of that one step. A table that slipped changes it too, but only by a rotation about its own axis. If two steps in a
//! row are odd, it is the pose of the view between them that is wrong, and nothing moved. The step that is typical is
//! the one that differs least from all others.

use pinstack_science::types::view::ViewAngles;

/// Rotation by which a step must differ, degrees.
const LEAST_DEG: f64 = 0.5;
/// Displacement by which a step must differ, as a share of the distance between neighbours. With steps of 10 to 20
/// degrees it is 0.35 to 0.7 % of the radius: a turn by `LEAST_DEG` moves a camera by 0.9 %.
const LEAST_SHARE: f64 = 0.02;
/// Larger differences, in multiples of these two, count as this one when the typical step is chosen.
const MOST_DIFFERENCE: f64 = 20.0;
/// How much more than the median a step must differ.
const TIMES_MEDIAN: f64 = 6.0;
/// Fewest steps among which one can be odd.
const FEWEST: usize = 4;
/// Largest angle between the axis of a slip and that of the table, degrees.
const SAME_AXIS_DEG: f64 = 20.0;

/// A registered view.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    pub name: String,
    pub angles: ViewAngles,
    /// World to camera, by rows.
    pub rotation: [[f64; 3]; 3],
    pub centre: [f64; 3],
}

/// A step that differs from the others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OddStep {
    /// The view before it.
    pub before: String,
    /// The view after it.
    pub after: String,
    /// The angle by which it differs, degrees.
    pub by_deg: f64,
    /// The displacement by which it differs, as a share of the distance between neighbours.
    pub by_share: f64,
    /// The same as commanded, degrees.
    pub commanded_deg: f64,
    /// The table slipped; otherwise the specimen moved.
    pub is_slip: bool,
}

/// A step between neighbours.
struct Step<'a> {
    before: &'a Placed,
    after: &'a Placed,
    commanded: f64,
    turn: Matrix,
    shift: [f64; 3],
}

/// The odd steps of all rings of equal tilt.
pub(super) fn odd_steps(views: &[Placed]) -> Vec<OddStep> {
    let mut sorted: Vec<&Placed> = views.iter().collect();
    sorted.sort_by(|a, b| {
        let by_tilt = a.angles.tilt_deg.total_cmp(&b.angles.tilt_deg);
        by_tilt.then(a.angles.pan_deg.total_cmp(&b.angles.pan_deg))
    });
    sorted.chunk_by(|a, b| (a.angles.tilt_deg - b.angles.tilt_deg).abs() < 1e-3).flat_map(of_ring).collect()
}

fn of_ring(ring: &[&Placed]) -> Vec<OddStep> {
    let all: Vec<Step<'_>> = ring.windows(2).filter_map(|pair| Some(step(pair.first()?, pair.get(1)?))).collect();
    // a gap in the ring makes a longer step
    let usual = median(all.iter().map(|step| step.commanded).collect());
    let steps: Vec<Step<'_>> = all.into_iter().filter(|step| (step.commanded - usual).abs() < 1e-3).collect();
    if steps.len() < FEWEST {
        return Vec::new();
    }
    let apart = |a: &Step<'_>, b: &Step<'_>| angle(&times(&transposed(&a.turn), &b.turn));
    let usual = median(steps.iter().map(|step| length(step.shift)).collect());
    let differ = |a: &Step<'_>, b: &Step<'_>| {
        (apart(a, b) / LEAST_DEG).max(length(minus(a.shift, b.shift)) / (usual * LEAST_SHARE)).min(MOST_DIFFERENCE)
    };
    let sums = |a: &Step<'_>| steps.iter().map(|b| differ(a, b)).sum::<f64>();
    let Some(typical) = steps.iter().min_by(|a, b| sums(a).total_cmp(&sums(b))) else { return Vec::new() };
    let chord = length(typical.shift);
    let differences: Vec<(f64, f64)> =
        steps.iter().map(|step| (apart(typical, step), length(minus(step.shift, typical.shift)) / chord)).collect();
    let [most_deg, most_share] = [
        LEAST_DEG.max(TIMES_MEDIAN * median(differences.iter().map(|(turn, _)| *turn).collect())),
        LEAST_SHARE.max(TIMES_MEDIAN * median(differences.iter().map(|(_, shift)| *shift).collect())),
    ];
    let is_odd = |at: usize| differences.get(at).is_some_and(|(turn, shift)| *turn > most_deg || *shift > most_share);
    let mut odd = Vec::new();
    for (at, step) in steps.iter().enumerate() {
        let beside = [at.wrapping_sub(1), at + 1];
        if is_odd(at) && !beside.into_iter().any(is_odd) {
            let (by_deg, by_share) = differences.get(at).copied().unwrap_or_default();
            odd.push(OddStep {
                before: step.before.name.clone(),
                after: step.after.name.clone(),
                by_deg,
                by_share,
                commanded_deg: step.commanded,
                is_slip: is_slip(typical, step, by_deg),
            });
        }
    }
    odd
}

fn step<'a>(before: &'a Placed, after: &'a Placed) -> Step<'a> {
    let turn = times(&after.rotation, &transposed(&before.rotation));
    let shift = apply(&before.rotation, minus(after.centre, before.centre));
    Step { before, after, commanded: after.angles.pan_deg - before.angles.pan_deg, turn, shift }
}

/// A slip turns about the axis of the typical step, and moves the camera along the circle: the chord grows with the
/// sine of half the angle, and turns by half of what is added to it, against the sense of `Q`.
fn is_slip(typical: &Step<'_>, odd: &Step<'_>, by_deg: f64) -> bool {
    let (Some(axis), Some(other)) = (axis(&typical.turn), axis(&times(&transposed(&typical.turn), &odd.turn))) else {
        return false;
    };
    let cosine: f64 = axis.iter().zip(other).map(|(a, b)| a * b).sum();
    if cosine.abs() < SAME_AXIS_DEG.to_radians().cos() {
        return false;
    }
    let half = |degrees: f64| (degrees.to_radians() / 2.0).sin().abs();
    let (usual, turned) = (angle(&typical.turn), angle(&typical.turn) + by_deg.copysign(cosine));
    let stretch = half(turned) / half(usual);
    let along = turned_about(axis, -by_deg.copysign(cosine) / 2.0, typical.shift).map(|x| stretch * x);
    length(minus(odd.shift, along)) < 0.5 * length(minus(along, typical.shift))
}

type Matrix = [[f64; 3]; 3];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum()))
}

fn transposed(m: &Matrix) -> Matrix {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| m[column][row]))
}

fn apply(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|row| (0..3).map(|k| m[row][k] * v[k]).sum())
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A vector turned about an axis (Rodrigues).
fn turned_about(axis: [f64; 3], degrees: f64, v: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let along: f64 = axis.iter().zip(v).map(|(a, b)| a * b).sum();
    let across = [axis[1] * v[2] - axis[2] * v[1], axis[2] * v[0] - axis[0] * v[2], axis[0] * v[1] - axis[1] * v[0]];
    [0, 1, 2].map(|i| v[i] * cos + across[i] * sin + axis[i] * along * (1.0 - cos))
}

/// Angle of a rotation, degrees.
fn angle(m: &Matrix) -> f64 {
    length(twice_sine(m)).atan2(m[0][0] + m[1][1] + m[2][2] - 1.0).to_degrees()
}

/// Axis of a rotation; `None` when it turns by less than a millionth.
fn axis(m: &Matrix) -> Option<[f64; 3]> {
    let v = twice_sine(m);
    let norm = length(v);
    (norm > 1e-6).then(|| v.map(|x| x / norm))
}

/// The axis times twice the sine of the angle.
fn twice_sine(m: &Matrix) -> [f64; 3] {
    [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 12 views by 20 degrees. From view `from` on the specimen is turned by `by` degrees about `z`, and moved.
    fn ring(from: usize, by: f64, moved: [f64; 3]) -> Vec<Placed> {
        let view = |at: usize| {
            let commanded = ViewAngles { pan_deg: 20.0 * at as f64, tilt_deg: 10.0 };
            let is_after = at >= from;
            let real = ViewAngles { pan_deg: commanded.pan_deg + if is_after { by } else { 0.0 }, ..commanded };
            // a little noise
            let noise = 0.001 * (at as f64 * 2.7).sin();
            let shift = if is_after { moved } else { [0.0; 3] };
            let at = real.direction();
            let centre = [0, 1, 2].map(|axis| 5.0 * at[axis] + shift[axis] + noise);
            Placed { name: commanded.file_stem(), angles: commanded, rotation: real.rotation(), centre }
        };
        (0..12).map(view).collect()
    }

    #[test]
    fn a_slip_is_told_from_a_specimen_that_moved() {
        assert_eq!(odd_steps(&ring(99, 0.0, [0.0; 3])), []);
        for by in [4.0, -4.0] {
            let [slip] = odd_steps(&ring(7, by, [0.0; 3])).try_into().expect("one step");
            assert_eq!((slip.before.as_str(), slip.after.as_str()), ("pan120_tilt10", "pan140_tilt10"));
            assert!(slip.is_slip && (slip.by_deg - 4.0).abs() < 0.1, "{slip:?}");
        }
        let [moved] = odd_steps(&ring(4, 0.0, [0.4, 0.3, 0.0])).try_into().expect("one step");
        assert_eq!((moved.before.as_str(), moved.is_slip), ("pan060_tilt10", false));
        let both = odd_steps(&ring(4, 4.0, [0.0, 0.0, 0.8]));
        assert!(both.len() == 1 && !both[0].is_slip, "{both:?}");
    }

    #[test]
    fn a_single_wrong_pose_is_no_step() {
        let mut views = ring(99, 0.0, [0.0; 3]);
        views[5].centre[2] += 1.0;
        assert_eq!(odd_steps(&views), []);
        // nor is a gap
        views.remove(5);
        assert_eq!(odd_steps(&views), []);
        assert_eq!(odd_steps(&views[..3]), []);
    }
}
