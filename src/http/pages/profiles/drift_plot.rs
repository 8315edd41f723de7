//! How far a rig moved from revision to revision, as a plot over the revisions.

use maud::{Markup, PreEscaped, html};

use crate::{
    contract::{Name, profile::Profile},
    http::{
        ApiResult, App,
        pages::{
            calibration_report::chart::{Chart, Mark, MarkStyle, Scale},
            words::sentence,
        },
        profiles::drift::between,
    },
};

/// Most revisions that are compared: each is read whole.
const MOST: usize = 12;

/// The plot over the last revisions; `numbers` are theirs, newest first.
///
/// # Errors
/// When the store cannot be read.
pub async fn plot(app: &App, rig: &Name, lens: &Name, numbers: &[u32]) -> ApiResult<Markup> {
    let mut profiles: Vec<Profile> = Vec::new();
    for number in numbers.iter().take(MOST) {
        profiles.extend(app.store.metadata.profile(rig, lens, Some(*number)).await?);
    }
    profiles.reverse();
    let marks: Vec<Mark> = profiles
        .windows(2)
        .enumerate()
        .filter_map(|(at, pair)| {
            let drift = between(&pair[0], &pair[1]);
            let value = drift.worst_px?;
            let title =
                format!("revision {} to {}: {value:.2} px; {}", drift.from_revision, drift.to_revision, drift.detail);
            Some(Mark { slice: at, value, measured: true, sigma: None, second: false, title })
        })
        .collect();
    let steps = profiles.len().saturating_sub(1);
    if steps == 0 {
        return Ok(html! {});
    }
    let last = between(&profiles[steps - 1], &profiles[steps]);
    let (first, newest) = (profiles[0].revision, profiles[steps].revision);
    let chart = Chart {
        title: "Largest movement of an image corner",
        hint: format!("From each revision to the next, from {first} (left) to {newest} (right)"),
        unit: "px",
        count: steps,
        reference: steps,
        bands: Vec::new(),
        marks,
        lines: Vec::new(),
        style: MarkStyle::Bars,
        scale: Scale::Linear(0.5),
        empty: "The revisions cannot be compared: their sizes or slice counts differ.",
    };
    Ok(html! {
        h2 { "Drift over time" }
        p { (sentence(&last.detail)) "." }
        div.plots { (PreEscaped(chart.figure().replace(">slice</text>", ">step</text>"))) }
    })
}
