//! Options of fusion: the method, and the parameters of guided filtering.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Fusion method.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Guided filtering fusion (Li, Kang & Hu 2013), the method of Li & Nguyen (2019).
    Guided,
    /// Laplacian pyramid fusion (Burt & Adelson 1983).
    Pyramid,
    /// A decision map with the halos of near parts removed, and Laplacian pyramid fusion where the confidence in the
    /// map is low. The former name `unveiled` is accepted.
    #[default]
    #[serde(alias = "unveiled")]
    HaloCorrected,
}

impl Method {
    /// All methods, the default last.
    pub const ALL: [Self; 3] = [Self::Guided, Self::Pyramid, Self::HaloCorrected];
}

/// Parameters of guided filtering fusion, named as in Li, Kang & Hu (2013). The defaults are those of the paper.
///
/// Radii are in px; a window has a side of `2 r + 1`. `eps` is for intensities in 0..1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuidedParams {
    /// Radius of the guided filter for the weights of the base layer, at most 512.
    pub r1: u32,
    /// Regularisation of the same filter.
    pub eps1: f64,
    /// Radius of the guided filter for the weights of the detail layer, at most 512.
    pub r2: u32,
    /// Regularisation of the same filter.
    pub eps2: f64,
    /// Side of the mean filter that makes the base layer, px; odd, at most 255.
    pub average: u32,
    /// Radius of the Gaussian that smooths |Laplacian| into the saliency, px.
    pub r_g: u32,
    /// Standard deviation of the same Gaussian, px.
    pub sigma_g: f64,
}

impl Default for GuidedParams {
    fn default() -> Self {
        Self { r1: 45, eps1: 0.3, r2: 7, eps2: 1e-6, average: 31, r_g: 5, sigma_g: 5.0 }
    }
}
