//! The comparison of a case with its truth, and the tables over all cases.

use std::fmt;

use pinstack_science::{
    calibration::{Calibration, DotUse, calibrate},
    imaging::Raster,
    synth::{DotTarget, Rig, target_stack},
    types::{Interrupted, NoControl, calibration_options::CalibrationOptions},
};

use super::case::Case;

/// Largest blur (radius over pitch) at which a slice should be measured; beyond it, it may be predicted.
const MEASURABLE: f64 = 0.45;
/// A dot farther than this share of the pitch from every true dot is false.
const FALSE_DOT: f64 = 0.25;

/// A slice compared with its truth.
#[derive(Debug, Clone)]
struct Judged {
    /// True for the reference slice: only its dots can be wrong.
    reference: bool,
    /// Blur radius over pitch.
    blur: f64,
    interpolated: bool,
    /// Largest error at the image corners, px.
    corner: f64,
    /// Corner uncertainty reported by the calibration, px.
    sigma: Option<f64>,
    /// Sum of the squared errors of the dot centres, px^2.
    squares: f64,
    dots: usize,
    false_dots: usize,
    /// Error of the gain, %.
    gain: f64,
}

impl Judged {
    fn measured(&self) -> bool {
        self.blur <= MEASURABLE && !self.interpolated
    }
}

/// Result of a case.
#[derive(Debug, Clone)]
pub struct Outcome {
    name: String,
    factors: String,
    result: Result<Vec<Judged>, String>,
    /// Wall time, s. Cases run in parallel, so it only shows which ones are slow.
    seconds: f64,
}

/// Renders a case, calibrates it, and compares the result with the truth.
pub fn judge(case: &Case) -> Outcome {
    let (rig, target) = case.build();
    let stack = target_stack(&rig, &target);
    let started = std::time::Instant::now();
    let result =
        calibrate(&&stack[..] as &dyn pinstack_science::imaging::Slices, &CalibrationOptions::default(), &NoControl);
    let seconds = started.elapsed().as_secs_f64();
    let result = match result {
        Ok(calibration) => Ok(judge_slices(case, &rig, &target, &calibration, &stack)),
        Err(Interrupted::Failed(fault)) => Err(format!("{:?}: {}", fault.kind, fault.detail)),
        Err(Interrupted::Cancelled(_)) => Err("cancelled".into()),
    };
    Outcome { name: case.name.clone(), factors: case.factors(), result, seconds }
}

fn judge_slices(case: &Case, rig: &Rig, target: &DotTarget, found: &Calibration, stack: &[Raster]) -> Vec<Judged> {
    let spacing = if case.asymmetric { std::f64::consts::FRAC_1_SQRT_2 } else { 1.0 };
    let (width, height) = (rig.width as u32, rig.height as u32);
    let reference = target.dots(rig, rig.reference);
    let seen = |px: [f64; 2]| px[0] >= 0.0 && px[1] >= 0.0 && px[0] < rig.width as f64 && px[1] < rig.height as f64;
    let judge = |i: usize| {
        let slice = &found.slices[i];
        let truth = target.dots(rig, i);
        let printed: Vec<[f64; 2]> =
            truth.iter().enumerate().filter(|(dot, _)| !target.missing.contains(dot)).map(|(_, at)| *at).collect();
        let pitch = spacing * target.pitch_px(rig, i);
        let used = found.dots[i].iter().filter(|dot| dot.used != DotUse::Outlier);
        let distances: Vec<f64> = used.map(|dot| nearest(dot.at, &printed)).collect();
        let (good, bad): (Vec<f64>, Vec<f64>) = distances.into_iter().partition(|&error| error < FALSE_DOT * pitch);
        let gains = reference.iter().zip(&truth).filter(|(a, b)| seen(**a) && seen(**b));
        let gain = median(
            gains.map(|(a, b)| target.stored_white(rig, rig.reference, *a) / target.stored_white(rig, i, *b)).collect(),
        );
        let corner = slice.homography.corner_distance(&rig.homography(i), width, height);
        Judged {
            reference: i == rig.reference,
            blur: target.blur_radius_px(rig, i) / pitch,
            interpolated: slice.interpolated,
            corner: if corner.is_nan() { f64::INFINITY } else { corner },
            sigma: slice.corner_sigma_px,
            squares: good.iter().map(|error| error * error).sum(),
            dots: good.len(),
            false_dots: bad.len(),
            gain: 100.0 * (slice.gain / gain - 1.0).abs(),
        }
    };
    (0..stack.len()).map(judge).collect()
}

fn nearest(at: [f64; 2], dots: &[[f64; 2]]) -> f64 {
    dots.iter().map(|dot| (dot[0] - at[0]).hypot(dot[1] - at[1])).fold(f64::INFINITY, f64::min)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The maximum; NaN for no values.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NAN, f64::max)
}

/// RMS error of the dots of several slices.
fn rms<'a>(slices: impl Iterator<Item = &'a Judged>) -> f64 {
    let (sum, count) = slices.fold((0.0, 0), |(sum, count), slice| (sum + slice.squares, count + slice.dots));
    (sum / count as f64).sqrt()
}

/// Share of the slices, in %, whose corner error is at most three reported sigmas.
fn honest<'a>(slices: impl Iterator<Item = &'a Judged>) -> f64 {
    let (mut honest, mut count) = (0_usize, 0_usize);
    for slice in slices {
        let Some(sigma) = slice.sigma else { continue };
        count += 1;
        honest += usize::from(slice.corner <= 3.0 * sigma);
    }
    100.0 * honest as f64 / count as f64
}

/// Summary of one case.
struct Line {
    measured: f64,
    beyond: f64,
    sharp: f64,
    centres: f64,
    false_dots: usize,
    gain: f64,
    honest: f64,
    interpolated: usize,
}

impl Line {
    fn of(slices: &[Judged]) -> Self {
        let others = || slices.iter().filter(|s| !s.reference);
        Self {
            measured: largest(others().filter(|s| s.measured()).map(|s| s.corner)),
            beyond: largest(others().filter(|s| !s.measured()).map(|s| s.corner)),
            sharp: rms(slices.iter().filter(|s| s.blur < 0.1)),
            centres: rms(slices.iter().filter(|s| s.blur <= 0.4)),
            false_dots: slices.iter().map(|s| s.false_dots).sum(),
            gain: largest(others().map(|s| s.gain)),
            honest: honest(others()),
            interpolated: slices.iter().filter(|s| s.interpolated).count(),
        }
    }
}

/// The number, or a dash for NaN.
fn number(value: f64, digits: usize) -> String {
    if value.is_nan() { "-".into() } else { format!("{value:.digits$}") }
}

impl Outcome {
    /// Header of the lines.
    pub const HEADER: &'static str = "case              corner px: measured   beyond | centres px: sharp  to 0.4 | false | gain % | \
         honest % | predicted |     s | factors";
    /// Header of the CSV file.
    pub const CSV_HEADER: &'static str = "case,factors,corner_measured_px,corner_beyond_px,centres_sharp_px,\
         centres_px,false_dots,gain_percent,honest_percent,predicted,failure";

    /// Line of the CSV file.
    pub fn csv(&self) -> String {
        let (name, factors) = (&self.name, &self.factors);
        match &self.result {
            Ok(slices) => {
                let line = Line::of(slices);
                let numbers = [line.measured, line.beyond, line.sharp, line.centres];
                let numbers = numbers.map(|value| number(value, 5)).join(",");
                let (gain, honest) = (number(line.gain, 4), number(line.honest, 1));
                format!("{name},{factors},{numbers},{},{gain},{honest},{},\n", line.false_dots, line.interpolated)
            }
            Err(why) => format!("{name},{factors},,,,,,,,,\"{}\"\n", why.replace('"', "'")),
        }
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let slices = match &self.result {
            Ok(slices) => slices,
            Err(why) => return write!(f, "{:<18} FAILED {why} | {:.1} | {}", self.name, self.seconds, self.factors),
        };
        let line = Line::of(slices);
        write!(
            f,
            "{:<18}{:>19} {:>8} |{:>18} {:>7} |{:>6} |{:>7} |{:>9} |{:>10} |{:>6.1} | {}",
            self.name,
            number(line.measured, 3),
            number(line.beyond, 3),
            number(line.sharp, 4),
            number(line.centres, 4),
            line.false_dots,
            number(line.gain, 2),
            number(line.honest, 0),
            line.interpolated,
            self.seconds,
            self.factors
        )
    }
}

/// Blur classes: name, and largest blur radius over pitch.
const CLASSES: [(&str, f64); 6] = [
    ("blur up to 0.1", 0.1),
    ("0.1 to 0.2", 0.2),
    ("0.2 to 0.3", 0.3),
    ("0.3 to 0.4", 0.4),
    ("0.4 to 0.45", MEASURABLE),
    ("beyond 0.45", f64::INFINITY),
];

/// The summary: slices by blur class for each block of cases, then the failures.
pub fn tables(outcomes: &[Outcome]) -> String {
    let random = |outcome: &&Outcome| outcome.name.starts_with("random");
    let mut text = String::new();
    let blocks: [(&str, Vec<&Outcome>); 3] = [
        ("each factor alone", outcomes.iter().filter(|o| !random(o)).collect()),
        ("random combinations", outcomes.iter().filter(random).collect()),
        ("all", outcomes.iter().collect()),
    ];
    for (name, block) in &blocks {
        text.push_str(&table(name, block));
    }
    for outcome in outcomes {
        if let Err(why) = &outcome.result {
            text.push_str(&format!("FAILED {} ({}): {why}\n", outcome.name, outcome.factors));
        }
    }
    text
}

fn table(name: &str, block: &[&Outcome]) -> String {
    let slices: Vec<&Judged> = block.iter().filter_map(|o| o.result.as_ref().ok()).flatten().collect();
    let failures = block.iter().filter(|o| o.result.is_err()).count();
    let mut text = format!(
        "{name}: {} cases, {failures} failed\n{:<16} slices predicted | corner px: median     95%      max | centres px | \
         false | gain %: median    max | honest %\n",
        block.len(),
        "slices"
    );
    let mut below = 0.0;
    for (class, up_to) in CLASSES {
        let low = std::mem::replace(&mut below, up_to);
        let of: Vec<&Judged> =
            slices.iter().copied().filter(|s| s.blur <= up_to && (s.blur > low || low == 0.0)).collect();
        text.push_str(&row(class, &of));
    }
    text.push_str(&row("all", &slices));
    let lines: Vec<Line> = block.iter().filter_map(|o| o.result.as_ref().ok()).map(|slices| Line::of(slices)).collect();
    let worst = |value: fn(&Line) -> f64| -> String {
        let values: Vec<f64> = lines.iter().map(value).filter(|value| !value.is_nan()).collect();
        format!("{} / {}", number(median(values.clone()), 3), number(largest(values.into_iter()), 3))
    };
    text.push_str(&format!(
        "worst per case, median / max: corner measured {}, corner beyond {}, centres sharp {}, centres to 0.4 {}, gain % {}\n\n",
        worst(|l| l.measured),
        worst(|l| l.beyond),
        worst(|l| l.sharp),
        worst(|l| l.centres),
        worst(|l| l.gain)
    ));
    text
}

fn row(class: &str, slices: &[&Judged]) -> String {
    let each = || slices.iter().copied().filter(|s| !s.reference);
    let mut corners: Vec<f64> = each().map(|s| s.corner).collect();
    corners.sort_by(f64::total_cmp);
    let at = |share: f64| corners.get((share * corners.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    format!(
        "{class:<16}{:>7}{:>10} |{:>18} {:>7} {:>8} |{:>11} |{:>6} |{:>15} {:>6} |{:>9}\n",
        corners.len(),
        each().filter(|s| s.interpolated).count(),
        number(at(0.5), 3),
        number(at(0.95), 3),
        number(largest(each().map(|s| s.corner)), 3),
        number(rms(slices.iter().copied()), 4),
        each().map(|s| s.false_dots).sum::<usize>(),
        number(median(each().map(|s| s.gain).collect()), 2),
        number(largest(each().map(|s| s.gain)), 2),
        number(honest(each()), 0),
    )
}
