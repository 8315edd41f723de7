//! Focus measures in two bytes: the largest one of each pixel is kept for the whole canvas.

/// A focus measure, to a thousandth: the exponent and the first ten bits of the mantissa of a float. Codes are ordered
/// as the values are. Values below 2^-40 count as 0, and larger ones than 2^24 as 2^24.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::fusion) struct FocusCode(u16);

/// Bits of a float that are left out.
const LEFT_OUT: u32 = 13;

/// Subtracted from the exponent and mantissa of a float: 2^-40 has the code after that of 0.
const OFFSET: i32 = ((127 - 40) << (23 - LEFT_OUT)) - FocusCode::ZERO.0 as i32 - 1;

impl FocusCode {
    /// Of no slice: below every other.
    pub(in crate::fusion) const NONE: Self = Self(0);
    /// Of a slice that covers the pixel, but not the whole window of the measure: below every measured value.
    pub(in crate::fusion) const UNSUPPORTED: Self = Self(1);
    /// Of 0.
    pub(in crate::fusion) const ZERO: Self = Self(2);

    /// The code of `value`; negative values count as 0.
    #[inline(always)]
    pub(in crate::fusion) fn of(value: f32) -> Self {
        let code = (value.max(0.0).to_bits() >> LEFT_OUT) as i32 - OFFSET;
        Self(code.clamp(i32::from(Self::ZERO.0), i32::from(u16::MAX)) as u16)
    }

    /// The middle of the values with this code; 0 without a measured value.
    #[inline(always)]
    pub(in crate::fusion) fn value(self) -> f32 {
        let bits = (i32::from(self.0) + OFFSET) << LEFT_OUT | 1 << (LEFT_OUT - 1);
        if self > Self::ZERO { f32::from_bits(bits as u32) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_is_not_above_zero_has_the_code_of_zero() {
        for value in [0.0, -0.0, -1.0, f32::NEG_INFINITY, f32::NAN, 1e-13] {
            assert_eq!(FocusCode::of(value), FocusCode::ZERO, "{value}");
        }
        let [none, unsupported, zero] = [FocusCode::NONE, FocusCode::UNSUPPORTED, FocusCode::ZERO];
        assert!(none < unsupported && unsupported < zero && zero < FocusCode::of(1e-12));
        assert_eq!([none, unsupported, zero].map(FocusCode::value), [0.0; 3]);
        assert_eq!(FocusCode::of(f32::INFINITY), FocusCode::of(1.7e7));
    }

    proptest! {
        #[test]
        fn a_value_is_kept_to_a_thousandth(value in 1e-12f32..1.6e7) {
            let kept = FocusCode::of(value).value();
            prop_assert!((kept - value).abs() <= 0.0005 * value, "{value} {kept}");
        }

        #[test]
        fn codes_are_ordered_as_their_values(a in 0f32..2e7, b in 0f32..2e7, of in -30..0) {
            let [a, b] = [a, b].map(|value| value * 2f32.powi(of));
            prop_assert!(a > b || FocusCode::of(a) <= FocusCode::of(b));
        }
    }
}
