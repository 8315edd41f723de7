//! The tones of object and background, and the threshold half-way between them.
//!
//! Otsu's threshold separates the two classes, but is nearer to the class that scatters more. The edge of the object is
//! where it covers half of a pixel, so the threshold is `(dark + bright) / 2`, with `dark` the lower quartile of the
//! dark class and `bright` the median of the bright one.

use super::otsu::Histogram;
use crate::types::mask_options::MaskThreshold;

/// Quantile of the dark pixels that represents the object. Most dark pixels are inside it; those at its edge are
/// brighter.
const DARK_QUANTILE: f64 = 0.25;
/// Quantile of the bright pixels that represents the background.
const BRIGHT_QUANTILE: f64 = 0.5;

/// Least difference of the tones for two classes, as a share of full scale, and as a share of the bright tone. Less is
/// noise, or slices of a white light whose gains differ.
const MIN_CONTRAST: f64 = 0.02;
const MIN_RELATIVE_CONTRAST: f64 = 0.1;

/// The tones of a back light, shares of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tones {
    /// Value where the object covers whole pixels.
    pub dark: f64,
    /// Value where it covers half of a pixel.
    pub threshold: f64,
    /// Value of the background.
    pub bright: f64,
    /// Between-class variance over total variance; none when there is a single value.
    pub separability: Option<f64>,
    /// Whether there is only one class, all object or all background. Then `dark` or `bright` is not measured, and a
    /// cover between 0 and 1 means nothing.
    pub one_class: bool,
}

impl Tones {
    /// The tones of a histogram, with the threshold found in it or given.
    pub(super) fn of(histogram: &Histogram, requested: MaskThreshold) -> Self {
        let otsu = histogram.otsu();
        let split = match requested {
            MaskThreshold::Fixed(threshold) => threshold,
            // a single value
            MaskThreshold::Auto => otsu.map_or(0.5, |otsu| otsu.threshold),
        };
        let (dark, bright) =
            (histogram.quantile(0.0, split, DARK_QUANTILE), histogram.quantile(split, 2.0, BRIGHT_QUANTILE));
        if let (MaskThreshold::Auto, Some(dark), Some(bright)) = (requested, dark, bright)
            && bright - dark < MIN_CONTRAST.max(bright * MIN_RELATIVE_CONTRAST)
        {
            // one class: all background when it is bright, all object when it is dark
            let separability = otsu.map(|otsu| otsu.separability);
            return Self { dark: 0.0, threshold: 0.5, bright: 1.0, separability, one_class: true };
        }
        let (threshold, separability) = match (requested, dark, bright) {
            (MaskThreshold::Fixed(threshold), ..) => (threshold, histogram.separability(threshold)),
            (MaskThreshold::Auto, Some(dark), Some(bright)) => {
                (f64::midpoint(dark, bright), otsu.map(|otsu| otsu.separability))
            }
            (MaskThreshold::Auto, ..) => (split, otsu.map(|otsu| otsu.separability)),
        };
        let one_class = dark.is_none() || bright.is_none();
        Self { dark: dark.unwrap_or(0.0), threshold, bright: bright.unwrap_or(1.0), separability, one_class }
    }

    /// Share of a pixel of this value that the object covers, 0 to 1: 0.5 at the threshold, linear from there to 1 at
    /// `dark` and to 0 at `bright`.
    pub(super) fn cover(&self, value: f32) -> f32 {
        let value = f64::from(value);
        let part = |length: f64, whole: f64| 0.5 * (length / whole.max(1e-6)).clamp(0.0, 1.0);
        let cover = if value < self.threshold {
            0.5 + part(self.threshold - value, self.threshold - self.dark)
        } else {
            0.5 - part(value - self.threshold, self.bright - self.threshold)
        };
        cover as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn histogram(parts: &[(f32, usize)]) -> Histogram {
        Histogram::of(parts.iter().flat_map(|&(value, count)| std::iter::repeat_n(value, count)))
    }

    #[test]
    fn the_threshold_is_half_way_between_the_tones_however_small_the_object_is() {
        for object in [30, 300, 3000] {
            let tones = Tones::of(&histogram(&[(0.05, object), (0.8, 4000), (0.4, 20)]), MaskThreshold::Auto);
            assert!((tones.threshold - 0.425).abs() < 0.001, "{object}: {tones:?}");
            assert!((tones.cover(0.425) - 0.5).abs() < 0.001 && tones.cover(0.0) == 1.0 && tones.cover(0.9) == 0.0);
            assert!((tones.cover(0.6125) - 0.25).abs() < 0.001);
        }
    }

    #[test]
    fn a_fixed_threshold_is_used_and_has_a_cover_of_one_half() {
        let tones = Tones::of(&histogram(&[(0.1, 50), (0.8, 50)]), MaskThreshold::Fixed(0.7));
        assert_eq!(tones.threshold, 0.7);
        assert!((tones.cover(0.7) - 0.5).abs() < 1e-6 && (tones.cover(0.4) - 0.75).abs() < 1e-3);
    }

    #[test]
    fn a_picture_of_one_class_is_all_object_or_all_background() {
        assert_eq!(Tones::of(&histogram(&[(0.1, 9)]), MaskThreshold::Auto).threshold, 0.5);
        assert_eq!(Tones::of(&histogram(&[(0.9, 9)]), MaskThreshold::Auto).separability, None);
        for one_kind in [&[(0.97, 50), (0.99, 50), (1.0, 99)][..], &[(0.0, 50), (0.01, 50)], &[(0.2, 9), (0.21, 9)]] {
            let tones = Tones::of(&histogram(one_kind), MaskThreshold::Auto);
            assert!(tones.threshold == 0.5 && tones.one_class, "{one_kind:?}: {tones:?}");
        }
        assert!(!Tones::of(&histogram(&[(0.1, 9), (0.9, 9)]), MaskThreshold::Auto).one_class);
        for threshold in [0.05, 0.95] {
            let tones = Tones::of(&histogram(&[(0.1, 9), (0.9, 9)]), MaskThreshold::Fixed(threshold));
            assert!(tones.one_class, "{threshold}: {tones:?}");
        }
    }
}
