//! The camera of a profile: what is known, the line where it is missing, and the fields that measure it, each with a
//! sentence and a drawing. The form that sends a target has the same fields as the page of a profile.

use maud::{Markup, PreEscaped, html};

use crate::contract::Name;
use pinstack_science::types::{profile::ProfileInput, pupils::PrincipalDistanceSource};

/// A number that a person gives: name in the API, label, the purposes of sending that have it, one sentence, drawing.
pub struct Field {
    /// Name in the API, or of a value that the script turns into one.
    pub name: &'static str,
    label: &'static str,
    purposes: &'static str,
    hint: &'static str,
    drawing: &'static str,
}

/// The fields in the order of the form.
pub const FIELDS: [Field; 9] = [
    Field {
        name: "from",
        label: "Refine revision",
        purposes: "no_target",
        hint: "Number of a revision of this profile whose alignment has drifted. Its camera is kept, and the other numbers are not used.",
        drawing: r#"<path stroke-dasharray="4 3" d="M18 8h52v34H18z"/><path d="M26 14h52v34H26z"/><path class="mark" d="M84 10v12M78 16h12"/>"#,
    },
    Field {
        name: "target_pitch_mm",
        label: "Dot pitch, mm",
        purposes: "calibration",
        hint: "From the centre of one dot of the target to the next.",
        drawing: r#"<g class="solid"><circle cx="20" cy="22" r="7"/><circle cx="52" cy="22" r="7"/><circle cx="84" cy="22" r="7"/></g><path class="mark" d="M20 36v14M52 36v14M20 45h32"/>"#,
    },
    Field {
        name: "sensor_width_mm",
        label: "Sensor width, mm",
        purposes: "calibration no_target",
        hint: "The longer side of the sensor, from the data sheet of the camera; the pixel pitch follows from it.",
        drawing: r#"<path d="M20 8h64v30H20z"/><path class="mark" d="M20 42v10M84 42v10M20 48h64"/>"#,
    },
    Field {
        name: "pixel_pitch_mm",
        label: "Pixel pitch, mm",
        purposes: "calibration no_target",
        hint: "The width of one pixel: 0.00414 for 36 mm and 8,688 pixels. Larger if the pictures were reduced.",
        drawing: r#"<path d="M20 6h64v32H20zM36 6v32M52 6v32M68 6v32M20 22h64"/><path class="mark" d="M36 42v10M52 42v10M36 48h16"/>"#,
    },
    Field {
        name: "rail_step_mm",
        label: "Rail step, mm",
        purposes: "calibration no_target",
        hint: "How far the rail goes from one slice to the next; negative if it moves away from the object.",
        drawing: r#"<path d="M10 34h84M30 14v20M50 14v20M70 14v20"/><path class="mark" d="M30 40v12M50 40v12M30 46h20"/><g class="solid"><circle cx="92" cy="22" r="5"/></g>"#,
    },
    Field {
        name: "focal_mm",
        label: "Focal length, mm",
        purposes: "calibration",
        hint: "As engraved on the lens: a check, and a rough camera where nothing else measures it.",
        drawing: r#"<path d="M44 6c10 10 10 26 0 36c-10-10-10-26 0-36M88 8v32M10 24h78" /><path class="mark" d="M44 46v8M88 46v8M44 50h44"/>"#,
    },
    Field {
        name: "pupil_ratio",
        label: "Pupil ratio",
        purposes: "calibration",
        hint: "The aperture as it looks from behind the lens, divided by how it looks from the front.",
        drawing: r#"<path d="M34 8v36M70 8v36"/><path class="mark" d="M34 16v20M70 11v30"/><path d="M10 26h84" stroke-dasharray="2 4"/>"#,
    },
    Field {
        name: "target_advance_mm",
        label: "Target nearer by, mm",
        purposes: "calibration",
        hint: "For one more picture in a folder moved: how much nearer to the lens the target was.",
        drawing: r#"<path d="M16 12h22v26H16zM62 8v36" /><path stroke-dasharray="4 3" d="M48 8v36"/><path class="mark" d="M48 46v8M62 46v8M48 50h14"/>"#,
    },
    Field {
        name: "moved_target",
        label: "Calibration with it nearer",
        purposes: "calibration",
        hint: "Instead of that folder: the id of an earlier calibration with the target nearer.",
        drawing: r#"<path d="M16 12h22v26H16zM62 8v36M48 8v36"/>"#,
    },
];

/// What a profile page asks for beside: needed where no target gave it.
const MAGNIFICATION: Field = Field {
    name: "magnification",
    label: "Magnification",
    purposes: "",
    hint: "Size of the image on the sensor over size of the object; needed only where no target of known pitch gave it.",
    drawing: r#"<path d="M14 14v20M50 8v36M88 2v46M14 14L88 48M14 34L88 2" />"#,
};

/// The distance that gives the positions of a turntable their unit.
pub const RADIUS: Field = Field {
    name: "radius_mm",
    label: "Turntable radius, mm",
    purposes: "scan",
    hint: "From the front of the lens to the point about which the object turns; positions are then in mm.",
    drawing: r#"<ellipse cx="74" cy="34" rx="20" ry="8"/><path d="M74 6v34M8 16h18v16H8z"/><path class="mark" d="M26 44v10M74 44v10M26 49h48"/>"#,
};

impl Field {
    /// The field, hidden for other purposes by the script of the form.
    pub fn input(&self, hides: bool) -> Markup {
        let (name, hint) = (self.name, format!("{}-hint", self.name));
        html! {
            div.field data-for=[hides.then_some(self.purposes)] hidden[hides] {
                svg viewBox="0 0 104 56" aria-hidden="true" { (PreEscaped(self.drawing)) }
                label for=(name) { (self.label) }
                input id=(name) name=(name) inputmode=[(name != "moved_target").then_some("decimal")] autocomplete="off" aria-describedby=(hint);
                span.hint id=(hint) { (self.hint) }
            }
        }
    }
}

/// The choice of what the rail moves.
pub fn capture_mode(purposes: Option<&str>) -> Markup {
    html! {
        div.field data-for=[purposes] hidden[purposes.is_some()] {
            svg viewBox="0 0 104 56" aria-hidden="true" {
                (PreEscaped(r#"<path d="M12 16h26v22H12zM38 20h14v14H38zM8 44h88"/><path class="mark" d="M60 27h28m-7-6l7 6l-7 6"/>"#))
            }
            label for="capture_mode" { "What the rail moves" }
            select id="capture_mode" name="capture_mode" aria-describedby="capture_mode-hint" {
                option value="" { "as the pictures show" }
                option value="moving_lens" { "camera and lens" }
                option value="fixed_lens" { "the sensor, behind a fixed lens" }
                option value="lens_alone" { "the lens alone" }
            }
            span.hint id="capture_mode-hint" { "Needed only if the pictures do not show it." }
        }
    }
}

/// The line for a profile without a camera, with the way to add it.
pub fn missing(rig: &Name, lens: &Name) -> Markup {
    html! {
        p.error.nocamera { strong { "No camera: reconstruction must estimate the focal length." } " "
            a href=(link!("/profiles/{rig}/{lens}#camera")) { "Add the camera" } ", without sending a picture again." }
    }
}

/// The line for results that were made before their profile had a camera; nothing where they have one.
pub fn missing_in_results(
    input: Option<&ProfileInput>,
    has_camera: bool,
    rig: &Name,
    lens: &Name,
    cure: &str,
) -> Markup {
    match input {
        _ if has_camera => html! {},
        Some(input) if input.principal_distance_px().is_some() => html! {
            p.error.nocamera { strong { "No camera: reconstruction must estimate the focal length." } " The profile has one by now: " (cure) "." }
        },
        _ => missing(rig, lens),
    }
}

/// The rows of the camera in a list of facts.
pub fn facts(input: &ProfileInput) -> Markup {
    let pupils = &input.pupils;
    let with = |value: f64, sigma: Option<f64>| {
        sigma.map_or_else(|| format!("{value:.3}"), |sigma| format!("{value:.3} ± {sigma:.2}", sigma = sigma.max(0.01)))
    };
    let source = match input.principal_distance_source {
        Some(PrincipalDistanceSource::CameraRail) => "measured with the rail",
        Some(PrincipalDistanceSource::MovedTarget) => "measured with the moved target",
        Some(PrincipalDistanceSource::PupilRatio) => "from the pupil ratio as given",
        Some(PrincipalDistanceSource::FocalLength) => "rough, from the focal length as given",
        Some(PrincipalDistanceSource::Unknown) | None => "as given",
    };
    html! {
        @if let Some(pitch) = input.pixel_pitch_mm { dt { "Pixel pitch" } dd { (pitch) " mm" } }
        @if let Some(distance) = input.principal_distance_mm {
            dt { "Principal distance" }
            dd { (with(distance, pupils.principal_distance_sigma_mm)) " mm"
                @if let Some(px) = input.principal_distance_px() { " = " (format!("{px:.1}")) " px" } ", " (source) }
        }
        @if let Some(magnification) = input.magnification { dt { "Magnification" } dd { (format!("{magnification:.4}")) } }
        @if let Some(ratio) = pupils.pupil_ratio { dt { "Pupil ratio" } dd { (with(ratio, pupils.pupil_ratio_sigma)) } }
    }
}

/// The section of a profile page: the line or nothing, and the form that gives the profile a camera.
pub fn section(input: &ProfileInput, rig: &Name, lens: &Name, may_write: bool) -> Markup {
    let is_missing = input.principal_distance_px().is_none();
    let is_of_profile =
        |field: &&Field| !field.name.contains("moved") && !["target_advance_mm", "from"].contains(&field.name);
    let fields = FIELDS.iter().filter(is_of_profile);
    html! {
        section id="camera" {
            h2 { "Camera" }
            @if is_missing {
                p.error.nocamera { strong { "No camera: reconstruction must estimate the focal length." }
                    " Bundles of its scans have no intrinsics." @if may_write { " Give what you know; no picture is sent again." } }
            } @else { dl.facts { (facts(input)) } }
            @if may_write {
                details open[is_missing] {
                    summary { @if is_missing { "Add the camera" } @else { "Change the camera" } }
                    form id="camera-form" data-url=(link!("/v1/profiles/{rig}/{lens}/camera")) data-width=(input.image_width.max(input.image_height)) {
                        p.soft { "What stays empty is taken from the calibration. The result is the next revision: the alignment of the slices does not change." }
                        div.measures {
                            @for field in fields { (field.input(false)) }
                            (capture_mode(None)) (MAGNIFICATION.input(false))
                        }
                        p id="told" role="alert" {}
                        div.buttons { button.main type="submit" { "Store the camera" } }
                    }
                }
            }
        }
    }
}
