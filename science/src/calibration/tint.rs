//! The tint of a slice: red and blue light over green light, by which slices with another white balance are named.

use super::{detected::Detection, dot_photometry::to_light, statistics::range};
use crate::imaging::{Raster, Samples};

/// Pixels that are read per slice, along each axis; fewer than twice as many in slices that are not a multiple of it.
const SIDE: usize = 700;
/// Largest share of pixels with several channels at full scale, which have lost their tint.
const MAX_CLIPPED: f64 = 0.02;

/// `ln` of red over green and of blue over green: ratios of the mean light within the bounding box of the dots, with
/// the values taken as sRGB. `None` for a grey or a clipped slice.
pub(super) fn tint(slice: &Raster, detection: &Detection) -> Option<[f64; 2]> {
    if slice.channels < 3 {
        return None;
    }
    let span = |axis: usize, size: usize| {
        let (low, high) = range(detection.dots.values().map(|d| d.at[axis]));
        let low = low.clamp(0.0, size as f64) as usize;
        low..(high.clamp(0.0, size as f64) as usize).max(low)
    };
    let (columns, rows) = (span(0, slice.width), span(1, slice.height));
    let stride = (columns.len().max(rows.len()) / SIDE).max(1);
    let table: Vec<f64> = (0..256).map(|v| to_light(f64::from(v))).collect();
    let value = |index: usize| match &slice.samples {
        Samples::Eight(s) => s.get(index).map(|v| table[usize::from(*v)]),
        Samples::Sixteen(s) => s.get(index).map(|v| {
            let (v, part) = (usize::from(*v >> 8), f64::from(*v & 255) / 256.0);
            table[v] + part * (table[(v + 1).min(255)] - table[v])
        }),
    };
    let (mut sums, mut count, mut clipped) = ([0.0; 3], 0.0_f64, 0.0_f64);
    for y in rows.step_by(stride) {
        for x in columns.clone().step_by(stride) {
            let first = (y * slice.width + x) * slice.channels;
            let mut full = 0;
            for (k, sum) in sums.iter_mut().enumerate() {
                let light = value(first + k)?;
                *sum += light;
                full += u8::from(light >= 0.99);
            }
            count += 1.0;
            // where one channel alone is full, the tint is still visible, though larger than measured
            clipped += f64::from(u8::from(full > 1));
        }
    }
    let dark = sums.iter().any(|s| *s < 1e-4 * count);
    (count >= 100.0 && clipped <= MAX_CLIPPED * count && !dark)
        .then(|| [(sums[0] / sums[1]).ln(), (sums[2] / sums[1]).ln()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::calibrate;
    use crate::calibration::testkit::{Shot, render};
    use crate::calibration::tests::Stack;
    use crate::types::NoControl;
    use crate::types::calibration_options::CalibrationOptions;

    #[test]
    fn a_slice_with_another_white_balance_is_named_with_its_size() {
        let slices: Vec<Raster> = (0..6)
            .map(|k| {
                let grey =
                    render(&Shot { width: 240, height: 200, grid: [9, 7], pitch: 24.0, seed: k, ..Shot::default() });
                let Samples::Eight(grey) = grey.samples else { panic!("8 bits") };
                let red = if k == 4 { 0.8 } else { 0.9 };
                let rgb = grey.iter().flat_map(|&v| [(f64::from(v) * red) as u8, v, (f64::from(v) * 0.95) as u8]);
                Raster::eight(240, 200, 3, rgb.collect())
            })
            .collect();
        let found = calibrate(&Stack(&slices), &CalibrationOptions::default(), &NoControl).expect("a calibration");
        let warning = found.warnings.iter().find(|w| w.code == "tint_outlier").expect("a finding");
        assert!(warning.detail.contains("e.png") && !warning.detail.contains("a.png"), "{}", warning.detail);
        assert!(warning.detail.contains("red"), "{}", warning.detail);
    }
}
