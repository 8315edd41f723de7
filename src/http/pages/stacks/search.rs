//! The search of the list of stacks: one field for words, two for dates, and chips with the numbers of what they show.
//! All of it is in the address of the page.

use maud::{Markup, html};

use crate::{
    contract::{JobState, Verdict},
    http::pages::{
        frame::address,
        words::{count, text, up_to},
    },
    store::search::FoundStacks,
};

/// A chip: its words, the parameters that it sets in place of `verdict` and `state`, and the number of stacks.
type Chip = (&'static str, Option<(&'static str, &'static str)>, Option<u64>);

/// `214 stacks: 9 to look at, 2 not to be used, 1 failed`.
pub fn numbers(found: &FoundStacks) -> String {
    let FoundStacks { all, verdicts: [_, look, do_not_use], failed } = *found;
    let stacks = if all == FoundStacks::MOST {
        format!("{} stacks", up_to(all))
    } else {
        count(all as usize, "stack", "stacks")
    };
    let parts = [(look, "to look at"), (do_not_use, "not to be used"), (failed, "failed")];
    let parts: Vec<String> = parts
        .iter()
        .filter(|(number, _)| *number > 0)
        .map(|(number, words)| format!("{} {words}", up_to(*number)))
        .collect();
    if parts.is_empty() { stacks } else { format!("{stacks}: {}", parts.join(", ")) }
}

/// The form and the chips; `pairs` are the parameters of the page.
pub fn form(pairs: &[(String, String)], found: &FoundStacks) -> Markup {
    let value = |name: &str| pairs.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str());
    // what the form has no field for
    let kept = pairs.iter().filter(|(name, _)| !["q", "since", "until"].contains(&name.as_str()));
    html! {
        form.filters method="get" action=(link!("/stacks")) role="search" aria-label="Find stacks" {
            div.fields {
                div.wide-field {
                    label for="q" { "Find" }
                    input id="q" name="q" type="search" value=[value("q")] placeholder="label, scan, rig, lens or file"
                        autocomplete="off" spellcheck="false";
                }
                @for (name, label) in [("since", "From"), ("until", "To")] {
                    div { label for=(name) { (label) } input id=(name) name=(name) type="date" value=[value(name)]; }
                }
                @for (name, value) in kept { input type="hidden" name=(name) value=(text(value)); }
                div.buttons {
                    button type="submit" { "Find" }
                    @if !pairs.is_empty() { a href=(link!("/stacks")) { "Show all" } }
                }
            }
            (chips(pairs, found))
        }
    }
}

fn chips(pairs: &[(String, String)], found: &FoundStacks) -> Markup {
    let [good, look, do_not_use] = found.verdicts;
    let of =
        |verdict: Verdict, number| -> Chip { (verdict.words(), Some(("verdict", verdict.as_str())), Some(number)) };
    let in_state = |words, state: JobState, number| -> Chip { (words, Some(("state", state.as_str())), number) };
    let all: [Chip; 7] = [
        ("All", None, Some(found.all)),
        of(Verdict::Look, look),
        of(Verdict::DoNotUse, do_not_use),
        in_state("Failed", JobState::Failed, Some(found.failed)),
        of(Verdict::Use, good),
        in_state("Running", JobState::Running, None),
        in_state("Waiting", JobState::Queued, None),
    ];
    let is_chip = |name: &str| ["verdict", "state"].contains(&name);
    let others: Vec<(&str, &str)> =
        pairs.iter().filter(|(name, _)| !is_chip(name)).map(|(name, value)| (name.as_str(), value.as_str())).collect();
    let now = pairs.iter().find(|(name, _)| is_chip(name)).map(|(name, value)| (name.as_str(), value.as_str()));
    html! {
        ul.chips aria-label="Show" {
            @for (words, sets, number) in all {
                li { a href=(address(&link!("/stacks"), others.iter().copied().chain(sets))) aria-current=[(now == sets).then_some("true")] {
                    (words) @if let Some(number) = number { " " span.soft { (up_to(number)) } }
                } }
            }
            @for name in ["rig", "lens", "scan"] {
                @if let Some((_, value)) = pairs.iter().find(|(key, _)| key == name) {
                    @let rest = pairs.iter().filter(|(key, _)| key != name).map(|(key, value)| (key.as_str(), value.as_str()));
                    li { a.set href=(address(&link!("/stacks"), rest)) title={ "Show every " (name) } {
                        (name) " " (text(value)) " " span aria-hidden="true" { "✕" }
                    } }
                }
            }
        }
    }
}
