//! The warnings and notes of a stack with what to do, as the API shows them.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use super::job::url;
use crate::{
    contract::{
        Verdict,
        input::SliceOrder,
        options::{Crop, MaskMode, StackOptions},
        outcome::JobOutcome,
        request::StackRequest,
        verdict::{Explained, Remedy, explained},
    },
    store::Job,
};
use pinstack_science::types::fusion_options::Method;

/// A warning or note of a stack: what happened, what to do, and what the service can do about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Advice {
    /// Its code; `docs/TROUBLESHOOTING.md` has a section of that name.
    pub code: String,
    /// The verdict on a stack for which it is the worst finding.
    pub verdict: Verdict,
    /// What happened, a phrase.
    pub title: String,
    /// The same with figures and slices, as in `warnings`.
    pub detail: String,
    /// What to do.
    pub cure: String,
    /// 0-based indices of the slices concerned; empty if all are, or if it concerns no slice.
    pub slices: Vec<u32>,
    /// Requests that do it; empty where a person must act at the rig.
    pub actions: Vec<Action>,
}

/// A request that does what a finding needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Action {
    /// What it does, for a button.
    pub label: String,
    /// What kind of request it is.
    pub kind: ActionKind,
    /// Method of the request.
    pub method: String,
    /// URL of the request.
    pub href: String,
    /// JSON body of the request; null if it has none, or if it takes pictures.
    #[schema(value_type = Option<Object>)]
    pub options: Option<Map<String, Value>>,
}

/// What the request of an action does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionKind {
    /// Fuses the stored zip again, with `options`.
    FuseAgain,
    /// Sends pictures of a dot target.
    Calibrate,
    /// Deletes the stack.
    Delete,
}

/// The warnings and notes of a stack, the worst first; `request` is the request of that row.
pub fn advice(job: &Job, request: &StackRequest) -> Vec<Advice> {
    let findings = match &job.outcome {
        Some(JobOutcome::Stack(outcome)) => outcome.metrics.findings.as_slice(),
        _ => &[],
    };
    explained(&job.warnings, findings).iter().map(|one| of(one, job, request)).collect()
}

fn of(one: &Explained<'_>, job: &Job, request: &StackRequest) -> Advice {
    let remedies = if job.state.is_final() { one.explanation.remedies } else { &[] };
    Advice {
        code: one.code.to_string(),
        verdict: one.explanation.verdict,
        title: one.explanation.title.to_owned(),
        detail: one.detail.to_owned(),
        cure: one.explanation.cure.to_owned(),
        slices: one.slices.to_vec(),
        actions: remedies.iter().filter_map(|remedy| action(*remedy, one.detail, job, request)).collect(),
    }
}

/// The request of a remedy; `None` where it would change nothing, or the zip was removed.
fn action(remedy: Remedy, detail: &str, job: &Job, request: &StackRequest) -> Option<Action> {
    let of = |label: &str, kind, method: &str, href: String, options| {
        Some(Action { label: label.to_owned(), kind, method: method.to_owned(), href, options })
    };
    match remedy {
        Remedy::Calibrate => {
            let href = link!("/v1/profiles/{}/{}/calibrations", job.rig, job.lens);
            of("Calibrate again", ActionKind::Calibrate, "POST", href, None)
        }
        Remedy::DeleteView => {
            request.options.scan.as_ref()?;
            of("Delete it: the scan then misses this view", ActionKind::Delete, "DELETE", url(job), None)
        }
        _ => {
            let (label, options) = other_options(remedy, detail, &request.options)?;
            let Value::Object(options) = options else { return None };
            let href = format!("{}/rerun", url(job));
            (!job.upload_removed).then(|| of(&label, ActionKind::FuseAgain, "POST", href, Some(options)))?
        }
    }
}

/// The label, and the options to change, of a remedy that fuses again.
fn other_options(remedy: Remedy, detail: &str, now: &StackOptions) -> Option<(String, Value)> {
    let (label, options) = match remedy {
        Remedy::FuseInOtherOrder => {
            let order = if now.order == SliceOrder::Name { SliceOrder::Reverse } else { SliceOrder::Name };
            ("in the other order", json!({ "order": order }))
        }
        Remedy::FuseWithCurrentRevision => {
            ("with the current revision of the profile", json!({ "profile_revision": null }))
        }
        Remedy::FuseCropped if now.crop == Crop::None => ("cropped", json!({ "crop": "valid" })),
        Remedy::FuseWithoutMask if now.mask != MaskMode::None => ("without a mask", json!({ "mask": "none" })),
        Remedy::FuseByPyramid if now.method != Method::Pyramid => {
            ("by the pyramid method", json!({ "method": "pyramid" }))
        }
        Remedy::FuseGuided if now.method != Method::Guided => ("by the guided method", json!({ "method": "guided" })),
        Remedy::FuseWithBits => {
            let bits = named_bits(detail)?;
            return Some((format!("Fuse again as {bits} bits"), json!({ "input_bits": bits })));
        }
        _ => return None,
    };
    Some((format!("Fuse again {label}"), options))
}

/// The number of bits that the sentence of `unused_input_bits` names first.
fn named_bits(detail: &str) -> Option<&str> {
    let after = detail.split_once("input_bits=")?.1;
    after.split(|c: char| !c.is_ascii_digit()).next().filter(|bits| !bits.is_empty())
}
