//! The ball of views of a scan's page: what `ball.js` draws, and its place on the page. The grid and the table of the
//! page have the same as text, so the place is hidden until a script has found that the browser can draw it.

use maud::{Markup, html};
use serde::Serialize;

use crate::{
    contract::{JobState, Verdict},
    http::views::scan::ScanView,
};
use pinstack_science::types::view::ViewAngles;

/// What became of a view, as the pages mark it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mark {
    /// It has a result that can be used.
    Done,
    /// Its result should be looked at, or it differs from its neighbours.
    Look,
    /// It has no result, or one that should not be used.
    Failed,
    /// It waits or is fused.
    Busy,
    /// There is no view at these angles.
    Missing,
}

impl Mark {
    /// The mark of a view.
    pub fn of(view: &ScanView) -> Self {
        match view.state {
            JobState::Queued | JobState::Running => Self::Busy,
            JobState::Failed | JobState::Cancelled => Self::Failed,
            JobState::Succeeded => match view.verdict {
                Some(Verdict::DoNotUse) => Self::Failed,
                Some(Verdict::Look) => Self::Look,
                Some(Verdict::Use) | None if view.outliers.is_empty() => Self::Done,
                Some(Verdict::Use) | None => Self::Look,
            },
        }
    }
}

/// What became of a view, in words.
pub fn words(view: &ScanView) -> String {
    match view.state {
        JobState::Queued => "waiting".to_owned(),
        JobState::Running => format!("{:.0} %", 100.0 * view.progress),
        JobState::Succeeded if Mark::of(view) == Mark::Look => Verdict::Look.words().to_owned(),
        JobState::Succeeded => view.verdict.map_or("done", Verdict::words).to_owned(),
        JobState::Failed => "failed".to_owned(),
        JobState::Cancelled => "cancelled".to_owned(),
    }
}

/// A place on the ball.
#[derive(Debug, Serialize)]
pub struct BallView {
    name: String,
    /// URL of its stack's page; null where a view is missing.
    href: Option<String>,
    pan_deg: f64,
    tilt_deg: f64,
    mark: Mark,
    words: String,
}

impl BallView {
    /// A view whose stack has the page `href`; `None` without angles.
    pub fn of(view: &ScanView, href: String) -> Option<Self> {
        let (pan_deg, tilt_deg) = view.pan_deg.zip(view.tilt_deg)?;
        let (mark, words) = (Mark::of(view), words(view));
        Some(Self { name: view.name.clone(), href: Some(href), pan_deg, tilt_deg, mark, words })
    }

    /// A place without a view.
    pub fn missing(angles: &ViewAngles) -> Self {
        let &ViewAngles { pan_deg, tilt_deg } = angles;
        let (mark, words) = (Mark::Missing, "missing".to_owned());
        Self { name: angles.file_stem(), href: None, pan_deg, tilt_deg, mark, words }
    }
}

/// The views for the script, in the part of the page that follows them, and whether they may change soon.
pub fn data(views: &[BallView], state: JobState) -> Markup {
    let json = serde_json::to_string(views).unwrap_or_default();
    html! { div hidden data-ball=(json) data-state=(state.as_str()) {} }
}

/// The place of the ball.
pub fn section() -> Markup {
    html! {
        section id="ball" hidden {
            h2 { "Ball of views" }
            div.beside {
                div.scene.ball {
                    canvas id="ball-canvas" tabindex="0" role="img" aria-describedby="ball-keys"
                        aria-label="Views of the scan on a ball, by pan and tilt. The grid and the table below have the same as text." {}
                }
                div {
                    p.readout id="ball-told" role="status" { a hidden {} " " span { "Point at a view to see its name; click to open it." } }
                    (legend())
                    p.soft.small id="ball-keys" {
                        "Drag or use the arrow keys to turn it. + and − zoom, as do two fingers, and the wheel after a click. "
                        "0 shows it as at first. N and P step through the views, Enter opens one."
                    }
                }
            }
        }
    }
}

fn legend() -> Markup {
    let marks = [
        ("good", "●", "use it"),
        ("warn", "◆", "look at it"),
        ("bad", "✕", "no result, or do not use it"),
        ("busy", "•", "waiting or running"),
        ("soft", "○", "missing"),
    ];
    html! {
        p.legend aria-hidden="true" {
            @for (class, sign, words) in marks { span { span class=(class) { (sign) } " " (words) } " " }
        }
    }
}
