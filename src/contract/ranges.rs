//! The rules of the options of stacks and calibrations. One row per range: the checks of a request and the schemas of
//! the OpenAPI document both use these tables.

use pinstack_science::types::{calibration_options::CalibrationOptions, error::ErrorLocation, profile::RAIL_MM};

use super::{
    Fault,
    options::{BitDepth, ImageFormat, StackOptions},
};

/// The values that an option may have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// A whole number from the first to the second.
    Whole(u32, u32),
    /// An odd number from the first to the second.
    Odd(u32, u32),
    /// A number from the first to the second.
    Number(f64, f64),
    /// A number of either sign whose absolute value is from the first to the second.
    Magnitude(f64, f64),
    /// A text of at most so many characters.
    Characters(u32),
}

/// An option: its name, its range, and where it is in the options.
pub struct Rule<O> {
    /// Name of the option, as parameter and in JSON.
    pub name: &'static str,
    /// Its range.
    pub range: Range,
    /// The value; for a text the number of its characters. `None` where the option is not set.
    value: fn(&O) -> Option<f64>,
}

/// The options of a stack that have a range.
pub const STACK: [Rule<StackOptions>; 12] = [
    Rule { name: "r1", range: Range::Whole(1, 200), value: |o| Some(o.r1.into()) },
    Rule { name: "r2", range: Range::Whole(1, 200), value: |o| Some(o.r2.into()) },
    Rule { name: "eps1", range: Range::Number(1e-9, 10.0), value: |o| Some(o.eps1) },
    Rule { name: "eps2", range: Range::Number(1e-9, 10.0), value: |o| Some(o.eps2) },
    Rule { name: "average", range: Range::Odd(3, 201), value: |o| Some(o.average.into()) },
    Rule { name: "r_g", range: Range::Whole(1, 20), value: |o| Some(o.r_g.into()) },
    Rule { name: "sigma_g", range: Range::Number(0.1, 50.0), value: |o| Some(o.sigma_g) },
    Rule { name: "jpeg_quality", range: Range::Whole(1, 100), value: |o| Some(o.jpeg_quality.into()) },
    Rule { name: "label", range: Range::Characters(200), value: |o| characters(o.label.as_ref()) },
    Rule { name: "pan_deg", range: Range::Number(-3600.0, 3600.0), value: |o| o.pan_deg },
    Rule { name: "tilt_deg", range: Range::Number(-360.0, 360.0), value: |o| o.tilt_deg },
    Rule { name: "keep_days", range: Range::Whole(1, 36_500), value: |o| o.keep_days.map(f64::from) },
];

/// The options of a calibration that have a range.
pub const CALIBRATION: [Rule<CalibrationOptions>; 8] = [
    Rule { name: "target_pitch_mm", range: Range::Number(1e-4, 1000.0), value: |o| o.target_pitch_mm },
    Rule { name: "pixel_pitch_mm", range: Range::Number(1e-5, 1.0), value: |o| o.pixel_pitch_mm },
    Rule { name: "focal_mm", range: Range::Number(0.1, 10_000.0), value: |o| o.focal_mm },
    Rule { name: "pupil_ratio", range: Range::Number(0.05, 20.0), value: |o| o.pupil_ratio },
    Rule { name: "target_advance_mm", range: Range::Magnitude(1e-3, 1000.0), value: |o| o.target_advance_mm },
    Rule { name: "moved_target_pitch_px", range: Range::Number(1.0, 65_535.0), value: |o| o.moved_target_pitch_px },
    Rule { name: "rail_step_mm", range: Range::Magnitude(1e-6, 1000.0), value: |o| o.rail_step_mm },
    Rule { name: "note", range: Range::Characters(4000), value: |o| characters(o.note.as_ref()) },
];

/// The range of an option of either kind.
pub fn of(name: &str) -> Option<Range> {
    let stack = STACK.iter().map(|rule| (rule.name, rule.range));
    let calibration = CALIBRATION.iter().map(|rule| (rule.name, rule.range));
    stack.chain(calibration).find(|(option, _)| *option == name).map(|(_, range)| range)
}

impl StackOptions {
    /// Checks what the types alone do not: the ranges, and options that contradict one another.
    ///
    /// # Errors
    /// A [`Fault`] with [`Code::InvalidRequest`](super::Code::InvalidRequest) and a location for each option.
    pub fn check(&self) -> Result<(), Fault> {
        let mut found = violations(self, &STACK);
        if self.format == ImageFormat::Jpeg && self.bit_depth == BitDepth::Sixteen {
            let rule = "is 16, but a JPEG has 8 bits: send bit_depth=8, or format=png or tiff";
            found.push(violation("bit_depth", rule));
        }
        Fault::refuse(found)
    }
}

/// Checks the options of a calibration: the ranges, and options that contradict one another.
///
/// # Errors
/// A [`Fault`] with [`Code::InvalidRequest`](super::Code::InvalidRequest) and a location for each option.
pub fn check_calibration(options: &CalibrationOptions) -> Result<(), Fault> {
    let mut found = violations(options, &CALIBRATION);
    let positions = options.rail_positions_mm.as_deref().unwrap_or_default();
    if positions.iter().any(|z| !RAIL_MM.contains(z)) || (!positions.is_empty() && options.rail_step_mm.is_some()) {
        let rule = "must be numbers from -1000000 to 1000000 and cannot be combined with rail_step_mm";
        found.push(violation("rail_positions_mm", rule));
    }
    found.extend(refined(options));
    let is_moved = options.moved_target.is_some() || options.moved_target_pitch_px.is_some();
    if is_moved && options.target_advance_mm.is_none() {
        let rule = "is missing: give by how many mm the target was nearer to the lens in moved_target";
        found.push(violation("target_advance_mm", rule));
    }
    Fault::refuse(found)
}

/// What contradicts `from`, which keeps all of a revision but its homographies.
fn refined(options: &CalibrationOptions) -> Vec<ErrorLocation> {
    if options.from.is_none() {
        return Vec::new();
    }
    if options.source.is_dot_target() {
        return vec![violation("from", "is for source=stacks; a dot target measures the whole profile: omit it")];
    }
    let given = [
        ("reference_index", options.reference_index.is_some()),
        ("target_pitch_mm", options.target_pitch_mm.is_some()),
        ("pixel_pitch_mm", options.pixel_pitch_mm.is_some()),
        ("rail_positions_mm", options.rail_positions_mm.is_some()),
        ("rail_step_mm", options.rail_step_mm.is_some()),
        ("focal_mm", options.focal_mm.is_some()),
        ("pupil_ratio", options.pupil_ratio.is_some()),
        ("moved_target", options.moved_target.is_some()),
        ("target_advance_mm", options.target_advance_mm.is_some()),
        ("capture_mode", options.capture_mode.is_some()),
    ];
    let rule = "cannot be combined with from, which keeps that of the revision: omit one of them";
    given.iter().filter(|(_, is_given)| *is_given).map(|(name, _)| violation(name, rule)).collect()
}

/// The options outside of their ranges.
fn violations<O>(options: &O, rules: &[Rule<O>]) -> Vec<ErrorLocation> {
    let is_outside = |rule: &&Rule<O>| (rule.value)(options).is_some_and(|value| !rule.range.contains(value));
    rules.iter().filter(is_outside).map(|rule| violation(rule.name, &rule.range.to_string())).collect()
}

/// The location of an option that breaks a rule.
fn violation(name: &str, rule: &str) -> ErrorLocation {
    ErrorLocation { detail: format!("{name} {rule}"), pointer: Some(name.to_owned()), ..ErrorLocation::default() }
}

impl Range {
    /// Whether a value is in the range. NaN never is.
    fn contains(self, value: f64) -> bool {
        match self {
            Self::Whole(least, most) => (f64::from(least)..=f64::from(most)).contains(&value),
            Self::Odd(least, most) => Self::Whole(least, most).contains(value) && value % 2.0 == 1.0,
            Self::Number(least, most) => (least..=most).contains(&value),
            Self::Magnitude(least, most) => (least..=most).contains(&value.abs()),
            Self::Characters(most) => value <= f64::from(most),
        }
    }
}

impl std::fmt::Display for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Whole(least, most) => write!(f, "must be {least} to {most}"),
            Self::Odd(least, most) => write!(f, "must be odd, {least} to {most}"),
            Self::Number(least, most) => write!(f, "must be {} to {}", number(least), number(most)),
            Self::Magnitude(least, most) => {
                let (least, most) = (number(least), number(most));
                write!(f, "must be {least} to {most}, or -{most} to -{least}")
            }
            Self::Characters(most) => write!(f, "must have at most {most} characters"),
        }
    }
}

/// Whole numbers without a fraction, small ones as `1e-9`.
fn number(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value}") } else { format!("{value:?}") }
}

fn characters(text: Option<&String>) -> Option<f64> {
    text.map(|text| text.chars().count() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_range_are_in_it_and_nan_is_in_none() {
        for (range, inside, outside) in [
            (Range::Whole(1, 200), [1.0, 200.0], [0.0, 201.0]),
            (Range::Odd(3, 201), [3.0, 201.0], [4.0, 203.0]),
            (Range::Number(0.1, 50.0), [0.1, 50.0], [0.05, f64::NAN]),
            (Range::Magnitude(1e-6, 1000.0), [-1e-6, 1000.0], [0.0, -1001.0]),
            (Range::Characters(200), [0.0, 200.0], [201.0, f64::NAN]),
        ] {
            assert_eq!(inside.map(|value| range.contains(value)), [true; 2], "{range:?}");
            assert_eq!(outside.map(|value| range.contains(value)), [false; 2], "{range:?}");
        }
    }

    #[test]
    fn a_message_names_the_option_and_its_range() {
        let options = StackOptions { r1: 0, eps2: 0.0, average: 4, ..StackOptions::default() };
        let details: Vec<String> = violations(&options, &STACK).into_iter().map(|location| location.detail).collect();
        assert_eq!(details, ["r1 must be 1 to 200", "eps2 must be 1e-9 to 10", "average must be odd, 3 to 201"]);
    }
}
