//! The viewer: which pictures it can show, and its controls. `viewer.js` draws, `compare.js` is its controls.

use maud::{Markup, html};
use serde::Serialize;
use uuid::Uuid;

use super::{
    comparison, relief,
    tiles::{LIGHT, SLICE, ShownLight},
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

/// A picture that the viewer can show, or the slices of a light.
#[derive(Serialize)]
struct Layer {
    name: String,
    /// URL of its tiles; level, x and y follow. Of slices, their number comes first.
    tiles: String,
    /// Version of the tiles.
    version: String,
    width: u32,
    height: u32,
    /// Position of its top-left pixel in the image of this stack, px: not 0 if a run is cropped otherwise.
    at: [i64; 2],
    /// Number of slices.
    #[serde(skip_serializing_if = "Option::is_none")]
    slices: Option<usize>,
}

/// What the viewer gets.
#[derive(Serialize)]
struct Scene {
    tile: u32,
    layers: Vec<Layer>,
}

/// What the viewer shows.
pub struct Shown<'a> {
    /// The stack.
    pub job: &'a Job,
    /// Its outcome.
    pub outcome: &'a StackOutcome,
    /// The lights whose slices can be shown.
    pub lights: &'a [ShownLight<'a>],
    /// Other runs of the same pictures: the image of each can be shown.
    pub runs: &'a [Job],
    /// The stack that is shown beside this one, with all its pictures.
    pub beside: Option<&'a Job>,
    /// Size of a pixel in the object, mm, where it is known.
    pub mm_per_px: Option<f64>,
}

impl Shown<'_> {
    fn layer(&self, name: String, tiles: String, version: &str, outcome: &StackOutcome) -> Layer {
        let corner = |axis: usize| {
            i64::from(outcome.image.crop_offset_px[axis]) - i64::from(self.outcome.image.crop_offset_px[axis])
        };
        Layer {
            name,
            tiles,
            version: version.chars().take(12).collect(),
            width: outcome.image.width,
            height: outcome.image.height,
            at: [corner(0), corner(1)],
            slices: None,
        }
    }

    /// The pictures of a stack; their names begin with `prefix`.
    fn pictures(&self, job: &Job, outcome: &StackOutcome, prefix: &str) -> Vec<Layer> {
        let layer = |named: &str, tiles: &str, stored: &Artifact| {
            self.layer(format!("{prefix}{named}"), link!("/stacks/{}/tiles/{tiles}", job.id), &stored.sha256, outcome)
        };
        let files = &outcome.artifacts;
        let of_light = |stored: &Artifact| {
            let light = light_of(&stored.name)?;
            Some(layer(&format!("Light {light}"), &format!("{LIGHT}{light}"), stored))
        };
        let mut lights: Vec<Layer> = files.iter().filter_map(of_light).collect();
        let mut all = Vec::new();
        for artifact in StackArtifact::ALL {
            let Some(((named, _), stored)) = artifact.layer().zip(artifact.among(files)) else { continue };
            all.push(layer(named, artifact.name(), stored));
            if artifact == StackArtifact::Image {
                all.append(&mut lights);
            }
        }
        all
    }

    /// The slices of a light, warped to the reference slice, from the one that is fused first.
    fn slices(&self, light: &ShownLight<'_>) -> Layer {
        let tiles = link!("/stacks/{}/tiles/{SLICE}{}-", self.job.id, light.name);
        let name = format!("Slices, {} light, aligned", light.name);
        let slices = Some(light.slices);
        Layer { slices, ..self.layer(name, tiles, env!("CARGO_PKG_VERSION"), self.outcome) }
    }

    /// All pictures, and the index of the first one of another stack.
    fn layers(&self) -> (Vec<Layer>, usize) {
        let mut all = self.pictures(self.job, self.outcome, "");
        all.extend(self.lights.iter().map(|light| self.slices(light)));
        let own = all.len();
        let is_beside = |id: Uuid| self.beside.is_some_and(|beside| beside.id == id);
        for job in self.beside.into_iter().chain(self.runs.iter().filter(|run| !is_beside(run.id))) {
            let Ok(outcome) = of_stack(job) else { continue };
            let is_run = job.request.upload().sha256 == self.job.request.upload().sha256;
            let prefix = if is_run { String::new() } else { format!("{}, ", name(job)) };
            let pictures = self.pictures(job, outcome, &format!("{prefix}{}: ", comparison::told(job)));
            all.extend(pictures.into_iter().take(if is_beside(job.id) { usize::MAX } else { 1 }));
        }
        (all, own)
    }

    /// The section of the page.
    pub fn section(&self) -> Markup {
        let (all, own) = self.layers();
        let names: Vec<String> = all.iter().map(|layer| layer.name.clone()).collect();
        let pictures = all.iter().take(own - self.lights.len()).map(|layer| layer.name.as_str());
        let relief = relief::section(self.job, self.outcome, pictures, self.mm_per_px);
        let scene = serde_json::to_string(&Scene { tile: TILE, layers: all }).unwrap_or_default();
        let (width, height) = (self.outcome.image.width, self.outcome.image.height);
        // what is beside this stack is shown at once
        let beside = self.beside.filter(|beside| of_stack(beside).is_ok()).map(|_| own);
        html! {
            section aria-label="Viewer" {
                div.tools {
                    (choice("layer", ["Show ", "Slice "], None, &names, Some(0)))
                    (choice("other", ["Compare with ", "Slice at the right "], Some("nothing"), &names, beside))
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
                    canvas id="viewer" tabindex="0" role="img" data-scene=(scene) data-own=(own) data-mm-per-px=[self.mm_per_px]
                        aria-label={ "Picture of " (width) " by " (height) " pixels. Arrow keys move it, plus and minus zoom, 0 shows all of it, 1 shows every pixel. Comma and full stop step through slices. With values and lengths on, M sets the ends of a length in the middle." } {}
                    input.divider id="divider" type="range" min="0" max="100" step="any" value="50" aria-label="Divider" hidden;
                    span.named id="layer-named" aria-hidden="true" hidden {}
                    span.named.right id="other-named" aria-hidden="true" hidden {}
                }
                p.readout id="readout" { (width) " × " (height) " px" }
                (relief)
            }
        }
    }
}

/// The choice of a picture, and of its slice.
fn choice(id: &str, [label, slice]: [&str; 2], none: Option<&str>, names: &[String], chosen: Option<usize>) -> Markup {
    html! {
        label { (label) select id=(id) {
            @if let Some(none) = none { option value="" { (none) } }
            @for (at, name) in names.iter().enumerate() { option value=(at) selected[chosen == Some(at)] { (text(name)) } }
        } }
        label id={ (id) "-slices" } hidden { (slice) input id={ (id) "-slice" } type="range" min="0" step="1" value="0"; output id={ (id) "-told" } for={ (id) "-slice" } {} }
    }
}
