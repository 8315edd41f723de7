//! HTML for people.
//!
//! | part | what it is |
//! |---|---|
//! | [`routes`] | every page of the web interface |
//! | [`frame`] | what the pages have in common: head, navigation, style sheet, content policy |
//! | [`assets`] | style sheet, scripts and icon, embedded in the program |
//! | [`ball`], [`model`] | views and models in three dimensions: what scripts draw, and their places |
//! | [`notes`] | what people wrote about a stack, a scan or a profile |
//! | [`errors`] | errors of pages as pages |
//! | [`guide`] | the Markdown files of `docs/`, to read in the browser |
//! | [`calibration_report`], [`pose_report`] | reports: single files that load nothing and can be mailed |
//!
//! The pages are written with maud, which escapes what it shows. Reports are pure functions that build their text
//! themselves, mostly SVG; [`answer`] sends one. Pages show what the same functions return that serve the JSON, so that
//! the same checks apply. What changes something is a call of the API by a script of the page.

pub mod assets;
pub mod ball;
pub mod calibration_report;
pub mod errors;
pub mod frame;
pub mod guide;
pub mod home;
mod html;
pub mod model;
pub mod notes;
pub mod plan;
pub mod pose_report;
pub mod profiles;
pub mod reconstruction;
pub mod routes;
pub mod scan;
pub mod scans;
pub mod send;
pub mod sign_in;
pub mod stack;
pub mod stacks;
pub mod words;

use axum::{
    http::{HeaderValue, header},
    response::{IntoResponse, Response},
};
use base64::{Engine, prelude::BASE64_STANDARD};
use sha2::{Digest, Sha256};

/// A report as an answer. Its content policy allows only its inline style sheet, identified by its hash: nothing may be
/// loaded, run, sent or framed.
pub fn answer(html: String, style: &str) -> Response {
    let hash = BASE64_STANDARD.encode(Sha256::digest(style.as_bytes()));
    let policy = format!(
        "default-src 'none'; style-src 'sha256-{hash}'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    let mut response = ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], html).into_response();
    if let Ok(policy) = HeaderValue::from_str(&policy) {
        response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    response
}
