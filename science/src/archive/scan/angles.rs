//! Pan and tilt in the name of a view.

use std::ops::Range;

use super::view::{Angle, AxisRule, ScanRules};
use crate::types::view::leading_number;

/// What a name says about the angles of a view.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct NamedAngles {
    /// Pan, degrees.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees.
    pub tilt_deg: Option<f64>,
    /// The rest of the name; `None` when there is nothing else.
    pub rest: Option<String>,
}

/// A number after a word.
struct Number {
    /// Word and number.
    range: Range<usize>,
    value: f64,
    /// The two are joined by `=`.
    is_assigned: bool,
}

/// Reads the angles in `name`, which may have folders. An angle that occurs twice is ambiguous and is not read.
pub(super) fn read(name: &str, rules: &ScanRules) -> NamedAngles {
    let lower = name.to_ascii_lowercase();
    let mut found = NamedAngles::default();
    let mut used: Vec<Range<usize>> = Vec::new();
    let words: [(&str, AxisRule); 4] = [
        ("pan", AxisRule { angle: Angle::Pan, degrees_per_unit: Some(1.0), zero: 0.0 }),
        ("tilt", AxisRule { angle: Angle::Tilt, degrees_per_unit: Some(1.0), zero: 0.0 }),
        ("x", rules.x),
        ("y", rules.y),
    ];
    for (word, rule) in words {
        let Some(number) = only(&lower, word) else { continue };
        let per_unit = rule.degrees_per_unit.or(number.is_assigned.then_some(1.0));
        let Some(per_unit) = per_unit else { continue };
        let place = match rule.angle {
            Angle::Pan => &mut found.pan_deg,
            Angle::Tilt => &mut found.tilt_deg,
        };
        if place.is_none() {
            *place = Some((number.value - rule.zero) * per_unit);
            used.push(number.range);
        }
    }
    if found.pan_deg.is_none()
        && found.tilt_deg.is_none()
        && let Some((tilt, pan)) = numbered(&lower)
    {
        (found.tilt_deg, found.pan_deg) = (Some(tilt), Some(pan));
        return found;
    }
    found.rest = rest(name, used);
    found
}

/// The number after `word`, if there is exactly one. The word must not be the end of a longer word.
fn only(name: &str, word: &str) -> Option<Number> {
    let mut numbers = name.match_indices(word).filter_map(|(at, _)| {
        if name[..at].ends_with(|c: char| c.is_alphanumeric()) {
            return None;
        }
        let after = at + word.len();
        let joined = name[after..].starts_with(['=', '_', ' ']);
        let start = after + usize::from(joined);
        let (value, length) = leading_number(&name[start..])?;
        Some(Number { range: at..start + length, value, is_assigned: name[after..].starts_with('=') })
    });
    let first = numbers.next()?;
    numbers.next().is_none().then_some(first)
}

/// Tilt and pan of `image_0001_-70_0`: number, tilt, pan.
fn numbered(name: &str) -> Option<(f64, f64)> {
    let base = name.rsplit('/').next()?;
    let mut parts = base.strip_prefix("image_")?.split('_');
    let (count, tilt, pan) = (parts.next()?, parts.next()?, parts.next()?);
    if parts.next().is_some() || count.is_empty() || !count.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let whole = |text: &str| leading_number(text).filter(|(_, length)| *length == text.len()).map(|(value, _)| value);
    Some((whole(tilt)?, whole(pan)?))
}

/// The name without the ranges that were read; `None` when no letter or digit is left.
fn rest(name: &str, mut used: Vec<Range<usize>>) -> Option<String> {
    used.sort_by_key(|range| range.start);
    let mut kept = String::new();
    let mut at = 0;
    for range in used {
        kept.push_str(name.get(at..range.start)?);
        // what joins both sides
        kept.push('_');
        at = range.end;
    }
    kept.push_str(name.get(at..)?);
    let mut label = String::new();
    for c in kept.chars() {
        let c = if c == '/' { '_' } else { c };
        if !(c == '_' && label.ends_with('_')) {
            label.push(c);
        }
    }
    let label = label.trim_matches(['_', '-', ' ', '.', ',']);
    label.chars().any(char::is_alphanumeric).then(|| label.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(pan_deg: Option<f64>, tilt_deg: Option<f64>, rest: Option<&str>) -> NamedAngles {
        NamedAngles { pan_deg, tilt_deg, rest: rest.map(str::to_owned) }
    }

    #[test]
    fn angles_are_read_from_the_names_that_labs_use() {
        let rules = ScanRules::default();
        for (name, expected) in [
            ("pan020p5_tilt-06", found(Some(20.5), Some(-6.0), None)),
            ("x=6/y=120", found(Some(120.0), Some(6.0), None)),
            ("Bee 4/Tilt=-6/Pan=7.25", found(Some(7.25), Some(-6.0), Some("Bee 4"))),
            ("pan022,5_tilt-7,5", found(Some(22.5), Some(-7.5), None)),
            ("pan=7,25/tilt=10,5", found(Some(7.25), Some(10.5), None)),
            ("tilt_12,5_pan_337,5_a", found(Some(337.5), Some(12.5), Some("a"))),
            ("x=6,5/y=120", found(Some(120.0), Some(6.5), None)),
            ("image_0001_-7,5_0", found(Some(0.0), Some(-7.5), None)),
            ("pan22,left", found(Some(22.0), None, Some("left"))),
            ("bee_pan_40", found(Some(40.0), None, Some("bee"))),
            ("_x_00190_y_00000", found(None, None, Some("x_00190_y_00000"))),
            ("image_0001_-70_0", found(Some(0.0), Some(-70.0), None)),
            ("image_0001_a_0", found(None, None, Some("image_0001_a_0"))),
            ("span3_expan4", found(None, None, Some("span3_expan4"))),
            ("pan1_pan2_tilt3", found(None, Some(3.0), Some("pan1_pan2"))),
            ("head on", found(None, None, Some("head on"))),
        ] {
            assert_eq!(read(name, &rules), expected, "{name}");
        }
    }

    #[test]
    fn motor_steps_become_angles_by_rule() {
        let rules = ScanRules {
            x: AxisRule { angle: Angle::Tilt, degrees_per_unit: Some(0.1), zero: 100.0 },
            y: AxisRule { angle: Angle::Pan, degrees_per_unit: Some(-0.225), zero: 0.0 },
        };
        let read = read("_x_00190_y_00400", &rules);
        assert!((read.tilt_deg.expect("tilt") - 9.0).abs() < 1e-12);
        assert!((read.pan_deg.expect("pan") + 90.0).abs() < 1e-12);
        assert_eq!(read.rest, None);
    }
}
