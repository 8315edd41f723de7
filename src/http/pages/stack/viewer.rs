//! The viewer: which layers it can show, and its controls. `viewer.js` draws.

use maud::{Markup, html};
use serde::Serialize;

use super::{
    relief,
    tiles::{LIGHT, SLICE},
};
use crate::{
    contract::{
        artifact::{StackArtifact, light_of},
        outcome::{Artifact, StackOutcome},
    },
    http::{
        artifacts::outcome::of_stack,
        pages::{stacks::row::name, words::text},
        state::conversions::pyramid::TILE,
    },
    store::Job,
};

/// A picture that the viewer can show.
#[derive(Serialize)]
struct Layer {
    name: String,
    /// URL of its tiles; level, x and y follow.
    tiles: String,
    /// Version of the tiles.
    version: String,
    width: u32,
    height: u32,
}

/// What the viewer gets.
#[derive(Serialize)]
struct Scene {
    tile: u32,
    layers: Vec<Layer>,
}

fn layers(job: &Job, outcome: &StackOutcome, prefix: &str) -> Vec<Layer> {
    let layer = |named: &str, tiles: &str, stored: &Artifact| Layer {
        name: format!("{prefix}{named}"),
        tiles: link!("/stacks/{}/tiles/{tiles}", job.id),
        version: stored.sha256.chars().take(12).collect(),
        width: outcome.image.width,
        height: outcome.image.height,
    };
    let files = &outcome.artifacts;
    let of_artifact = |artifact: StackArtifact| {
        let ((named, _), stored) = artifact.layer().zip(artifact.among(files))?;
        Some((artifact, layer(named, artifact.name(), stored)))
    };
    let of_light = |stored: &Artifact| {
        let light = light_of(&stored.name)?;
        Some(layer(&format!("Light {light}"), &format!("{LIGHT}{light}"), stored))
    };
    let mut lights: Vec<Layer> = files.iter().filter_map(of_light).collect();
    let mut all = Vec::new();
    for (artifact, layer) in StackArtifact::ALL.into_iter().filter_map(of_artifact) {
        all.push(layer);
        if artifact == StackArtifact::Image {
            all.append(&mut lights);
        }
    }
    all
}

/// The slices of a stack, warped to the reference slice, from the one that is fused first.
fn slices(job: &Job, outcome: &StackOutcome, count: usize) -> impl Iterator<Item = Layer> {
    (0..count).map(move |index| Layer {
        name: format!("Slice {index} of 0 to {}, aligned", count.saturating_sub(1)),
        tiles: link!("/stacks/{}/tiles/{SLICE}{index}", job.id),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        width: outcome.image.width,
        height: outcome.image.height,
    })
}

/// The viewer of a stack, with `slices_shown` of its slices; `other` is a stack to compare with, `mm_per_px` the size
/// of a pixel in the object, where it is known.
pub fn viewer(
    job: &Job,
    outcome: &StackOutcome,
    slices_shown: usize,
    other: Option<&Job>,
    mm_per_px: Option<f64>,
) -> Markup {
    let mut all = layers(job, outcome, "");
    let relief = relief::section(job, outcome, all.iter().map(|layer| layer.name.as_str()), mm_per_px);
    all.extend(slices(job, outcome, slices_shown));
    let own = all.len();
    if let Some((other, outcome)) = other.and_then(|other| Some((other, of_stack(other).ok()?))) {
        all.extend(layers(other, outcome, &format!("{}: ", name(other))));
    }
    let names: Vec<String> = all.iter().map(|layer| layer.name.clone()).collect();
    let scene = serde_json::to_string(&Scene { tile: TILE, layers: all }).unwrap_or_default();
    let (width, height) = (outcome.image.width, outcome.image.height);
    html! {
        section aria-label="Viewer" {
            div.tools {
                label { "Show " select id="layer" {
                    @for (at, name) in names.iter().enumerate() { option value=(at) { (text(name)) } }
                } }
                label { "Compare with " select id="other" {
                    option value="" { "nothing" }
                    @for (at, name) in names.iter().enumerate() { option value=(at) { (text(name)) } }
                } }
                label id="divide" hidden { "Divider " input id="divider" type="range" min="0" max="1000" value="500"; }
                label { "Behind " select id="behind" {
                    option value="checks" { "checkerboard" } option value="black" { "black" }
                    option value="white" { "white" } option value="grey" { "grey" }
                } }
                div.buttons {
                    button type="button" id="fit" { "Whole image" }
                    button type="button" id="full" { "1 : 1" }
                    button type="button" id="closer" aria-label="Closer" { "+" }
                    button type="button" id="farther" aria-label="Farther" { "−" }
                    button type="button" id="relief" aria-expanded="false" aria-controls="relief-place" hidden { "Relief" }
                }
            }
            div.viewer {
                canvas id="viewer" tabindex="0" role="img" data-scene=(scene) data-own=(own) data-mm-per-px=[mm_per_px]
                    aria-label={ "Picture of " (width) " by " (height) " pixels. Arrow keys move it, plus and minus zoom, 0 shows all of it, 1 shows every pixel. With values and lengths on, M sets the ends of a length in the middle." } {}
            }
            p.readout id="readout" { (width) " × " (height) " px" }
            (relief)
        }
    }
}
