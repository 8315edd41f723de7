//! What is dark, what is bright, and where between them the object ends.

use super::otsu::Histogram;
use crate::types::mask_options::MaskThreshold;

/// Of the dark pixels, this part is darker than what stands for the object: most of them lie inside it.
const DARK: f64 = 0.25;
/// Of the bright pixels the middle one stands for the background.
const BRIGHT: f64 = 0.5;

/// Tones that differ by less are of one kind: noise, or slices of a white light whose gains differ. Share of full scale...
const LEAST_CONTRAST: f64 = 0.02;
/// ... and of the bright one.
const LEAST_CONTRAST_OF_LIGHT: f64 = 0.1;

/// The tones of a back light, shares of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tones {
    /// The object where it covers whole pixels.
    pub dark: f64,
    /// Where it covers half of a pixel.
    pub threshold: f64,
    /// The background.
    pub bright: f64,
    /// Variance between the two classes over the variance of all; none when there is one value only.
    pub separability: Option<f64>,
}

impl Tones {
    /// Of a histogram, with the threshold that is asked for.
    ///
    /// Otsu's threshold parts the two kinds of pixels, but lies nearer to the kind that scatters more. An edge is where
    /// the object covers half of the pixel: half-way between what stands for each kind.
    pub(super) fn of(histogram: &Histogram, asked: MaskThreshold) -> Self {
        let otsu = histogram.otsu();
        let split = match asked {
            MaskThreshold::Fixed(threshold) => threshold,
            // one value only: no threshold can part it
            MaskThreshold::Auto => otsu.map_or(0.5, |otsu| otsu.threshold),
        };
        let (dark, bright) = (histogram.quantile(0.0, split, DARK), histogram.quantile(split, 2.0, BRIGHT));
        if let (MaskThreshold::Auto, Some(dark), Some(bright)) = (asked, dark, bright)
            && bright - dark < LEAST_CONTRAST.max(bright * LEAST_CONTRAST_OF_LIGHT)
        {
            // all of one kind: background when it is bright, object when it is not
            return Self { dark: 0.0, threshold: 0.5, bright: 1.0, separability: otsu.map(|otsu| otsu.separability) };
        }
        let (threshold, separability) = match (asked, dark, bright) {
            (MaskThreshold::Fixed(threshold), ..) => (threshold, histogram.separability(threshold)),
            (MaskThreshold::Auto, Some(dark), Some(bright)) => {
                (f64::midpoint(dark, bright), otsu.map(|otsu| otsu.separability))
            }
            (MaskThreshold::Auto, ..) => (split, otsu.map(|otsu| otsu.separability)),
        };
        Self { dark: dark.unwrap_or(0.0), threshold, bright: bright.unwrap_or(1.0), separability }
    }

    /// Share of a pixel of this value that the object covers: 0.5 at the threshold, in straight lines to 1 at `dark` and
    /// to 0 at `bright`.
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
    fn the_edge_is_half_way_however_few_pixels_are_object() {
        for object in [30, 300, 3000] {
            let tones = Tones::of(&histogram(&[(0.05, object), (0.8, 4000), (0.4, 20)]), MaskThreshold::Auto);
            assert!((tones.threshold - 0.425).abs() < 0.001, "{object}: {tones:?}");
            assert!((tones.cover(0.425) - 0.5).abs() < 0.001 && tones.cover(0.0) == 1.0 && tones.cover(0.9) == 0.0);
            assert!((tones.cover(0.6125) - 0.25).abs() < 0.001);
        }
    }

    #[test]
    fn a_threshold_that_is_given_is_taken_and_covers_half() {
        let tones = Tones::of(&histogram(&[(0.1, 50), (0.8, 50)]), MaskThreshold::Fixed(0.7));
        assert_eq!(tones.threshold, 0.7);
        assert!((tones.cover(0.7) - 0.5).abs() < 1e-6 && (tones.cover(0.4) - 0.75).abs() < 1e-3);
    }

    #[test]
    fn one_value_is_all_object_or_all_background() {
        assert_eq!(Tones::of(&histogram(&[(0.1, 9)]), MaskThreshold::Auto).threshold, 0.5);
        assert_eq!(Tones::of(&histogram(&[(0.9, 9)]), MaskThreshold::Auto).separability, None);
        for one_kind in [&[(0.97, 50), (0.99, 50), (1.0, 99)][..], &[(0.0, 50), (0.01, 50)], &[(0.2, 9), (0.21, 9)]] {
            assert_eq!(Tones::of(&histogram(one_kind), MaskThreshold::Auto).threshold, 0.5);
        }
    }
}
