//! The rail in the report: growth of the image, fixed point, positions.

use crate::calibration::solve::Solution;
use crate::types::report::RailReport;

/// What the rail law tells about the rail; `None` without a law. `in_mm`: positions are mm.
pub(super) fn report(solution: &Solution, in_mm: bool, [width, height]: [u32; 2]) -> Option<RailReport> {
    let rail = &solution.rail;
    let [scale, turn, x, y] = rail.slopes?;
    let centre = [(f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0];
    let half = centre[0].hypot(centre[1]);
    // the fixed point solves a x + e = 0, with a the scaling and rotation per step
    let size = scale * scale + turn * turn;
    let span = rail.positions.iter().fold(0.0_f64, |m, z| m.max((z - rail.positions[0]).abs()));
    let fixed_point_px = (size.sqrt() * span > 2e-3).then(|| {
        let unit = [-(scale * x + turn * y) / size, -(scale * y - turn * x) / size];
        [centre[0] + half * unit[0], centre[1] + half * unit[1]]
    });
    let off: Vec<f64> = solution.slices.iter().filter_map(|s| s.estimate.off_law).collect();
    let corner_rms_px = (off.iter().map(|o| o * o).sum::<f64>() / off.len().max(1) as f64).sqrt();
    Some(RailReport {
        growth: scale,
        fixed_point_px,
        in_mm,
        positions: rail.positions.clone(),
        measured_positions: match &rail.positions_by_scale {
            Some(positions) => positions.iter().map(|p| p.map(|p| p.0)).collect(),
            None => vec![None; rail.positions.len()],
        },
        corner_rms_px,
    })
}
