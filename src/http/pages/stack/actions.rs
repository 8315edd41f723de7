//! What can be done with a stack: cancel, delete, fuse again.

use std::iter;

use maud::{Markup, html};
use pinstack_science::types::fusion_options::Method;

use crate::{http::pages::frame::PageUser, store::Job};

/// The buttons; none for a person who may only read.
pub fn buttons(job: &Job, user: &PageUser) -> Markup {
    html! {
        @if user.stacks {
            div.buttons {
                @if !job.state.is_final() {
                    button type="button" id="cancel" disabled[job.cancel_requested] { "Cancel" }
                }
                button.danger type="button" id="delete" { "Delete" }
            }
        }
    }
}

/// An option: its name, its label, and its values with their words.
pub type Choice<'a> = (&'static str, &'static str, &'a [(&'static str, &'static str)]);

/// Options that the page offers for another run beside the method.
pub const CHOICES: [Choice<'static>; 9] = [
    ("mask", "Mask", &[("auto", "if there is a back light"), ("none", "none"), ("required", "required")]),
    ("mask_edge", "Edge of the mask", &[("hard", "hard"), ("soft", "soft")]),
    ("under_alpha", "Outside the object", &[("black", "black"), ("keep", "fused colour"), ("pad", "continued colour")]),
    ("format", "Format", &[("png", "PNG"), ("tiff", "TIFF"), ("jpeg", "JPEG")]),
    ("bit_depth", "Bits", &[("8", "8"), ("16", "16"), ("auto", "as the slices")]),
    ("order", "Order of the slices", &[("name", "by name"), ("reverse", "reverse")]),
    ("lateral_colour", "Lateral colour of the lens", &[("correct", "corrected"), ("keep", "left as it is")]),
    ("height", "Height map", &[("none", "none"), ("auto", "measured")]),
    (
        "priority",
        "Priority",
        &[("high", "high: before others of this rig"), ("normal", "normal"), ("low", "low: when no other job waits")],
    ),
];

/// The form for another run with other options.
pub fn rerun(job: &Job, user: &PageUser) -> Markup {
    let mut methods = Method::ALL.map(|method| (method.name(), method.title()));
    // the default first
    methods.reverse();
    let method = ("method", "Method", &methods[..]);
    html! {
        @if user.stacks && !job.upload_removed {
            details {
                summary { "Fuse again with other options" }
                form id="rerun" data-stack=(job.id) {
                    p.soft { "Makes a new stack from the zip that is stored. This one stays. The new one can be compared with it." }
                    div.fields {
                        @for (name, label, values) in iter::once(method).chain(CHOICES) {
                            div {
                                label for={ "rerun-" (name) } { (label) }
                                select id={ "rerun-" (name) } name=(name) {
                                    option value="" { "as it was" }
                                    @for (value, words) in values { option value=(value) { (words) } }
                                }
                            }
                        }
                        div {
                            label for="rerun-threshold" { "Threshold of the mask" }
                            input id="rerun-threshold" name="mask_threshold" placeholder="as it was" autocomplete="off"
                                aria-describedby="threshold-hint";
                            span.hint id="threshold-hint" { "auto, or 0 to 1" }
                        }
                        div {
                            label for="rerun-revision" { "Profile revision" }
                            input id="rerun-revision" name="profile_revision" inputmode="numeric" pattern="[0-9]*" placeholder="as it was" autocomplete="off";
                        }
                    }
                    div.buttons { button.main type="submit" { "Fuse again" } }
                    p id="rerun-told" role="alert" {}
                }
            }
        }
    }
}
