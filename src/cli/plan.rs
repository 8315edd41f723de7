//! `pinstack plan`: a capture plan and the target for it, without a server.

use anyhow::anyhow;
use clap::{Args, ValueEnum};

use super::output::say;
use pinstack_science::{
    optics::{
        advice::advice,
        plan::{CapturePlan, PlanInput, plan},
    },
    types::profile::CaptureMode,
};

/// Plan a capture: depth of field, number of slices, rail positions, and the dot target for the calibration
#[derive(Debug, Args)]
pub struct Plan {
    /// Focal length of the lens at its setting, mm
    #[arg(long, value_name = "MM")]
    focal_mm: f64,
    /// f-number that is set on the lens
    #[arg(long, value_name = "N")]
    f_number: f64,
    /// Magnification at the middle of the object. Give either this or --object-distance-mm
    #[arg(long, value_name = "M")]
    magnification: Option<f64>,
    /// Distance from the lens to the middle of the object, mm
    #[arg(long, value_name = "MM")]
    object_distance_mm: Option<f64>,
    /// Size of one pixel on the sensor, micrometres
    #[arg(long, value_name = "UM")]
    pixel_pitch_um: f64,
    /// Depth of the object along the optical axis, mm
    #[arg(long, value_name = "MM")]
    object_depth_mm: f64,
    /// What moves between slices
    #[arg(long, value_enum, default_value_t = Mode::FixedLens)]
    mode: Mode,
    /// Width of the image, px
    #[arg(long, value_name = "PX")]
    image_width: Option<u32>,
    /// Height of the image, px
    #[arg(long, value_name = "PX")]
    image_height: Option<u32>,
    /// Diameter of the exit pupil divided by that of the entrance pupil
    #[arg(long, value_name = "P", default_value_t = 1.0)]
    pupil_ratio: f64,
    /// Fraction of the depth of field (geometry and diffraction) by which neighbouring slices overlap, 0 to 0.95
    #[arg(long, value_name = "SHARE", default_value_t = 0.5)]
    overlap: f64,
    /// Wavelength of the light, nm
    #[arg(long, value_name = "NM", default_value_t = 550.0)]
    wavelength_nm: f64,
    /// Diameter of the circle of confusion, micrometres [default: 2.5 pixels]
    #[arg(long, value_name = "UM")]
    coc_um: Option<f64>,
    /// Smallest step of the rail, micrometres
    #[arg(long, value_name = "UM")]
    rail_resolution_um: Option<f64>,
    /// Number of slices, if it is fixed; default: as many as the depth needs
    #[arg(long, value_name = "N")]
    slices: Option<u32>,
    /// Print JSON, as GET /v1/optics/plan answers
    #[arg(long)]
    json: bool,
}

/// What moves between slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Mode {
    /// The sensor; the lens is fixed
    FixedLens,
    /// Camera and lens together
    MovingLens,
}

impl Plan {
    /// Runs the command.
    ///
    /// # Errors
    /// What [`plan`] refuses.
    pub fn run(self) -> anyhow::Result<()> {
        let input = PlanInput {
            focal_mm: self.focal_mm,
            f_number: self.f_number,
            magnification: self.magnification,
            object_distance_mm: self.object_distance_mm,
            pixel_pitch_um: self.pixel_pitch_um,
            object_depth_mm: self.object_depth_mm,
            mode: match self.mode {
                Mode::FixedLens => CaptureMode::FixedLens,
                Mode::MovingLens => CaptureMode::MovingLens,
            },
            image_width: self.image_width,
            image_height: self.image_height,
            pupil_ratio: self.pupil_ratio,
            overlap: self.overlap,
            wavelength_nm: self.wavelength_nm,
            coc_um: self.coc_um,
            rail_resolution_um: self.rail_resolution_um,
            slice_count: self.slices,
        };
        let plan = plan(&input).map_err(|error| anyhow!("{}", error.detail))?;
        if self.json {
            say(serde_json::to_string_pretty(&plan)?);
        } else {
            say(text(&plan).trim_end());
        }
        Ok(())
    }
}

/// The plan as a table.
fn text(plan: &CapturePlan) -> String {
    let field =
        plan.field_of_view_mm.map(|[w, h]| format!("field of view     {w:.2} x {h:.2} mm\n")).unwrap_or_default();
    let common = plan.common_field.map(|share| format!("seen by all       {:.1} % of the width\n", 100.0 * share));
    let contrast = plan.contrast_between_slices.map(|contrast| {
        format!("between slices    {:.0} % of the contrast in focus, at half the Nyquist frequency\n", 100.0 * contrast)
    });
    let mut out = format!(
        "magnification     {:.3} (reference slice {:.3})\nobject distance   {:.2} mm\nprincipal distance {:.2} mm = {:.1} px\n\
         effective f-number {:.1} (Airy disc {:.1} um, circle of confusion {:.1} um)\n\
         depth of field    {:.4} mm (geometric {:.4}, wave {:.4})\n{field}{}\
         slices            {}, reference {}\nrail              {:.4} mm in steps of {:.4} mm (at most {:.4})\n{}\n\
         slice  rail mm   depth mm  scale     brightness  target blur px\n",
        plan.magnification,
        plan.reference_magnification,
        plan.object_distance_mm,
        plan.principal_distance_mm,
        plan.principal_distance_px,
        plan.effective_f_number,
        plan.airy_um,
        plan.coc_um,
        plan.depth_of_field_mm.total,
        plan.depth_of_field_mm.geometric,
        plan.depth_of_field_mm.wave,
        common.unwrap_or_default(),
        plan.slice_count,
        plan.reference_index,
        plan.travel_mm,
        plan.step_mm,
        plan.largest_step_mm,
        contrast.unwrap_or_default(),
    );
    for slice in &plan.slices {
        out.push_str(&format!(
            "{:5}  {:8.4}  {:8.4}  {:.6}  {:10.4}  {:10.1}\n",
            slice.index, slice.rail_mm, slice.depth_mm, slice.scale, slice.exposure_ratio, slice.target_blur_px
        ));
    }
    let target = advice(plan);
    out.push_str(&format!("\ntarget: coded, pitch {} mm ({:.0} px)", target.pitch_mm, target.pitch_px));
    if let (Some(columns), Some(rows)) = (target.columns, target.rows) {
        let pitch = target.pitch_mm;
        out.push_str(&format!(
            "; pinstack target --pitch-mm {pitch} --columns {columns} --rows {rows} --coded --paper fit --out dots.pdf"
        ));
    }
    out.push('\n');
    for note in &target.notes {
        out.push_str(&format!("note: {note}\n"));
    }
    for warning in &plan.warnings {
        out.push_str(&format!("warning: {} ({})\n", warning.detail, warning.code));
    }
    out
}
