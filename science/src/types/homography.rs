//! Homographies: slice pixel -> reference-slice pixel.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Deserializer, Serialize, de};
use utoipa::ToSchema;

/// A plane projective transform from **slice pixels to reference-slice pixels**: 9 numbers, row-major, with `[8] == 1`.
/// x to the right, y down, the centre of the top-left pixel is (0, 0). JSON with three rows of three is accepted; the
/// output is always 9 numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[serde(transparent)]
#[schema(value_type = [f64; 9])]
pub struct Homography(pub [f64; 9]);

/// Largest movement of an image corner, in lengths of the image's longer side. A scale of 4 about a corner stays below
/// it, and so does a shift by the whole image.
const MAX_MOVE: f64 = 5.0;
/// Largest ratio of the stretch in two directions. Lenses stay below 1.01.
const MAX_ANISOTROPY: f64 = 4.0;

impl Homography {
    /// The identity.
    pub const IDENTITY: Self = Self([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);

    /// The map `scale * x + shift`.
    pub fn similarity(scale: f64, shift: [f64; 2]) -> Self {
        Self([scale, 0.0, shift[0], 0.0, scale, shift[1], 0.0, 0.0, 1.0])
    }

    /// From a matrix, normalised so that the last element is 1. `None` when that element is nearly 0 or an element is
    /// not finite.
    pub fn from_matrix(m: &Matrix3<f64>) -> Option<Self> {
        let last = m[(2, 2)];
        if last.abs() < 1e-12 || m.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let mut out = [0.0; 9];
        for row in 0..3 {
            for col in 0..3 {
                out[row * 3 + col] = m[(row, col)] / last;
            }
        }
        out[8] = 1.0;
        Some(Self(out))
    }

    /// As a matrix.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::from_row_slice(&self.0)
    }

    /// The image of `point`. Points on the horizon give non-finite coordinates.
    pub fn apply(&self, point: [f64; 2]) -> [f64; 2] {
        let v = self.matrix() * Vector3::new(point[0], point[1], 1.0);
        [v.x / v.z, v.y / v.z]
    }

    /// The inverse. `None` when singular.
    pub fn inverse(&self) -> Option<Self> {
        Self::from_matrix(&self.matrix().try_inverse()?)
    }

    /// Composition: first `self`, then `next`. `None` when the product cannot be normalised.
    pub fn then(&self, next: &Self) -> Option<Self> {
        Self::from_matrix(&(next.matrix() * self.matrix()))
    }

    /// True when no pixel moves, so that the slice can be used without resampling.
    pub fn is_identity(&self) -> bool {
        self.0.iter().zip(Self::IDENTITY.0).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    /// Local scale at `point`: square root of the determinant of the Jacobian. NaN for a mirrored map.
    pub fn scale_at(&self, point: [f64; 2]) -> f64 {
        let h = &self.0;
        let w = h[6] * point[0] + h[7] * point[1] + 1.0;
        (self.matrix().determinant() / (w * w * w)).sqrt()
    }

    /// Anisotropy at `point`: ratio of the singular values of the Jacobian, 1 or more. Not finite where a direction
    /// vanishes.
    fn anisotropy_at(&self, point: [f64; 2]) -> f64 {
        let h = &self.0;
        let w = h[6] * point[0] + h[7] * point[1] + 1.0;
        let [x, y] = self.apply(point);
        let [a, b, c, d] = [h[0] - x * h[6], h[1] - x * h[7], h[3] - y * h[6], h[4] - y * h[7]].map(|v| v / w);
        let (turned, mirrored) = ((a + d).hypot(b - c), (a - d).hypot(b + c));
        (turned + mirrored) / (turned - mirrored).abs()
    }

    /// The corners of a `width` x `height` image: the centres of the corner pixels.
    pub fn corners(width: u32, height: u32) -> [[f64; 2]; 4] {
        let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        [[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]]
    }

    /// Largest distance, px, between the images of the four image corners under `self` and under `other`; infinite
    /// where one of them has no finite image. The accuracy of a calibration is measured by it.
    pub fn corner_distance(&self, other: &Self, width: u32, height: u32) -> f64 {
        Self::corners(width, height)
            .into_iter()
            .map(|corner| {
                let (a, b) = (self.apply(corner), other.apply(corner));
                (a[0] - b[0]).hypot(a[1] - b[1])
            })
            .fold(0.0, |worst, moved| if moved.is_finite() { moved.max(worst) } else { f64::INFINITY })
    }

    /// Why this cannot be the homography of a slice of a `width` x `height` stack, as the predicate of a sentence;
    /// `None` when it can.
    ///
    /// A valid homography is finite, has `[8] == 1`, is not mirrored, keeps the image in front of the horizon, moves no
    /// corner by more than 5 times the longer side, scales by 1/4 to 4, and stretches no direction more than 4 times
    /// more than another. Everything computed from it is then finite.
    pub fn violation(&self, width: u32, height: u32) -> Option<String> {
        if self.0.iter().any(|v| !v.is_finite()) {
            return Some("has a number that is not finite".into());
        }
        if (self.0[8] - 1.0).abs() > 1e-9 {
            return Some(format!("has {} as its last number, which must be 1", self.0[8]));
        }
        let corners = Self::corners(width, height);
        for corner in corners {
            if self.0[6] * corner[0] + self.0[7] * corner[1] + 1.0 < 0.1 {
                return Some(
                    "maps a part of the image to the horizon or behind the camera; check the last row of the matrix"
                        .into(),
                );
            }
        }
        if self.matrix().determinant() < 0.0 {
            return Some("is mirrored; check that x and y are not exchanged".into());
        }
        let most = MAX_MOVE * f64::from(width.max(height));
        let moved = corners.map(|corner| {
            let to = self.apply(corner);
            (to[0] - corner[0]).hypot(to[1] - corner[1])
        });
        if let Some(&moved) = moved.iter().find(|moved| !(0.0..=most).contains(*moved)) {
            return Some(format!(
                "moves a corner of the image by {moved:.3e} px, and {most:.0} px (5 times the longer side) is the limit; \
                 check that it is row-major, in px of the whole slice, and maps slice pixel -> reference pixel"
            ));
        }
        let centre = [f64::from(width) / 2.0, f64::from(height) / 2.0];
        for point in corners.into_iter().chain([centre]) {
            let scale = self.scale_at(point);
            if !(0.25..=4.0).contains(&scale) {
                return Some(format!("is singular or scales the image by {scale:.4} (the limits are 0.25 and 4)"));
            }
            let anisotropy = self.anisotropy_at(point);
            if !(0.0..=MAX_ANISOTROPY).contains(&anisotropy) {
                return Some(format!(
                    "stretches the image {anisotropy:.3e} times more in one direction than in the other, and {MAX_ANISOTROPY} \
                     times is the limit; check the order of its numbers"
                ));
            }
        }
        None
    }
}

impl<'de> Deserialize<'de> for Homography {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(Numbers)
    }
}

/// The accepted JSON forms.
const FORM: &str = "9 numbers, or 3 rows of 3";

/// Reads 9 numbers or 3 rows of 3, as `tolist()` writes a numpy matrix.
struct Numbers;

impl<'de> de::Visitor<'de> for Numbers {
    type Value = Homography;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(FORM)
    }

    fn visit_seq<A: de::SeqAccess<'de>>(self, mut list: A) -> Result<Homography, A::Error> {
        let (mut numbers, mut count, mut rows) = ([0.0; 9], 0, 0);
        let mut take = |value: f64| {
            if let Some(place) = numbers.get_mut(count) {
                *place = value;
            }
            count += 1;
        };
        while let Some(element) = list.next_element::<Element>()? {
            match element {
                Element::Number(value) => take(value),
                Element::Row(row) => {
                    rows += 1;
                    row.into_iter().for_each(&mut take);
                }
            }
        }
        match (count, rows) {
            (9, 0 | 3) => Ok(Homography(numbers)),
            (9, _) => Err(de::Error::custom(format!("mixes rows and numbers; a homography is {FORM}"))),
            _ => Err(de::Error::invalid_length(count, &self)),
        }
    }
}

enum Element {
    Number(f64),
    Row([f64; 3]),
}

impl<'de> Deserialize<'de> for Element {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;

        impl<'de> de::Visitor<'de> for Either {
            type Value = Element;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a number, or a row of 3")
            }

            fn visit_f64<E>(self, value: f64) -> Result<Element, E> {
                Ok(Element::Number(value))
            }

            fn visit_i64<E>(self, value: i64) -> Result<Element, E> {
                Ok(Element::Number(value as f64))
            }

            fn visit_u64<E>(self, value: u64) -> Result<Element, E> {
                Ok(Element::Number(value as f64))
            }

            fn visit_seq<A: de::SeqAccess<'de>>(self, row: A) -> Result<Element, A::Error> {
                <[f64; 3]>::deserialize(de::value::SeqAccessDeserializer::new(row)).map(Element::Row)
            }
        }

        deserializer.deserialize_any(Either)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Homography, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn nine_numbers_and_three_rows_are_the_same_and_nine_are_written() {
        let flat = read("[1, 0, 0.5, 0, 1, -2, 0, 0, 1]");
        assert_eq!(flat, read("[[1, 0, 0.5], [0, 1, -2], [0, 0, 1]]"));
        let flat = flat.expect("nine numbers");
        assert_eq!(flat, Homography::similarity(1.0, [0.5, -2.0]));
        let written = serde_json::to_string(&flat).expect("finite numbers");
        assert_eq!(written, "[1.0,0.0,0.5,0.0,1.0,-2.0,0.0,0.0,1.0]");
    }

    #[test]
    fn a_corner_without_a_finite_image_is_infinitely_far() {
        let horizon = Homography([1e308, 0.0, 0.0, 0.0, 1.0, 0.0, 1e308, 0.0, 1.0]);
        for wrong in [Homography([f64::NAN; 9]), horizon] {
            assert_eq!(wrong.corner_distance(&Homography::IDENTITY, 600, 400), f64::INFINITY);
            assert_eq!(Homography::IDENTITY.corner_distance(&wrong, 600, 400), f64::INFINITY);
        }
    }

    #[test]
    fn homographies_beyond_the_limits_are_refused() {
        let error = |numbers| Homography(numbers).violation(64, 48).unwrap_or_default();
        assert!(
            error([1e-308, 0.0, 0.0, 0.0, 1e308, 0.0, 0.0, 0.0, 1.0]).starts_with("moves a corner of the image by inf")
        );
        assert!(error([1.0, 0.0, 321.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]).contains("and 320 px"));
        assert!(error([2.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]).starts_with("stretches the image 5.000e0 times"));
        assert!(error([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1e308, 0.0, 1.0]).starts_with("is singular"));
    }

    #[test]
    fn homographies_of_real_rigs_are_accepted() {
        let (cos, sin) = (0.3_f64.cos(), 0.3_f64.sin());
        for numbers in [
            Homography::IDENTITY.0,
            // a moving lens: tens of percent about the centre, and the whole image shifted
            Homography::similarity(1.6, [-0.3 * 64.0, -0.3 * 48.0]).0,
            Homography::similarity(0.6, [64.0, 48.0]).0,
            Homography::similarity(3.9, [0.0, 0.0]).0,
            Homography::similarity(3.9, [-64.0, 48.0]).0,
            // a camera on its side, or upside down
            [0.0, -1.0, 47.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            [-1.0, 0.0, 63.0, 0.0, -1.0, 47.0, 0.0, 0.0, 1.0],
            [cos * 1.01, -sin, 3.0, sin, cos * 0.99, -2.0, 1e-4, -1e-4, 1.0],
        ] {
            assert_eq!(Homography(numbers).violation(64, 48), None, "{numbers:?}");
        }
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(2000))]

        /// Numbers of every magnitude of a double, and numbers near those of real homographies.
        #[test]
        fn an_accepted_homography_gives_finite_results_and_survives_json(
            wild in proptest::array::uniform8(proptest::num::f64::NORMAL | proptest::num::f64::SUBNORMAL | proptest::num::f64::ZERO),
            tame in proptest::array::uniform8(-2.0..2.0_f64),
            mask: [bool; 8],
            width in 16..65_535_u32,
            height in 16..65_535_u32,
        ) {
            let mut numbers = Homography::IDENTITY.0;
            let sizes = [1.0, 1.0, 1e4, 1.0, 1.0, 1e4, 1e-5, 1e-5];
            for (i, number) in numbers.iter_mut().take(8).enumerate() {
                *number = if mask[i] { *number + tame[i] * sizes[i] * 0.5 } else { wild[i] };
            }
            // a quarter of the cases keeps to values that may be accepted
            if mask[0] && mask[4] {
                for (i, number) in numbers.iter_mut().take(8).enumerate() {
                    *number = Homography::IDENTITY.0[i] + tame[i] * sizes[i] * 0.1;
                }
            }
            let homography = Homography(numbers);
            if homography.violation(width, height).is_none() {
                let slice = crate::types::profile::ProfileSlice::given(1, homography, 1.0, width, height);
                let text = serde_json::to_string(&slice).expect("JSON");
                let again: crate::types::profile::ProfileSlice = serde_json::from_str(&text).expect("what was written");
                proptest::prop_assert_eq!(&again, &slice);
                proptest::prop_assert!(slice.scale.is_finite() && slice.shift_px.iter().all(|v| v.is_finite()));
            }
        }
    }

    #[test]
    fn other_shapes_are_refused_with_the_expected_shape() {
        for text in ["[1,2,3]", "[[1,0,0],[0,1,0]]", "[1,0,0,0,1,0,0,0,1,0]", "[]"] {
            assert!(read(text).is_err_and(|error| error.contains("9 numbers, or 3 rows of 3")), "{text}");
        }
        assert!(read("[[1,0,0],[0,1,0],0,0,1]").is_err_and(|error| error.contains("mixes rows and numbers")));
        assert!(read("[[1,0],[0,1],[0,0]]").is_err());
        assert!(read("[[[1,0,0]]]").is_err());
        assert!(read(r#"["1",0,0,0,1,0,0,0,1]"#).is_err());
        assert!(read("{}").is_err());
    }
}
