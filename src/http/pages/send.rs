//! `/send`: stacks, scans and calibrations by drag and drop. The browser's script packs folders, uploads in pieces and
//! continues after a broken connection; the server side is the resumable upload of the API.

use axum::{extract::State, response::Response};
use maud::{Markup, PreEscaped, html};

use super::{
    frame::{Frame, PageUser, Place},
    profiles::camera::{FIELDS, RADIUS, capture_mode},
};
use crate::{
    contract::{Code, Name},
    http::{ApiError, ApiResult, App, auth::Caller},
    store::{PageRequest, scans::ScanFilter},
};

/// Most profiles and scans that the page suggests.
const SUGGESTED: u32 = 200;

/// The page.
///
/// # Errors
/// `forbidden` for a person who may only read.
pub async fn page(State(app): State<App>, caller: Caller, user: PageUser) -> ApiResult<Response> {
    if !user.stacks && !user.profiles {
        let detail = "you are signed in with a token that may only read; sign in with one that may send stacks";
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    let keys = app.store.metadata.profile_keys(SUGGESTED).await?;
    let request = PageRequest { limit: SUGGESTED, cursor: None };
    let scans = ScanFilter { owner: caller.sees_only(&app), ..ScanFilter::default() };
    let scans = app.store.metadata.scans(&scans, &request).await?.items;
    let scans: Vec<(Name, Name, Name)> =
        scans.into_iter().map(|scan| (scan.name, scan.input.rig, scan.input.lens)).collect();
    let frame = Frame { title: "Send", place: Place::Send, user: Some(&user), script: Some("send.js") };
    Ok(frame.answer(html! {
        h1 { "Send pictures" }
        form id="send" {
            div.drop id="drop" {
                p.lead { "Drop a zip or a folder here" }
                p.soft { "Or pictures: JPEG, PNG or TIFF. Folders " code { "front" } " and " code { "back" }
                    " hold the pictures of each light. You see what will be done with them before anything is sent." }
                div.buttons {
                    input id="folder" type="file" multiple webkitdirectory hidden aria-label="Folder";
                    input id="file" type="file" multiple accept=".zip,.jpg,.jpeg,.png,.tif,.tiff,application/zip" hidden aria-label="Zip or pictures";
                    button type="button" id="pick-folder" { "Choose a folder" }
                    button type="button" id="pick-file" { "Choose a zip or pictures" }
                }
            }
            p.unseen id="summary" role="status" {}
            div id="chosen" {}
            (purpose(&user))
            (camera(&keys))
            (view(&scans, app.policy.reconstructs))
            p id="told" role="alert" {}
            div.buttons { button.main type="submit" id="go" disabled { "Send" } }
        }
        section aria-label="Uploads" {
            ul.jobs id="uploads" {}
            p.soft id="said" role="status" {}
        }
        p.soft.small { "If the connection breaks, the upload continues by itself. If this page is closed, choose the same file or folder "
            "again: only what is missing is sent." }
    }))
}

fn purpose(user: &PageUser) -> Markup {
    html! {
        fieldset {
            legend { "What is it?" }
            div.fields {
                @if user.stacks {
                    label.check { input type="radio" name="purpose" value="stack" checked; "One stack" }
                    label.check { input type="radio" name="purpose" value="scan"; "A scan: the stacks of many views" }
                }
                @if user.profiles {
                    label.check { input type="radio" name="purpose" value="calibration" checked[!user.stacks]; "A calibration: a dot target" }
                    label.check { input type="radio" name="purpose" value="no_target"; "A calibration: I have no target" }
                }
            }
        }
    }
}

fn camera(keys: &[(Name, Name)]) -> Markup {
    let mut rigs: Vec<&str> = keys.iter().map(|(rig, _)| rig.as_str()).collect();
    let mut lenses: Vec<&str> = keys.iter().map(|(_, lens)| lens.as_str()).collect();
    for names in [&mut rigs, &mut lenses] {
        names.sort_unstable();
        names.dedup();
    }
    let only = |names: &[&str]| (names.len() == 1).then(|| names[0].to_owned());
    html! {
        fieldset {
            legend { "Rig and lens" }
            div.fields {
                div {
                    label for="rig" { "Rig" }
                    input id="rig" name="rig" list="rigs" required autocomplete="off" spellcheck="false" value=[only(&rigs)];
                    datalist id="rigs" { @for rig in &rigs { option value=(rig) {} } }
                }
                div {
                    label for="lens" { "Lens" }
                    input id="lens" name="lens" list="lenses" required autocomplete="off" spellcheck="false" value=[only(&lenses)];
                    datalist id="lenses" { @for lens in &lenses { option value=(lens) {} } }
                }
            }
            p.hint data-for="calibration" hidden {
                "All may stay empty, but without them the profile has no camera, and reconstruction must estimate the focal \
                 length. With the dot pitch, the pixels and the rail step, a rail that moves the camera measures it. If the \
                 rail moves the sensor or the lens alone, take one more picture at the reference slice, with the target \
                 nearer to the lens, and put it into a folder " code { "moved" } " beside the slices."
            }
            p.hint data-for="no_target" hidden {
                "Choose a stack, or a folder with the stacks of several views, that this camera took at one setting and at the \
                 same rail positions. The slices are aligned by what they show, so the objects need fine detail up to the \
                 corners; several views measure better than one. The numbers may stay empty. The result is less certain than \
                 that of a dot target, and its report says by how much."
            }
            div.measures data-for="calibration no_target" hidden {
                @for field in &FIELDS { (field.input(true)) }
                (capture_mode(Some("calibration no_target")))
            }
            figure.moved data-for="calibration" hidden { (PreEscaped(MOVED)) }
        }
    }
}

/// How the moved target is photographed.
const MOVED: &str = concat!(
    "<svg viewBox=\"0 0 420 96\" role=\"img\" aria-label=\"The target, moved towards the lens by a known distance\">",
    "<g fill=\"none\" stroke=\"currentColor\"><path d=\"M8 48H404\" stroke-dasharray=\"2 4\"/>",
    "<path d=\"M20 26V70M60 30v36h60V30z\"/><path d=\"M300 16V80\" stroke-dasharray=\"5 4\"/>",
    "<path d=\"M360 16V80\" stroke-width=\"2\"/><path d=\"M354 26H306m6-4-6 4 6 4\"/></g>",
    "<text x=\"8\" y=\"92\">sensor</text><text x=\"76\" y=\"92\">lens</text>",
    "<text x=\"262\" y=\"92\">moved: 1 picture</text><text x=\"366\" y=\"92\">slices</text>",
    "<text x=\"306\" y=\"16\">nearer by</text></svg>"
);

fn view(scans: &[(Name, Name, Name)], reconstructs: bool) -> Markup {
    html! {
        fieldset data-for="stack scan" {
            legend { "View" }
            div.fields {
                div {
                    label for="scan" { "Scan" }
                    input id="scan" name="scan" list="scans" autocomplete="off" spellcheck="false" aria-describedby="scan-hint";
                    datalist id="scans" {
                        @for (name, rig, lens) in scans { option value=(name) data-rig=(rig) data-lens=(lens) {} }
                    }
                    span.hint id="scan-hint" { "A new name makes a new scan." }
                }
                (RADIUS.input(true))
                @if reconstructs {
                    label.check data-for="scan" hidden { input type="checkbox" name="reconstruct"; "Reconstruct it when all its views are done" }
                }
                div data-for="stack" { label for="label" { "Label" } input id="label" name="label" autocomplete="off"; span.hint { "Optional" } }
                div.short data-for="stack" { label for="pan_deg" { "Pan, °" } input id="pan_deg" name="pan_deg" inputmode="decimal" autocomplete="off"; span.hint { "Optional" } }
                div.short data-for="stack" { label for="tilt_deg" { "Tilt, °" } input id="tilt_deg" name="tilt_deg" inputmode="decimal" autocomplete="off"; span.hint { "Optional" } }
            }
        }
    }
}
