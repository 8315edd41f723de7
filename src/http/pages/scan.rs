//! `/scans/{scan}`: the views of a scan by pan and tilt, their table, what is missing or differs, and the files for
//! reconstruction programs.

use std::collections::{BTreeMap, BTreeSet};

use axum::{extract::State, http::Uri, response::Response};
use maud::{Markup, html};

use super::{
    frame::{Frame, PageUser, Place, respond},
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
};
use pinstack_science::photogrammetry::bundle::Layout;

/// Most views with a picture. Beyond, the page would take long to load; the table as CSV has all.
const MOST: usize = 600;

/// A view, and the URL of its thumbnail.
struct Shown<'a> {
    view: &'a ScanView,
    thumbnail: Option<&'a str>,
}

/// The page, or its table alone for the script that follows it (`?part=views`).
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
    let views = views(&app, &caller, &name).await?;
    let url = |view: &crate::http::scans::table::View| {
        let result = view.stack.result.as_ref()?;
        Some(thumbnail::url(view.stack.id, &result.image.as_ref()?.sha256))
    };
    let thumbnails: Vec<Option<String>> = views.iter().map(url).collect();
    let scan = ScanWithViews::tabulated(scan, views).await?;
    let shown: Vec<Shown<'_>> =
        scan.views.iter().zip(&thumbnails).map(|(view, url)| Shown { view, thumbnail: url.as_deref() }).collect();
    let live = live(&scan, &shown);
    if params::take(&mut pairs, "part").is_some() {
        return Ok(respond(live));
    }
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
        p id="told" role="alert" {}
        div id="views" data-scan=(name) { (live) }
        (files(&scan))
        (poses())
    }))
}

/// What changes while views are fused.
fn live(scan: &ScanWithViews, shown: &[Shown<'_>]) -> Markup {
    let summary = &scan.summary;
    let busy = if summary.queued + summary.running > 0 { JobState::Running } else { JobState::Succeeded };
    let parts = [
        (summary.succeeded, "done"),
        (summary.running, "running"),
        (summary.queued, "waiting"),
        (summary.failed, "without a result"),
        (summary.replaced, "replaced by newer ones"),
    ];
    html! {
        p.lead data-state=(busy.as_str()) {
            (count(summary.views as usize, "view", "views"))
            @if let Some(expected) = summary.expected { " of " (expected) " expected" }
            @for (number, words) in parts { @if number > 0 { " · " (number) " " (words) } }
        }
        @if !scan.findings.is_empty() {
            ul.warnings { @for finding in &scan.findings { li { (sentence(&finding.detail)) } } }
        }
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
        div.grid tabindex="0" role="region" aria-label="Views by pan and tilt" {
            table {
                thead { tr { th scope="col" { "tilt \\ pan" } @for pan in &pans { th scope="col" { (degrees(*pan)) } } } }
                tbody {
                    @for tilt in tilts.iter().rev() {
                        tr {
                            th scope="row" { (degrees(*tilt)) }
                            @for pan in &pans {
                                td {
                                    @if let Some(one) = at.get(&(*tilt, *pan)) { (cell(one)) }
                                    @else if gaps.contains(&(*tilt, *pan)) { span.gap { "missing" } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn cell(one: &Shown<'_>) -> Markup {
    let view = one.view;
    let is_lost = matches!(view.state, JobState::Failed | JobState::Cancelled);
    let class = match view.verdict {
        _ if is_lost => "view lost",
        Some(Verdict::DoNotUse) => "view bad",
        Some(Verdict::Look) => "view odd",
        _ => "view",
    };
    let words = match view.state {
        JobState::Queued => "waiting".to_owned(),
        JobState::Running => format!("{:.0} %", 100.0 * view.progress),
        JobState::Succeeded => view.verdict.map_or("done", Verdict::words).to_owned(),
        JobState::Failed => "failed".to_owned(),
        JobState::Cancelled => "cancelled".to_owned(),
    };
    html! {
        a class=(class) href=(stack_page(view)) aria-label={ (view.name) ", " (words) } title={ (view.name) ", " (words) } {
            @if let Some(url) = one.thumbnail { img src=(url) alt="" loading="lazy" width="88" height="67"; } @else { (words) }
            @if is_lost { b aria-hidden="true" { "✕" } }
            @else if let Some(found) = view.verdict.filter(|found| *found != Verdict::Use) { span.word aria-hidden="true" { (found.words()) } }
        }
    }
}

fn table(shown: &[Shown<'_>]) -> Markup {
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
    };
    let percent = |value: Option<f64>| number(value.map(|share| 100.0 * share), 2);
    html! {
        h2 { "Table of views" }
        div.wide tabindex="0" role="region" aria-label="Table of views" {
            table {
                thead { tr {
                    th.l scope="col" { "View" } th.l scope="col" { "State" }
                    @for head in ["Pan °", "Tilt °", "Sharpness", "Object %", "Residual px", "Out of focus %"] { th scope="col" { (head) } }
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
                            td { (number(view.pan_deg, 1)) } td { (number(view.tilt_deg, 1)) }
                            td { (number(view.sharpness, 0)) } td { (percent(view.mask_area)) }
                            td { (number(view.residual_px, 2)) } td { (percent(view.unfocused_fraction)) }
                            td.l {
                                @if let Some(error) = &view.error { div.bad { (sentence(&error.detail)) } }
                                @for outlier in &view.outliers { div.warn { "! " (sentence(&outlier.detail)) } }
                                @if !view.findings.is_empty() { div.soft { (view.findings.join(", ").replace('_', " ")) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn files(scan: &ScanWithViews) -> Markup {
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
