//! How slices are fused.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How slices are fused.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Guided filtering (Li, Kang & Hu 2013), the paper's method.
    Guided,
    /// Laplacian pyramids (Burt & Adelson 1983), the other classic.
    Pyramid,
    /// A decision map where it is better than pyramids, pyramids elsewhere, with the halos of near parts removed. The older
    /// name `unveiled` is accepted.
    #[default]
    #[serde(alias = "unveiled")]
    HaloCorrected,
}

/// Parameters of guided filtering fusion, under the paper's names. Filter radii are in px; `eps` are for
/// intensities in 0..1. The defaults are the reference parameters of Li, Kang & Hu 2013.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuidedParams {
    /// Radius of the guided filter for the base layer's weights.
    pub r1: u32,
    /// Regularisation of the same.
    pub eps1: f64,
    /// Radius of the guided filter for the detail layer's weights.
    pub r2: u32,
    /// Regularisation of the same.
    pub eps2: f64,
    /// Side of the mean filter that makes the base layer, px, odd.
    pub average: u32,
    /// Radius of the Gaussian that smooths |Laplacian| into the saliency, px.
    pub r_g: u32,
    /// Standard deviation of the same, px.
    pub sigma_g: f64,
}

impl Default for GuidedParams {
    fn default() -> Self {
        Self { r1: 45, eps1: 0.3, r2: 7, eps2: 1e-6, average: 31, r_g: 5, sigma_g: 5.0 }
    }
}
