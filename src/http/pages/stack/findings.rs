//! What was found in a stack, the worst first: what happened, what to do, and a button where the service can do it.

use maud::{Markup, html};

use crate::{
    contract::{Verdict, request::StackRequest},
    http::{
        App,
        pages::{
            assets,
            frame::PageUser,
            guide,
            words::{sentence, text, verdict},
        },
        views::advice::{Action, ActionKind, Advice, advice},
    },
    store::{Job, PageRequest, StoreResult},
};

/// The findings of a stack for this person.
pub struct Findings {
    all: Vec<Advice>,
    user: PageUser,
    /// URL of the page that sends pictures of a dot target.
    calibrate: String,
}

impl Findings {
    /// Those of a stack. A rerun with the current revision of the profile is offered only if the stack has another one.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub async fn of(app: &App, job: &Job, request: &StackRequest, user: &PageUser) -> StoreResult<Self> {
        let (rig, lens) = (&job.rig, &job.lens);
        let newest = PageRequest { limit: 1, cursor: None };
        let newest = app.store.metadata.profiles(Some(rig), Some(lens), &newest).await?;
        let is_current = newest.items.iter().all(|profile| profile.revision == request.profile_revision);
        let mut all = advice(job, request);
        for one in &mut all {
            one.actions.retain(|action| !(is_current && takes_revision(action)));
        }
        let calibrate = link!("/send?purpose=calibration&rig={rig}&lens={lens}");
        Ok(Self { all, user: user.clone(), calibrate })
    }

    /// What affects the result, and the script of the buttons.
    pub fn serious(&self) -> Markup {
        let is_empty = self.all.iter().all(|one| one.verdict == Verdict::Use);
        html! {
            @if !is_empty {
                section aria-label="Findings" {
                    ol.findings { @for one in self.all.iter().filter(|one| one.verdict != Verdict::Use) { (self.one(one)) } }
                }
            }
            p id="advice-told" role="alert" {}
            script type="module" src=(assets::url("advice.js")) {}
        }
    }

    /// What does not.
    pub fn notes(&self) -> Markup {
        let notes: Vec<&Advice> = self.all.iter().filter(|one| one.verdict == Verdict::Use).collect();
        html! {
            @if !notes.is_empty() {
                section { h2 { "Notes" } ol.findings { @for one in notes { (self.one(one)) } } }
            }
        }
    }

    fn one(&self, one: &Advice) -> Markup {
        let shown = html! { code { (text(&one.code)) } };
        let actions: Vec<Markup> = one.actions.iter().filter_map(|action| self.button(action)).collect();
        html! {
            li class=(one.verdict.as_str()) {
                p.what { @if one.verdict != Verdict::Use { (verdict(one.verdict)) " " } strong { (one.title) } }
                p { (one.cure) }
                p.small.soft {
                    (sentence(&one.detail)) " "
                    @match guide::explanation(&one.code) { Some(href) => { a href=(href) { (shown) } }, None => (shown), }
                }
                @if !actions.is_empty() { div.buttons { @for action in &actions { (action) } } }
            }
        }
    }

    /// The button of an action; `None` if the person may not do it.
    fn button(&self, action: &Action) -> Option<Markup> {
        let label = &action.label;
        match action.kind {
            ActionKind::Calibrate => self.user.profiles.then(|| html! { a.button href=(self.calibrate) { (label) } }),
            ActionKind::FuseAgain => self.user.stacks.then(|| {
                let options = serde_json::to_string(&action.options).unwrap_or_default();
                let what = "Makes a new stack from the stored zip. This one stays.";
                html! { button type="button" data-href=(action.href) data-options=(options) title=(what) { (label) } }
            }),
            ActionKind::Delete => self.user.stacks.then(|| {
                html! { button.danger type="button" data-href=(action.href) data-delete { (label) } }
            }),
        }
    }
}

fn takes_revision(action: &Action) -> bool {
    action.options.as_ref().is_some_and(|options| options.contains_key("profile_revision"))
}
