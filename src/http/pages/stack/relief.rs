//! The relief of a height map on the page of a stack: where its heights are, and its place. `relief.js` draws it.
//!
//! Without a height map the sharpest slice of each pixel serves as one, in steps between slices.

use maud::{Markup, html};
use serde::Serialize;

use crate::{
    contract::{artifact::StackArtifact, outcome::StackOutcome},
    http::pages::words::text,
    store::Job,
};
use pinstack_science::types::{
    height::{HeightDirection, HeightUnit},
    profile::ProfileInput,
};

/// Value of the pixels that no slice covers, in the map of the sharpest slices.
const NO_SLICE: u16 = u16::MAX;

/// What the script gets: a pixel with the value `v` has the height `offset + (v - 1) scale`.
#[derive(Debug, Serialize)]
struct Relief {
    /// URL of a grey PNG.
    url: String,
    offset: f64,
    scale: f64,
    /// Value of pixels without a height.
    invalid: u16,
    /// Unit in words.
    unit: &'static str,
    /// Whether the near end of the stack is unknown.
    is_near_unknown: bool,
    /// Size of a pixel in the object, mm; null unless heights and widths have one scale.
    mm_per_px: Option<f64>,
}

impl Relief {
    fn of(job: &Job, outcome: &StackOutcome, mm_per_px: Option<f64>) -> Option<Self> {
        let url = |artifact: StackArtifact| link!("/v1/stacks/{}/{}", job.id, artifact.name());
        if let Some(height) = &outcome.height {
            let unit = match height.unit {
                HeightUnit::Mm => "mm",
                HeightUnit::RailMm => "mm of the rail",
                HeightUnit::Steps => "steps between slices",
            };
            let is_near_unknown = height.direction == HeightDirection::WithSliceNumber;
            let mm_per_px = mm_per_px.filter(|_| height.unit == HeightUnit::Mm);
            let (offset, scale, invalid) = (height.offset, height.scale, height.invalid);
            return Some(Self {
                url: url(StackArtifact::Height),
                offset,
                scale,
                invalid,
                unit,
                is_near_unknown,
                mm_per_px,
            });
        }
        StackArtifact::Depth.among(&outcome.artifacts)?;
        Some(Self {
            url: url(StackArtifact::Depth),
            offset: 1.0,
            scale: 1.0,
            invalid: NO_SLICE,
            unit: "steps between slices",
            is_near_unknown: true,
            mm_per_px: None,
        })
    }
}

/// Size of a pixel in the object, mm, in the plane in focus in the reference slice.
pub fn mm_per_px(profile: &ProfileInput) -> Option<f64> {
    Some(profile.pixel_pitch_mm? / profile.magnification?)
}

/// The place of the relief, closed until a person opens it; the layers with these names can colour it.
pub fn section<'a>(
    job: &Job,
    outcome: &StackOutcome,
    layers: impl Iterator<Item = &'a str>,
    mm_per_px: Option<f64>,
) -> Markup {
    let Some(relief) = Relief::of(job, outcome, mm_per_px) else { return html! {} };
    let json = serde_json::to_string(&relief).unwrap_or_default();
    // below 0 the near end becomes the far end
    let least = if relief.is_near_unknown { "-4" } else { "0" };
    html! {
        div id="relief-place" hidden {
            h2 { "Relief" }
            div.tools {
                label { "Height × " input id="stretch" type="range" min=(least) max="4" step="0.1" value="1"; output id="stretch-told" for="stretch" { "1.0" } }
                label { "Coloured by " select id="relief-colour" {
                    @for (at, name) in layers.enumerate() { option value=(at) { (text(name)) } }
                } }
            }
            div.scene {
                canvas id="relief-canvas" tabindex="0" role="img" data-relief=(json) aria-describedby="relief-keys"
                    aria-label="Relief of the heights. The layer Height of the picture above has the same." {}
            }
            p.readout id="relief-told" role="status" {}
            p.soft.small id="relief-keys" {
                "Drag or use the arrow keys to turn it; with Shift they move it. + and − zoom, as do two fingers, and the "
                "wheel after a click. 0 shows it as at first."
            }
        }
    }
}
