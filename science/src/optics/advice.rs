//! The dot target that a capture needs: a pitch that its blur cannot hide, and enough dots for the field of view.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    page::{PITCH_MM, PageFormat, format_of_fit},
    plan::CapturePlan,
};

/// Smallest pitch of a plain target over the largest blur radius. A blur radius of 0.61 pitches erases the dots.
const PLAIN_PITCH: f64 = 2.5;
/// The same for a coded target, which is read up to a blur radius of half the pitch.
const CODED_PITCH: f64 = 2.0;
/// Smallest pitch, px: below it dots have too few pixels.
const LEAST_PX: f64 = 16.0;
/// Fewest dots along the shorter side of the image. The code needs 7.
const FEWEST_DOTS: f64 = 8.0;
/// Most dots along a side: the code repeats after 256.
const MOST_DOTS: f64 = 256.0;
/// Dots beyond the field of view on each side, so that the grid fills the image when it is not centred.
const BEYOND: f64 = 3.0;
/// Below this pitch, a laser printer does not print round dots.
const LASER_MM: f64 = 1.0;
/// Below this pitch, no paper print has round dots.
const FILM_MM: f64 = 0.2;

/// The target for a capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TargetAdvice {
    /// Largest blur radius of a target that is in focus in the reference slice, px.
    pub largest_blur_px: f64,
    /// Smallest pitch for a plain target, mm.
    pub least_pitch_plain_mm: f64,
    /// Smallest pitch for a coded target, mm.
    pub least_pitch_coded_mm: f64,
    /// Largest pitch that leaves 8 dots along the shorter side of the image, mm; null without the size of the image.
    pub largest_pitch_mm: Option<f64>,
    /// The pitch to print, rounded up to two digits, mm: the smallest for a coded target, or a larger one with which
    /// 256 dots fill the field of view.
    pub pitch_mm: f64,
    /// The same in the reference slice, px.
    pub pitch_px: f64,
    /// Columns that fill the field of view, with some to spare; null without the size of the image.
    pub columns: Option<u32>,
    /// Rows that fill the field of view, with some to spare; null without the size of the image.
    pub rows: Option<u32>,
    /// The target as `GET /v1/targets/dots` makes it; null without the size of the image, and if the pitch is larger
    /// than the 100 mm that it prints.
    pub target: Option<String>,
    /// What to consider.
    pub notes: Vec<String>,
}

/// The target for a plan.
pub fn advice(plan: &CapturePlan) -> TargetAdvice {
    let largest_blur_px = plan.slices.iter().map(|slice| slice.target_blur_px).fold(0.0, f64::max);
    // px -> mm on the target, which is in focus in the reference slice
    let mm_per_px = plan.principal_distance_mm / plan.principal_distance_px / plan.reference_magnification;
    let field = plan.field_of_view_mm.map(|size| size.map(|mm| mm * plan.magnification / plan.reference_magnification));
    let least = |factor: f64| (factor * largest_blur_px).max(LEAST_PX) * mm_per_px;
    let (plain, coded) = (least(PLAIN_PITCH), least(CODED_PITCH));
    // where little blur would allow a finer pitch than 256 dots across the field have, the dots fill the field
    let filling = field.map_or(0.0, |[width, height]| width.max(height) / (MOST_DOTS - 2.0 * BEYOND));
    let [finest, coarsest] = PITCH_MM;
    let pitch_mm = rounded_up(coded.max(filling).max(finest));
    let dots = |side: f64| (side / pitch_mm + 2.0 * BEYOND).ceil() as u32;
    let size = field.map(|size| size.map(dots));
    let shorter_side_mm = field.map(|[width, height]| width.min(height));
    let largest_pitch_mm = shorter_side_mm.map(|side| side / FEWEST_DOTS);
    let target = size.filter(|_| pitch_mm <= coarsest).map(|[columns, rows]| {
        let format = match format_of_fit(pitch_mm, [columns, rows]) {
            PageFormat::Pdf => "pdf",
            PageFormat::Svg => "svg",
        };
        format!(
            "/v1/targets/dots?pitch_mm={pitch_mm}&columns={columns}&rows={rows}&coded=true&paper=fit&format={format}"
        )
    });
    let mut notes = Vec::new();
    if largest_pitch_mm.is_some_and(|largest| largest < pitch_mm) {
        let least_side_px = FEWEST_DOTS * LEAST_PX;
        notes.push(if CODED_PITCH * largest_blur_px > LEAST_PX {
            "no pitch suits this capture: the blur needs a larger one than leaves 8 dots in the image; calibrate with \
             a smaller aperture than the capture has (the geometry is the same), or with less depth"
                .to_owned()
        } else if shorter_side_mm.is_some_and(|side| side / mm_per_px < least_side_px - 0.5) {
            format!(
                "no pitch suits this capture: the image has fewer than {least_side_px} px along its shorter side; \
                 calibrate with images of full size"
            )
        } else {
            "no pitch suits this capture: the finest that can be printed leaves fewer than 8 dots along the shorter \
             side of the image; calibrate with images of full size, or use a smaller magnification"
                .to_owned()
        });
    }
    if pitch_mm > coarsest {
        notes.push(format!(
            "a pitch of {pitch_mm} mm is larger than the {coarsest} mm that are printed; use a larger magnification, \
             or have the target made elsewhere"
        ));
    }
    if pitch_mm < FILM_MM {
        notes.push("dots of this size need chrome on glass (a calibration slide)".to_owned());
    } else if pitch_mm < LASER_MM {
        notes.push(
            "dots of this size need a photo print on film or a photo plotter of at least 2400 dpi; on paper of a laser \
             printer they are not round"
                .to_owned(),
        );
    }
    if plain > pitch_mm {
        notes.push(format!("a plain target needs a pitch of at least {} mm", rounded_up(plain)));
    }
    TargetAdvice {
        largest_blur_px,
        least_pitch_plain_mm: plain,
        least_pitch_coded_mm: coded,
        largest_pitch_mm,
        pitch_mm,
        pitch_px: pitch_mm / mm_per_px,
        columns: size.map(|[columns, _]| columns),
        rows: size.map(|[_, rows]| rows),
        target,
        notes,
    }
}

/// A number rounded up to two digits.
fn rounded_up(value: f64) -> f64 {
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    let rounded = (value / unit - 1e-9).ceil() * unit;
    // without the error of the multiplication, which would be printed
    format!("{rounded:.2e}").parse().unwrap_or(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::page::{Paper, TargetInput, TargetPage};
    use crate::optics::plan::{PlanInput, plan};

    fn input() -> PlanInput {
        serde_json::from_value(serde_json::json!({
            "focal_mm": 65.0, "f_number": 8.0, "magnification": 1.0, "pixel_pitch_um": 4.14, "object_depth_mm": 5.0,
            "mode": "fixed_lens", "image_width": 8688, "image_height": 5792
        }))
        .expect("a plan")
    }

    #[test]
    fn the_blur_at_the_ends_gives_the_pitch() {
        let plan = plan(&input()).expect("a plan");
        let advice = advice(&plan);
        let blur = plan.slices[0].target_blur_px.max(plan.slices[plan.slices.len() - 1].target_blur_px);
        assert_eq!(advice.largest_blur_px, blur);
        let mm = 0.00414 / plan.reference_magnification;
        assert!((advice.least_pitch_plain_mm - 2.5 * blur * mm).abs() < 1e-9);
        assert!(advice.pitch_mm >= advice.least_pitch_coded_mm && advice.pitch_mm < 1.11 * advice.least_pitch_coded_mm);
        assert!(advice.pitch_px >= 2.0 * blur);
        let [width, _] = plan.field_of_view_mm.expect("the size is known");
        let columns = f64::from(advice.columns.expect("the size is known"));
        assert!(columns * advice.pitch_mm > width);
        assert!(advice.target.expect("the size is known").contains(&format!("pitch_mm={}", advice.pitch_mm)));
    }

    #[test]
    fn the_target_fills_the_field_and_can_be_printed_whatever_the_blur_is() {
        for (magnification, object_depth_mm, pixel_pitch_um) in
            [(1.0, 0.5, 4.14), (0.5, 1.0, 3.76), (5.0, 2.0, 4.14), (10.0, 0.05, 1.2), (0.02, 10.0, 4.0)]
        {
            let magnification = Some(magnification);
            let plan = plan(&PlanInput { magnification, object_depth_mm, pixel_pitch_um, ..input() }).expect("a plan");
            let advice = advice(&plan);
            let field = plan.field_of_view_mm.expect("the size is known");
            let dots = [advice.columns, advice.rows].map(|n| n.expect("the size is known"));
            for axis in 0..2 {
                let covered = f64::from(dots[axis] - 1) * advice.pitch_mm;
                assert!(covered > field[axis] && dots[axis] <= 256, "{magnification:?}: {advice:?}");
            }
            let [columns, rows] = dots;
            let target = advice.target.expect("the size is known");
            let format = if target.ends_with("&format=pdf") { PageFormat::Pdf } else { PageFormat::Svg };
            let page = TargetInput { pitch_mm: advice.pitch_mm, columns, rows, paper: Paper::Fit, format, ..page() };
            assert!(TargetPage::new(&page).is_ok(), "{page:?}");
            // of the smallest, readers would show no PDF
            assert_eq!(format == PageFormat::Svg, magnification == Some(10.0), "{target}");
        }
    }

    #[test]
    fn the_target_is_measured_in_the_reference_slice() {
        // with two slices the reference is at an end of the object
        let deep = PlanInput { object_depth_mm: 40.0, slice_count: Some(2), f_number: 32.0, ..input() };
        let plan = plan(&deep).expect("a plan");
        assert!((plan.reference_magnification / plan.magnification - 1.0).abs() > 0.1, "{plan:?}");
        let advice = advice(&plan);
        let mm = 0.00414 / plan.reference_magnification;
        assert!((advice.pitch_mm / advice.pitch_px / mm - 1.0).abs() < 1e-9);
        for (side, dots) in [8688.0, 5792.0].into_iter().zip([advice.columns, advice.rows]) {
            let covered = (f64::from(dots.expect("the size is known")) - 6.0) * advice.pitch_mm;
            assert!((0.0..=advice.pitch_mm).contains(&(covered - side * mm)), "{advice:?}");
        }
    }

    #[test]
    fn a_pitch_that_is_not_printed_gives_no_target() {
        let far = PlanInput { magnification: Some(1e-4), object_depth_mm: 10.0, ..input() };
        let advice = advice(&plan(&far).expect("a plan"));
        assert!(advice.pitch_mm > 100.0 && advice.columns.is_some() && advice.target.is_none(), "{advice:?}");
        let note = advice.notes.iter().find(|note| note.contains("larger than the 100 mm")).expect("a note");
        assert!(note.contains("use a larger magnification"), "{note}");
    }

    #[test]
    fn a_small_image_is_told_from_a_large_blur() {
        let small = |side| PlanInput { image_width: Some(1000), image_height: Some(side), ..input() };
        let little = PlanInput { object_depth_mm: 0.01, ..small(100) };
        let notes = advice(&plan(&little).expect("a plan")).notes;
        let wanted = "no pitch suits this capture: the image has fewer than 128 px along its shorter side; calibrate \
                      with images of full size";
        assert_eq!(notes.first().map(String::as_str), Some(wanted));
        let blurred = advice(&plan(&small(100)).expect("a plan")).notes;
        assert!(blurred.iter().any(|note| note.contains("the blur needs a larger one")), "{blurred:?}");
        let enough = advice(&plan(&PlanInput { object_depth_mm: 0.01, ..small(300) }).expect("a plan")).notes;
        assert!(!enough.iter().any(|note| note.starts_with("no pitch suits")), "{enough:?}");
    }

    fn page() -> TargetInput {
        serde_json::from_value(serde_json::json!({ "pitch_mm": 1.0, "columns": 2, "rows": 2, "coded": true }))
            .expect("a page")
    }

    #[test]
    fn a_blur_that_hides_every_pitch_is_told() {
        let blurred = PlanInput { object_depth_mm: 40.0, f_number: 4.0, slice_count: Some(100), ..input() };
        let advice = advice(&plan(&blurred).expect("a plan"));
        assert!(advice.notes.iter().any(|note| note.starts_with("no pitch suits")), "{advice:?}");
    }

    #[test]
    fn numbers_are_rounded_up_to_two_digits() {
        for (value, rounded) in [(0.123, 0.13), (0.12, 0.12), (1.01, 1.1), (9.91, 10.0), (25.0, 25.0)] {
            assert_eq!(rounded_up(value), rounded, "{value}");
        }
    }
}
