//! `/plan`: the planner of a capture, and the dot target to print. The numbers are those of `GET /v1/optics/plan` and
//! `GET /v1/targets/advice`; the input is in the URL.

use axum::{http::Uri, response::Response};
use maud::{Markup, html};

use super::{
    frame::{Frame, PageUser, Place},
    words::sentence,
};
use crate::http::{ApiResult, extract::params};
use pinstack_science::optics::{
    advice::{TargetAdvice, advice},
    plan::{CapturePlan, PlanInput, plan},
};

/// The fields: name, label, value that is suggested, and whether it is needed.
const FIELDS: [(&str, &str, &str, bool); 9] = [
    ("focal_mm", "Focal length, mm", "65", true),
    ("f_number", "f-number", "5.6", true),
    ("magnification", "Magnification", "1", true),
    ("pixel_pitch_um", "Pixel pitch, µm", "4.14", true),
    ("object_depth_mm", "Depth of the object, mm", "5", true),
    ("image_width", "Image width, px", "", false),
    ("image_height", "Image height, px", "", false),
    ("rail_resolution_um", "Smallest step of the rail, µm", "", false),
    ("slice_count", "Number of slices, if given", "", false),
];
const MODES: [(&str, &str); 2] =
    [("fixed_lens", "the sensor, behind a fixed lens"), ("moving_lens", "camera and lens together")];
/// Slices whose rail positions are shown.
const SHOWN: usize = 200;

/// The page.
///
/// # Errors
/// `invalid_request` for a damaged URL.
pub async fn page(user: PageUser, uri: Uri) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    pairs.retain(|(_, value)| !value.trim().is_empty());
    for (_, value) in &mut pairs {
        // as it is written in many countries
        *value = value.trim().replace(',', ".");
    }
    let planned = (!pairs.is_empty()).then(|| planned(&pairs));
    let frame = Frame { title: "Plan", place: Place::Plan, user: Some(&user), script: None };
    Ok(frame.answer(html! {
        h1 { "Plan a capture" }
        p.soft { "How many slices an object needs, where the rail stops for each, and which dot target to print for the calibration." }
        (form(&pairs))
        @match &planned {
            Some(Ok((plan, advice))) => { (answer(plan)) (target(advice)) }
            Some(Err(detail)) => { p.error role="alert" { (sentence(detail)) } }
            None => {}
        }
        (print())
    }))
}

fn planned(pairs: &[(String, String)]) -> Result<(CapturePlan, TargetAdvice), String> {
    let input: PlanInput = params::typed(pairs).map_err(|error| error.fault().detail.clone())?;
    let plan = plan(&input).map_err(|error| crate::contract::Fault::from(error).detail)?;
    let advice = advice(&plan);
    Ok((plan, advice))
}

fn form(pairs: &[(String, String)]) -> Markup {
    let given = |name: &str| pairs.iter().find(|(given, _)| given == name).map(|(_, value)| value.as_str());
    html! {
        form.filters method="get" action=(link!("/plan")) {
            div.fields {
                @for (name, label, suggested, is_needed) in FIELDS {
                    div.short {
                        label for=(name) { (label) }
                        input id=(name) name=(name) inputmode="decimal" autocomplete="off" required[is_needed]
                            value=(given(name).unwrap_or(if pairs.is_empty() { suggested } else { "" }));
                    }
                }
                div {
                    label for="mode" { "What moves" }
                    select id="mode" name="mode" {
                        @for (value, words) in MODES { option value=(value) selected[given("mode") == Some(value)] { (words) } }
                    }
                }
                div.buttons { button.main type="submit" { "Plan" } }
            }
        }
    }
}

fn answer(plan: &CapturePlan) -> Markup {
    html! {
        section {
            h2 { (plan.slice_count) " slices, one every " (format!("{:.4}", plan.step_mm)) " mm" }
            @if !plan.warnings.is_empty() {
                ul.warnings { @for warning in &plan.warnings { li { (sentence(&warning.detail)) } } }
            }
            dl.facts {
                dt { "Travel of the rail" } dd { (format!("{:.3}", plan.travel_mm)) " mm" }
                dt { "Depth of field" } dd { (format!("{:.4}", plan.depth_of_field_mm.total)) " mm" }
                @if let Some(contrast) = plan.contrast_between_slices {
                    dt { "Contrast between slices" } dd { (format!("{:.0}", 100.0 * contrast)) " % of that in focus, in fine detail (half the Nyquist frequency)" }
                }
                dt { "Distance to the object" } dd { (format!("{:.2}", plan.object_distance_mm)) " mm from the lens" }
                @if let Some([width, height]) = plan.field_of_view_mm { dt { "Field of view" } dd { (format!("{width:.2} × {height:.2}")) " mm" } }
                dt { "Effective f-number" } dd { (format!("{:.1}", plan.effective_f_number)) }
            }
            details {
                summary { "Rail positions" }
                div.wide tabindex="0" role="region" aria-label="Rail positions" { table {
                    thead { tr { @for head in ["Slice", "Rail, mm", "Scale", "Brightness"] { th scope="col" { (head) } } } }
                    tbody { @for slice in plan.slices.iter().take(SHOWN) { tr {
                        td { (slice.index) } td { (format!("{:.4}", slice.rail_mm)) } td { (format!("{:.5}", slice.scale)) }
                        td { (format!("{:.3}", slice.exposure_ratio)) }
                    } } }
                } }
                @if plan.slices.len() > SHOWN { p.soft { "The first " (SHOWN) " are shown." } }
            }
        }
    }
}

fn target(advice: &TargetAdvice) -> Markup {
    html! {
        section {
            h2 { "Dot target" }
            p { "Dots every " strong { (format!("{:.3}", advice.pitch_mm)) " mm" }
                @if let (Some(columns), Some(rows)) = (advice.columns, advice.rows) { ", " (columns) " columns and " (rows) " rows fill the picture" }
                "." }
            @for note in &advice.notes { p.soft { (sentence(note)) } }
            @match &advice.target {
                Some(url) => { p { a.button.main href=(url) { "Open the target to print" } } }
                // a pitch that is not printed has a note
                None if advice.columns.is_some() => {}
                None => { p.soft { "Give width and height of the image to get the target." } }
            }
        }
    }
}

/// The form for a target of known size.
fn print() -> Markup {
    let fields = [("pitch_mm", "Pitch, mm", "2"), ("columns", "Columns", "14"), ("rows", "Rows", "10")];
    html! {
        section {
            h2 { "Print a dot target" }
            p.soft { "Print it at 100 %. On A4 and Letter, measure the line below the dots; on paper as large as the \
                target, which has no line, measure the distance between the first and the last dot of a row: (columns - \
                1) pitches." }
            form.filters method="get" action=(link!("/v1/targets/dots")) {
                div.fields {
                    @for (name, label, value) in fields {
                        div.short {
                            label for={ "print-" (name) } { (label) }
                            input id={ "print-" (name) } name=(name) inputmode="decimal" value=(value) required autocomplete="off";
                        }
                    }
                    div {
                        label for="paper" { "Paper" }
                        select id="paper" name="paper" { option value="a4" { "A4" } option value="letter" { "Letter" } option value="fit" { "as large as the target" } }
                    }
                    div {
                        label for="coded" { "Dots" }
                        select id="coded" name="coded" { option value="true" { "of two sizes: every dot is unique" } option value="false" { "all alike" } }
                    }
                    div.buttons { button type="submit" { "Open as PDF" } }
                }
            }
        }
    }
}
