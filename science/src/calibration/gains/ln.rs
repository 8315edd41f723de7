//! Logarithms of factors with their uncertainties.

/// Least relative standard deviation of a gain.
pub(super) const LEAST_SIGMA: f64 = 2e-4;
/// Largest relative standard deviation of a gain that counts as measured.
pub(in crate::calibration) const MAX_SIGMA: f64 = 0.005;

/// The natural logarithm of a factor, with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ln {
    /// The logarithm.
    pub value: f64,
    /// Its standard deviation: the relative one of the factor.
    pub sigma: f64,
}

impl Ln {
    /// The mean of two independent values, weighted by their uncertainties.
    pub(super) fn merged(self, other: Self) -> Self {
        let [a, b] = [self, other].map(|l| l.sigma.max(LEAST_SIGMA).powi(-2));
        Self { value: (a * self.value + b * other.value) / (a + b), sigma: (a + b).recip().sqrt() }
    }
}
