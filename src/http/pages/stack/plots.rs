//! The metrics of a stack over its slices as small plots. A band marks the slices that a finding names.

use std::collections::BTreeMap;

use maud::{Markup, PreEscaped, html};

use crate::http::pages::calibration_report::chart::{Chart, Mark, MarkStyle, Scale};
use pinstack_science::types::metrics::{Metrics, Severity, SliceMetrics};

/// One quantity of a slice.
struct Quantity {
    title: &'static str,
    hint: &'static str,
    unit: &'static str,
    style: MarkStyle,
    /// The axis spans at least this much.
    span: f64,
    value: fn(&SliceMetrics) -> Option<f64>,
}

const QUANTITIES: [Quantity; 4] = [
    Quantity {
        title: "Contribution",
        hint: "Share of the image that is taken from each slice",
        unit: "%",
        style: MarkStyle::Bars,
        span: 1.0,
        value: |slice| slice.contribution.map(|share| 100.0 * share),
    },
    Quantity {
        title: "Sharpness",
        hint: "How much detail each slice has",
        unit: "",
        style: MarkStyle::Points,
        span: 0.0,
        value: |slice| slice.sharpness,
    },
    Quantity {
        title: "Residual",
        hint: "Shift that the calibration does not explain",
        unit: "px",
        style: MarkStyle::Bars,
        span: 0.2,
        value: |slice| slice.residual_px,
    },
    Quantity {
        title: "Exposure",
        hint: "Brightness over that of the reference slice",
        unit: "",
        style: MarkStyle::Points,
        span: 0.02,
        value: |slice| slice.exposure_ratio,
    },
];

/// The plots; empty without slices.
pub fn plots(metrics: &Metrics, reference: Option<usize>) -> Markup {
    if metrics.slices.is_empty() {
        return html! {};
    }
    let mut named: BTreeMap<usize, Vec<&str>> = BTreeMap::new();
    for finding in metrics.findings.iter().filter(|finding| finding.severity == Severity::Warning) {
        for slice in &finding.slices {
            named.entry(*slice as usize).or_default().push(finding.code.as_str());
        }
    }
    html! {
        section {
            h2 { "Slices" }
            p.soft.small { "Slices are numbered from 0, in the order in which they are fused." }
            @if !named.is_empty() {
                p.soft.small { "Bands mark slices that a warning names: "
                    @for (at, (slice, codes)) in named.iter().enumerate() {
                        @if at > 0 { ", " } "slice " (slice) " (" (codes.join(", ").replace('_', " ")) ")"
                    } "." }
            }
            div.plots {
                @for quantity in &QUANTITIES {
                    (PreEscaped(figure(quantity, metrics, &named, reference)))
                }
            }
        }
    }
}

fn figure(
    quantity: &Quantity,
    metrics: &Metrics,
    named: &BTreeMap<usize, Vec<&str>>,
    reference: Option<usize>,
) -> String {
    let count = metrics.slices.len();
    let mark = |slice: &SliceMetrics| {
        let value = (quantity.value)(slice)?;
        let at = slice.index as usize;
        let finding =
            named.get(&at).map(|codes| format!(": {}", codes.join(", ").replace('_', " "))).unwrap_or_default();
        let title = format!("{} {}: {value:.4} {}{finding}", slice.index, slice.name, quantity.unit);
        let second = named.contains_key(&at);
        Some(Mark { slice: at, value, measured: true, sigma: None, second, title })
    };
    let chart = Chart {
        title: quantity.title,
        hint: quantity.hint.to_owned(),
        unit: quantity.unit,
        count,
        reference: reference.unwrap_or(0),
        bands: named.keys().copied().filter(|slice| *slice < count).collect(),
        marks: metrics.slices.iter().filter_map(mark).collect(),
        lines: Vec::new(),
        style: quantity.style,
        scale: Scale::Linear(quantity.span),
        empty: "Not measured.",
    };
    chart.figure()
}
