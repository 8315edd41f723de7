//! The scale between two slices, from the shifts of windows.

use super::Shift;

/// Fewer windows than this do not determine a scale.
const LEAST: usize = 4;

/// Relative scale of the similarity `shift = t + (s R - 1) x` that fits the shifts best (least squares,
/// twice more with windows that disagree left out); none when the windows are too few or on one spot.
pub(super) fn scale(shifts: &[Shift]) -> Option<f64> {
    let mut kept: Vec<Shift> = shifts.to_vec();
    let mut fit = Similarity::fit(&kept)?;
    for _ in 0..2 {
        let mut residuals: Vec<f32> = shifts.iter().map(|shift| fit.residual(shift) as f32).collect();
        let middle = f64::from(super::statistics::median(&mut residuals)?);
        let limit = (3.0 * middle).max(0.05);
        kept = shifts.iter().filter(|shift| fit.residual(shift) <= limit).copied().collect();
        fit = Similarity::fit(&kept)?;
    }
    Some((1.0 + fit.a).hypot(fit.b))
}

/// `dx = a x - b y + tx`, `dy = b x + a y + ty`, about the centre of the windows.
struct Similarity {
    centre: (f64, f64),
    a: f64,
    b: f64,
    shift: (f64, f64),
}

impl Similarity {
    fn fit(shifts: &[Shift]) -> Option<Self> {
        if shifts.len() < LEAST {
            return None;
        }
        let count = shifts.len() as f64;
        let mean = |value: fn(&Shift) -> f64| shifts.iter().map(value).sum::<f64>() / count;
        let centre = (mean(|s| s.x), mean(|s| s.y));
        let shift = (mean(|s| s.dx), mean(|s| s.dy));
        let (mut spread, mut along, mut across) = (0.0, 0.0, 0.0);
        for s in shifts {
            let (x, y) = (s.x - centre.0, s.y - centre.1);
            spread += x * x + y * y;
            along += x * s.dx + y * s.dy;
            across += x * s.dy - y * s.dx;
        }
        (spread > count).then(|| Self { centre, a: along / spread, b: across / spread, shift })
    }

    fn residual(&self, s: &Shift) -> f64 {
        let (x, y) = (s.x - self.centre.0, s.y - self.centre.1);
        let dx = self.a * x - self.b * y + self.shift.0;
        let dy = self.b * x + self.a * y + self.shift.1;
        (s.dx - dx).hypot(s.dy - dy)
    }
}
