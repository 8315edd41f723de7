//! Runs of the same pictures side by side: what differs in the requests, and the metrics, with the best value of each
//! row marked where its numbers can be compared and one of them is better.

use maud::{Markup, html};
use serde_json::{Map, Value};

use super::actions;
use crate::{
    contract::{
        outcome::StackOutcome,
        request::{JobRequest, StackRequest},
    },
    http::{
        artifacts::outcome::of_stack,
        pages::{
            html::maybe,
            stacks::{row, thumbnail},
            words::{state, text, verdict},
        },
    },
    store::Job,
};
use pinstack_science::types::fusion_options::Method;

/// Which of two values is better.
#[derive(Clone, Copy)]
enum Better {
    Higher,
    Lower,
    /// The one nearer to 1.
    NearOne,
    /// Neither.
    Neither,
}

/// What runs must have in common so that their values can be compared. All need metrics of the same versions.
#[derive(Clone, Copy, PartialEq)]
enum Needs {
    Nothing,
    /// All of them with a mask, or none: metrics are of the object alone where there is one.
    Mask,
    /// The same method too: methods measure focus differently.
    Method,
    /// Heights in the same unit.
    HeightUnit,
}

/// One row: its words, the decimals, which value is better, what it needs, and the value.
type Measure = (&'static str, usize, Better, Needs, fn(&StackOutcome) -> Option<f64>);

/// `docs/METRICS.md` defines them.
const MEASURES: [Measure; 15] = {
    use Better::{Higher, Lower, NearOne, Neither};
    [
        ("Gradients kept (q_g_top)", 3, Higher, Needs::Mask, |it| it.metrics.fusion.q_g_top),
        ("Structure kept (q_w_top)", 3, Higher, Needs::Mask, |it| it.metrics.fusion.q_w_top),
        ("Sharpness kept, best 1", 3, NearOne, Needs::Mask, |it| it.metrics.fusion.sharpness_retention),
        ("Halos, grey levels", 2, Lower, Needs::Mask, |it| it.metrics.fusion.overshoot_levels),
        ("Clipped, %", 2, Lower, Needs::Mask, |it| it.metrics.fusion.clipped_fraction.map(percent)),
        ("Noise of the decision map", 3, Lower, Needs::Method, |it| it.metrics.focus.label_noise),
        ("Lead of the sharpest slice", 3, Higher, Needs::Method, |it| it.metrics.focus.ambiguity),
        ("Never in focus, % of the object", 1, Neither, Needs::Method, |it| {
            it.metrics.focus.unfocused_fraction.map(percent)
        }),
        ("Slices fit within, px (95 %)", 2, Lower, Needs::Mask, |it| it.metrics.alignment.residual_p95_px),
        ("Seen by every slice, %", 1, Higher, Needs::Nothing, |it| it.metrics.alignment.common_fraction.map(percent)),
        ("Object, %", 2, Neither, Needs::Nothing, |it| Some(percent(it.metrics.mask.as_ref()?.foreground_fraction))),
        ("Separability of the mask", 3, Higher, Needs::Nothing, |it| it.metrics.mask.as_ref()?.separability),
        ("Heights known, % of the object", 0, Higher, Needs::Mask, |it| {
            Some(percent(it.height.as_ref()?.valid_fraction))
        }),
        ("Uncertainty of the heights", 4, Lower, Needs::HeightUnit, |it| it.height.as_ref()?.median_sigma),
        ("Time, s", 1, Neither, Needs::Nothing, |it| Some(it.metrics.timing_ms.total as f64 / 1000.0)),
    ]
};

fn percent(share: f64) -> f64 {
    100.0 * share
}

/// What tells a run from the others of the same pictures: method and time.
pub fn told(job: &Job) -> String {
    format!("{}, {}", method(job), time(job))
}

fn method(job: &Job) -> &'static str {
    row::options(job).map(|options| options.method.title()).unwrap_or_default()
}

fn time(job: &Job) -> String {
    job.created_at.strftime("%Y-%m-%d %H:%M:%S UTC").to_string()
}

/// The table, one column per run. The first one is shown at the left of the divider.
pub fn table(runs: &[&Job]) -> Markup {
    let outcomes: Vec<Option<&StackOutcome>> = runs.iter().map(|run| of_stack(run).ok()).collect();
    let differences = differences(runs);
    html! {
        div.wide tabindex="0" role="region" aria-label="Runs beside each other" {
            table.runs {
                thead { (heads(runs, &outcomes)) }
                tbody {
                    tr { th.l scope="rowgroup" colspan=(runs.len() + 1) { "What differs" } }
                    @if differences.is_empty() {
                        tr { td.l colspan=(runs.len() + 1) { "Nothing: the options, the revision of the profile and the program are the same." } }
                    }
                    @for (name, values) in &differences {
                        tr { th.l scope="row" { (text(name)) } @for value in values { td { (text(value)) } } }
                    }
                }
                tbody {
                    tr { th.l scope="rowgroup" colspan=(runs.len() + 1) { "Metrics" } }
                    @for measure in &MEASURES { (measured(measure, runs, &outcomes)) }
                }
            }
        }
        p.soft.small {
            "✓ marks the best value of a row. A row has none where the values are equal, where none is better, and where "
            "they cannot be compared: with and without a mask other pixels are measured, and each method measures focus "
            "in its own way. "
            a href=(link!("/guide/METRICS.md")) { "What the metrics mean" }
        }
    }
}

fn heads(runs: &[&Job], outcomes: &[Option<&StackOutcome>]) -> Markup {
    let first = runs.first().filter(|_| outcomes.first().is_some_and(Option::is_some));
    html! {
        tr {
            td {}
            @for (at, run) in runs.iter().enumerate() {
                th scope="col" {
                    (thumbnail::picture(run))
                    a href=(link!("/stacks/{}", run.id)) { (method(run)) br; span.time { (time(run)) } }
                    div { @match run.verdict() { Some(found) => (verdict(found)), None => (state(run.state)) } }
                    @if let Some(first) = first.filter(|_| at > 0 && outcomes[at].is_some()) {
                        div { a href=(link!("/stacks/{}?compare={}", first.id, run.id)) { "Beside the first, with a divider" } }
                    }
                }
            }
        }
    }
}

fn measured(measure: &Measure, runs: &[&Job], outcomes: &[Option<&StackOutcome>]) -> Markup {
    let &(name, decimals, better, needs, value) = measure;
    let values: Vec<Option<f64>> = outcomes.iter().map(|outcome| value((*outcome)?)).collect();
    let best = if is_comparable(needs, runs, outcomes) { best(&values, decimals, better) } else { Vec::new() };
    html! {
        @if values.iter().any(Option::is_some) {
            tr {
                th.l scope="row" { (name) }
                @for (at, value) in values.iter().enumerate() {
                    td {
                        @if best.contains(&at) { strong.best { span aria-hidden="true" { "✓ " } (maybe(*value, decimals)) span.unseen { " (best)" } } }
                        @else { (maybe(*value, decimals)) }
                    }
                }
            }
        }
    }
}

/// The columns with the best value as it is shown; none if all are equal or fewer than two are known.
fn best(values: &[Option<f64>], decimals: usize, better: Better) -> Vec<usize> {
    let unit = 10f64.powi(i32::try_from(decimals).unwrap_or(0));
    let score = |value: f64| {
        let shown = (value * unit).round();
        match better {
            Better::Higher => Some(shown),
            Better::Lower => Some(-shown),
            Better::NearOne => Some(-(shown - unit).abs()),
            Better::Neither => None,
        }
    };
    let known = values.iter().enumerate().filter_map(|(at, value)| Some((at, score((*value)?)?)));
    let scores: Vec<(usize, f64)> = known.filter(|(_, score)| score.is_finite()).collect();
    let most = scores.iter().map(|(_, score)| *score).fold(f64::NEG_INFINITY, f64::max);
    let winners: Vec<usize> = scores.iter().filter(|(_, score)| *score >= most).map(|(at, _)| *at).collect();
    if winners.len() < scores.len() { winners } else { Vec::new() }
}

fn is_comparable(needs: Needs, runs: &[&Job], outcomes: &[Option<&StackOutcome>]) -> bool {
    let known: Vec<&StackOutcome> = outcomes.iter().copied().flatten().collect();
    let mask = || is_same(known.iter().map(|it| it.metrics.mask.is_some()));
    is_same(known.iter().map(|it| &it.metrics.versions))
        && match needs {
            Needs::Nothing => true,
            Needs::Mask => mask(),
            Needs::Method => mask() && is_same(runs.iter().filter_map(|run| Some(row::options(run)?.method))),
            Needs::HeightUnit => mask() && is_same(known.iter().filter_map(|it| Some(it.height.as_ref()?.unit))),
        }
}

fn is_same<T: PartialEq>(mut values: impl Iterator<Item = T>) -> bool {
    values.next().is_none_or(|first| values.all(|value| value == first))
}

/// What differs between the runs: its name, and the value of each run in words.
fn differences(runs: &[&Job]) -> Vec<(String, Vec<String>)> {
    let members: Vec<Map<String, Value>> = runs.iter().map(|run| members(run)).collect();
    let mut names: Vec<&String> = members.iter().flat_map(Map::keys).collect();
    names.sort();
    names.dedup();
    let row = |name: &String| {
        let values: Vec<&Value> = members.iter().map(|of| of.get(name).unwrap_or(&Value::Null)).collect();
        let label = actions::CHOICES.iter().find(|choice| choice.0 == name.as_str()).map(|choice| choice.1);
        let label = label.map_or_else(|| in_words(name), str::to_owned);
        (!is_same(values.iter())).then(|| (label, values.iter().map(|value| words(name, value)).collect()))
    };
    names.into_iter().filter_map(row).collect()
}

/// What a run was requested with and made by.
fn members(run: &Job) -> Map<String, Value> {
    let JobRequest::Stack(request) = &run.request else { return Map::new() };
    let StackRequest { options, profile_revision, .. } = request;
    let Ok(Value::Object(mut members)) = serde_json::to_value(options) else { return Map::new() };
    members.insert("rig".into(), run.rig.as_str().into());
    members.insert("lens".into(), run.lens.as_str().into());
    members.insert("profile_revision".into(), (*profile_revision).into());
    if let Ok(StackOutcome { software: Some(program), .. }) = of_stack(run) {
        members.insert("made_by".into(), program.as_str().into());
    }
    members
}

/// A value as the form for another run names it.
fn words(name: &str, value: &Value) -> String {
    let plain = match value {
        Value::Null => return "–".to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    if let Some(method) = Method::ALL.into_iter().find(|method| name == "method" && method.name() == plain) {
        return method.title().to_owned();
    }
    let choice = actions::CHOICES.iter().find(|choice| choice.0 == name);
    let known = choice.and_then(|choice| choice.2.iter().find(|(value, _)| *value == plain));
    known.map_or(plain, |(_, words)| (*words).to_owned())
}

fn in_words(name: &str) -> String {
    crate::http::pages::html::sentence(&name.replace('_', " "))
}
