//! `/scans/{scan}`: the views of a scan by pan and tilt, their table, what is missing or differs, and the files for
//! reconstruction programs.

use std::collections::{BTreeMap, BTreeSet};

use axum::{extract::State, http::Uri, response::Response};
use maud::{Markup, html};

use super::{
    ball::{self, BallView, Mark},
    frame::{Frame, PageUser, Place, respond},
    notes,
    profiles::camera,
    reconstruction,
    stacks::thumbnail,
    words::{count, sentence, state, text, verdict},
};
use crate::{
    contract::{JobState, Verdict},
    http::{
        ApiResult, App,
        auth::Caller,
        extract::params,
        scans::{ScanName, find, table::views},
        views::{ScanWithViews, scan::ScanView},
    },
    store::notes::Subject,
};
use pinstack_science::photogrammetry::bundle::Layout;

/// Most views with a picture. Beyond, the page would take long to load; the table as CSV has all.
const MOST: usize = 600;

/// A view, and the URL of its thumbnail.
struct Shown<'a> {
    view: &'a ScanView,
    thumbnail: Option<&'a str>,
}

/// The page, or for the script that follows it one of its parts alone: the table (`?part=views`), or the
/// reconstructions (`?part=reconstructions`).
///
/// # Errors
/// `scan_not_found`.
pub async fn page(
    State(app): State<App>,
    caller: Caller,
    user: PageUser,
    ScanName(name): ScanName,
    uri: Uri,
) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let scan = find(&app, &caller, &name).await?;
    let part = params::take(&mut pairs, "part");
    let latest = reconstruction::latest(&app, &caller, &name).await?;
    let reconstructed = reconstruction::live(&latest, user.stacks);
    if part.as_deref() == Some("reconstructions") {
        return Ok(respond(reconstructed));
    }
    let views = views(&app, &caller, &name).await?;
    let url = |view: &crate::http::scans::table::View| {
        let result = view.stack.result.as_ref()?;
        Some(thumbnail::url(view.stack.id, &result.image.as_ref()?.sha256))
    };
    let has_camera =
        views.iter().filter_map(|view| view.stack.result.as_ref()).all(|result| result.image_info.intrinsics.is_some());
    let profile = app.store.metadata.profile(&scan.input.rig, &scan.input.lens, None).await?;
    let has_results = views.iter().any(|view| view.stack.result.is_some());
    let has_camera =
        has_camera && (has_results || profile.as_ref().is_some_and(|of| of.input.principal_distance_px().is_some()));
    let thumbnails: Vec<Option<String>> = views.iter().map(url).collect();
    let scan = ScanWithViews::tabulated(scan, views).await?;
    let shown: Vec<Shown<'_>> =
        scan.views.iter().zip(&thumbnails).map(|(view, url)| Shown { view, thumbnail: url.as_deref() }).collect();
    let (lead, live) = (lead(&scan), live(&scan, &shown));
    if part.is_some() {
        return Ok(respond(html! { (lead) (live) }));
    }
    let notes = notes::section(&app, &caller, &Subject::Scan(name.clone()), user.stacks).await?;
    let frame = Frame { title: name.as_str(), place: Place::Scans, user: Some(&user), script: Some("scan.js") };
    let input = &scan.scan.input;
    Ok(frame.answer(html! {
        div.head {
            div {
                p.crumbs { a href=(link!("/scans")) { "Scans" } }
                h1 { (name) }
                p.soft {
                    a href=(link!("/profiles/{}/{}", input.rig, input.lens)) { (input.rig) " · " (input.lens) }
                    @for words in [&input.specimen, &input.taxon, &input.operator, &input.note].into_iter().flatten() { " · " (text(words)) }
                }
            }
            @if user.stacks {
                div.buttons {
                    a.button.main href=(link!("/send?purpose=scan&scan={}&rig={}&lens={}", name, input.rig, input.lens)) { "Send more views" }
                    button type="button" id="rerun" disabled[scan.views.is_empty()] { "Fuse all again" }
                    button.danger type="button" id="delete" { "Delete" }
                }
            }
        }
        @if profile.is_some() || has_results {
            (camera::missing_in_results(profile.as_ref().map(|of| &of.input), has_camera, &input.rig, &input.lens, "“Fuse all again” gives it to every view"))
        }
        p id="told" role="alert" {}
        div id="lead" { (lead) }
        (ball::section())
        div id="views" data-scan=(name) { (live) }
        (notes)
        (reconstruction::section(&reconstructed, input.reconstruct, user.stacks, scan.summary.succeeded > 0, app.policy.reconstructs))
        (reconstruction::model(&latest))
        (files(&scan, has_camera))
        (poses())
    }))
}

/// The number of views by state, and what is conspicuous. The script puts it above the ball.
fn lead(scan: &ScanWithViews) -> Markup {
    let summary = &scan.summary;
    let parts = [
        (summary.succeeded, "done"),
        (summary.running, "running"),
        (summary.queued, "waiting"),
        (summary.failed, "without a result"),
        (summary.replaced, "replaced by newer ones"),
    ];
    html! {
        p.lead {
            (count(summary.views as usize, "view", "views"))
            @if let Some(expected) = summary.expected { " of " (expected) " expected" }
            @for (number, words) in parts { @if number > 0 { " · " (number) " " (words) } }
        }
        @if !scan.findings.is_empty() {
            ul.warnings { @for finding in &scan.findings { li { (sentence(&finding.detail)) } } }
        }
    }
}

/// The views, which change while they are fused.
fn live(scan: &ScanWithViews, shown: &[Shown<'_>]) -> Markup {
    html! {
        (on_ball(scan, shown))
        @if shown.is_empty() {
            div.empty { p.lead { "This scan has no views yet." } }
        } @else {
            (grid(scan, shown))
            (table(shown))
            @if shown.len() > MOST { p.soft { "The first " (MOST) " views are shown; the table as CSV has all." } }
        }
    }
}

fn stack_page(view: &ScanView) -> String {
    link!("/stacks/{}", view.stack.rsplit('/').next().unwrap_or_default())
}

fn on_ball(scan: &ScanWithViews, shown: &[Shown<'_>]) -> Markup {
    let views = shown.iter().take(MOST).filter_map(|one| BallView::of(one.view, stack_page(one.view)));
    let is_busy = scan.summary.queued + scan.summary.running > 0;
    let state = if is_busy { JobState::Running } else { JobState::Succeeded };
    ball::data(&views.chain(scan.missing.iter().map(BallView::missing)).collect::<Vec<_>>(), state)
}

fn thousandths(angle: f64) -> i64 {
    (angle * 1000.0).round() as i64
}

/// The views at their places of pan and tilt, with gaps. Nothing when no view has both angles.
fn grid(scan: &ScanWithViews, shown: &[Shown<'_>]) -> Markup {
    let mut at: BTreeMap<(i64, i64), &Shown<'_>> = BTreeMap::new();
    for one in shown.iter().take(MOST) {
        if let (Some(pan), Some(tilt)) = (one.view.pan_deg, one.view.tilt_deg) {
            at.insert((thousandths(tilt), thousandths(pan)), one);
        }
    }
    let gaps: BTreeSet<(i64, i64)> = scan
        .missing
        .iter()
        .take(MOST)
        .map(|angles| (thousandths(angles.tilt_deg), thousandths(angles.pan_deg)))
        .collect();
    let tilts: BTreeSet<i64> = at.keys().chain(&gaps).map(|(tilt, _)| *tilt).collect();
    let pans: BTreeSet<i64> = at.keys().chain(&gaps).map(|(_, pan)| *pan).collect();
    // angles that differ from view to view make no grid
    if at.is_empty() || tilts.len() * pans.len() > 4 * (at.len() + gaps.len()) {
        return html! {};
    }
    let degrees = |angle: i64| format!("{}°", angle as f64 / 1000.0);
    html! {
        h2 { "Views by pan and tilt" }
        div.grid {
            @for tilt in tilts.iter().rev() {
                h3 { "Tilt " (degrees(*tilt)) }
                ul.ring {
                    // every ring has the same places, so that equal pans lie below one another
                    @for pan in &pans {
                        li {
                            @if let Some(one) = at.get(&(*tilt, *pan)) { (cell(one)) small { (degrees(*pan)) } }
                            @else if gaps.contains(&(*tilt, *pan)) { span.gap { "missing" } small { (degrees(*pan)) } }
                        }
                    }
                }
            }
        }
    }
}

fn cell(one: &Shown<'_>) -> Markup {
    let view = one.view;
    let words = ball::words(view);
    let class = match (Mark::of(view), view.verdict) {
        (_, Some(Verdict::DoNotUse)) => "view bad",
        (Mark::Failed, _) => "view lost",
        (Mark::Look, _) => "view odd",
        (Mark::Done | Mark::Busy | Mark::Missing, _) => "view",
    };
    html! {
        a class=(class) href=(stack_page(view)) aria-label={ (view.name) ", " (words) } title={ (view.name) ", " (words) } {
            @if let Some(url) = one.thumbnail { img src=(url) alt="" loading="lazy" width="88" height="67"; } @else { (words) }
            @if matches!(view.state, JobState::Failed | JobState::Cancelled) { b aria-hidden="true" { "✕" } }
            @else if let Some(found) = view.verdict.filter(|found| *found != Verdict::Use) { span.word aria-hidden="true" { (found.words()) } }
        }
    }
}

fn table(shown: &[Shown<'_>]) -> Markup {
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
    };
    let percent = |value: Option<f64>| number(value.map(|share| 100.0 * share), 2);
    let heads = ["Pan °", "Tilt °", "Sharpness", "Object %", "Residual px", "Out of focus %"];
    let numbers = |view: &ScanView| {
        let cells = [
            number(view.pan_deg, 1),
            number(view.tilt_deg, 1),
            number(view.sharpness, 0),
            percent(view.mask_area),
            number(view.residual_px, 2),
            percent(view.unfocused_fraction),
        ];
        heads.into_iter().zip(cells)
    };
    html! {
        h2 { "Table of views" }
        div.wide.folding tabindex="0" role="region" aria-label="Table of views" {
            table {
                thead { tr {
                    th.l scope="col" { "View" } th.l scope="col" { "State" }
                    @for head in heads { th scope="col" { (head) } }
                    th.l scope="col" { "Remarks" }
                } }
                tbody {
                    @for Shown { view, .. } in shown.iter().take(MOST) {
                        tr {
                            td.l { a href=(stack_page(view)) { (text(&view.name)) } }
                            td.l {
                                @match view.verdict { Some(found) => (verdict(found)), None => (state(view.state)) }
                                @if view.state == JobState::Running { " " (format!("{:.0} %", 100.0 * view.progress)) }
                            }
                            @for (head, value) in numbers(view) { td data-head=(head) { (value) } }
                            td.l { (remarks(view)) }
                        }
                    }
                }
            }
        }
    }
}

fn remarks(view: &ScanView) -> Markup {
    html! {
        @if let Some(error) = &view.error { div.bad { (sentence(&error.detail)) } }
        @for outlier in &view.outliers { div.warn { "! " (sentence(&outlier.detail)) } }
        @if !view.findings.is_empty() { div.soft { (view.findings.join(", ").replace('_', " ")) } }
    }
}

fn files(scan: &ScanWithViews, has_camera: bool) -> Markup {
    let named = |layout: Layout| match layout {
        Layout::Colmap => "COLMAP",
        Layout::Meshroom => "Meshroom",
        Layout::Metashape => "Metashape",
        Layout::Realitycapture => "RealityCapture",
        Layout::Odm => "OpenDroneMap",
        Layout::Openmvg => "OpenMVG",
        Layout::Nerfstudio => "nerfstudio",
    };
    let waiting = scan.summary.views > scan.summary.succeeded;
    html! {
        section {
            h2 { "Files for a reconstruction program" }
            p.soft { "Images, masks named as the program wants them, intrinsics, poses and the commands." }
            @if scan.summary.succeeded > 0 {
                @if !has_camera { p.error { "No camera: reconstruction must estimate the focal length. The bundles have no intrinsics." } }
                @if waiting { p.told { "Some views have no result yet. The bundles leave them out." } }
                div.buttons {
                    @for layout in Layout::ALL {
                        a.button href={ (scan.links.bundle) "?layout=" (layout.name()) @if waiting { "&partial=true" } } download { (named(layout)) }
                    }
                }
            } @else { p { "There are no results yet." } }
            // a person opens it with a spreadsheet
            p { a href={ (scan.links.views_csv) "?bom=true" } download { "Table of views as CSV" } }
        }
    }
}

fn poses() -> Markup {
    html! {
        section {
            h2 { "Report on camera poses" }
            p.soft { "Choose what a reconstruction program wrote (COLMAP images.txt, Meshroom cameras.sfm, Metashape XML, or a CSV "
                "with name, x, y and z) to see how well the cameras lie on the sphere of the turntable." }
            form id="poses" {
                div.fields {
                    div { label for="poses-file" { "File with poses" } input id="poses-file" type="file" required; }
                    div.buttons { button type="submit" { "Report" } }
                }
            }
            p id="poses-told" role="alert" {}
            div.wide id="poses-report" tabindex="0" role="region" aria-label="Report on camera poses" hidden {}
            p { a id="poses-save" hidden download="poses.html" { "Save the report with its drawings" } }
        }
    }
}
