//! Axes with round tick values, and round lengths for scale bars.

/// The largest of 1, 2, 5, 10, ... (and 0.5, 0.2, ...) that is not above `value`.
pub(super) fn round_down(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let power = 10_f64.powf(value.log10().floor());
    let lead = value / power;
    // tolerance for rounding: 0.3 / 0.1 is less than 3
    let lead = [5.0, 2.0].into_iter().find(|step| lead >= step * (1.0 - 1e-9)).unwrap_or(1.0);
    lead * power
}

/// Decimals needed to write a number returned by [`round_down`].
pub(super) fn decimals(step: f64) -> usize {
    if !(step.is_finite() && step > 0.0) {
        return 0;
    }
    (-(step.log10() + 1e-9).floor()).clamp(0.0, 9.0) as usize
}

/// An axis of values.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    log: bool,
    /// Values of the grid lines, each with its label.
    pub ticks: Vec<(f64, String)>,
}

impl Axis {
    /// A linear axis over `low..=high`, widened to span at least `least`, so that noise does not look like a trend.
    pub(super) fn linear(low: f64, high: f64, least: f64) -> Self {
        let (mut low, mut high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        // an axis of non-negative values does not extend below 0
        let floor = low >= 0.0;
        let short = least - (high - low);
        if short > 0.0 {
            (low, high) = (low - short / 2.0, high + short / 2.0);
        }
        let margin = 0.07 * (high - low).max(f64::MIN_POSITIVE);
        (low, high) = (low - margin, high + margin);
        if floor && low < 0.0 {
            low = 0.0;
        }
        let step = round_down((high - low) / 2.6);
        let digits = decimals(step);
        let first = (low / step).ceil() as i64;
        let last = (high / step).floor() as i64;
        let tick = |k: i64| (k as f64 * step, super::html::number(k as f64 * step, digits));
        Self { low, high, log: false, ticks: (first..=last.min(first + 12)).map(tick).collect() }
    }

    /// A logarithmic axis over `low..=high`, both positive. Grid lines are at the powers of ten, and at three times
    /// them where the axis spans few decades.
    pub(super) fn logarithmic(low: f64, high: f64) -> Self {
        let low = low.max(1e-6);
        let high = high.max(low * 10.0);
        let (low, high) = (low / 1.3, high * 1.3);
        let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        let steps: &[f64] = if last - first > 2 { &[1.0] } else { &[1.0, 3.0] };
        let ticks = (first..=last)
            .flat_map(|power| steps.iter().map(move |step| step * 10_f64.powi(power)))
            .filter(|value| (low..=high).contains(value))
            .map(|value| (value, super::html::number(value, decimals(value))))
            .collect();
        Self { low, high, log: true, ticks }
    }

    /// Position of a value along the axis: 0 at the low end, 1 at the high end.
    pub(super) fn position(&self, value: f64) -> f64 {
        match self.log {
            false => (value - self.low) / (self.high - self.low),
            true => (value.max(1e-12) / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    /// True when the axis can show the value: finite, and positive on a logarithmic axis.
    pub(super) fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_one_two_or_five() {
        for (value, step) in [(0.3, 0.2), (0.5, 0.5), (7.0, 5.0), (10.0, 10.0), (1999.0, 1000.0), (0.019, 0.01)] {
            assert!((round_down(value) - step).abs() < 1e-12 * step, "{value}: {}", round_down(value));
        }
        assert_eq!((decimals(0.2), decimals(0.01), decimals(50.0), decimals(0.1)), (1, 2, 0, 1));
    }

    #[test]
    fn an_axis_has_two_to_six_ticks_whatever_its_range() {
        for (low, high, least) in
            [(0.97, 1.03, 1e-3), (1.0, 1.0, 0.02), (-40.0, 12.0, 1.0), (0.0, 0.3, 0.1), (5.0, 2.0, 0.0)]
        {
            let axis = Axis::linear(low, high, least);
            assert!((2..=6).contains(&axis.ticks.len()), "{low} to {high}: {:?}", axis.ticks);
            assert!(axis.ticks.iter().all(|(v, _)| (-1e-9..=1.0 + 1e-9).contains(&axis.position(*v))));
        }
        assert_eq!(Axis::linear(0.0, 0.3, 0.1).position(0.0), 0.0);
        let log = Axis::logarithmic(0.01, 20.0);
        assert!(log.ticks.iter().any(|(_, text)| text == "0.01") && !log.shows(0.0));
    }
}
